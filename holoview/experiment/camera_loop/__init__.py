"""Camera in the loop: measured pictures take the place of predicted intensities where the gradient is formed.

Peng et al., Neural holography with camera-in-the-loop training, ACM Trans. Graph. 39, 6 (2020), sec. 4.

bench_match     the rig's nominal bench as a system; whether another system is that of the rig
camera_view     from intensities on the model's samples to means over camera pixels, and its transpose
bench_camera    shows patterns and takes pictures: exposures, dark level, saturated pixels
registration    counts per unit of intensity, and where the camera is, from probe pictures
camera_problem  loss and gradients at the intensities that were measured
rig_job         a whole optimisation on a rig
loop            the loop: a generator of states
model_update    effects of the bench, found in the pictures taken so far
loop_checkpoint a loop saved in a safetensors file
"""
