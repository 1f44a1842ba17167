"""Calibration: the bench as it is, learned from measurements.

sweep lut lut_file            a modulator's look-up table from the first-order power of a grating
held_out layout material      captures to learn from and to judge by; which maps; what was seen, and how much it weighs
model settings train          what is predicted for maps, and the gradient descent on them, from coarse to fine
checkpoint                    a calibration between two epochs, kept
response score                what the lasers emit; how well held-out captures are predicted
result pictures drawing       the files that are written, and pictures of what was learned
exposure                      exposure and laser power for captures that use the camera's range

The maps themselves, and what they make of light, are in `holoview.effects.learned_maps`.
"""
