"""Camera in the loop: measured pictures take the place of predicted intensities where the gradient is formed.

Peng et al., Neural holography with camera-in-the-loop training, ACM Trans. Graph. 39, 6 (2020), sec. 4.

bench_camera     shows patterns and takes pictures: exposures, dark level, saturated pixels
camera_problem   loss and gradients at measured intensities; how the camera sees the model's samples
loop             the loop: a generator of states; its checkpoints, updates of the model, the whole job on a rig
"""
