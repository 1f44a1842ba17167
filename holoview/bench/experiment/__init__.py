"""Experiments on a rig, real or virtual: they predict, diagnose or optimise between captures.

rig_bench       the nominal bench of a rig as a system; what a diagnosis is told of an aligned rig

closed_loop     the next capture: takes captures until the cause is certain, or a budget is spent; planners
hypotheses      the possible causes: fits, evidence, probabilities
capture_choice  captures that could be taken; the proposal of most information in a second, its pattern improved by
                gradient, and the reason

camera_loop     camera in the loop: measured pictures take the place of predicted intensities where the gradient is
                formed (Peng et al., ACM Trans. Graph. 39, 6 (2020), sec. 4); checkpoints, the whole job on a rig
camera_problem  loss and gradients at measured intensities; how the camera sees the model's samples
bench_camera    shows patterns and takes pictures: exposures, dark level, saturated pixels

lut_sweep       the readings for a modulator's look-up table: levels, periods, orders, wavelengths
grating_orders  where the orders of a binary grating are in a picture, and how strong they are
"""
