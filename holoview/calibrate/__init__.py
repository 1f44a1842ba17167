"""Calibration: the bench as it is, learned from measurements.

sweep lut              a modulator's look-up table from the first-order power of a grating
split noise            captures to learn from and to judge by; how far a pixel may lie from its prediction
maps model             what is learned: tensors that a gradient reaches, and what they make of light
train checkpoint       gradient descent from coarse to fine, kept on the way
gains score            laser responses in closed form; how well held-out captures are predicted
result pictures        the files that are written, and pictures of what was learned
exposure               exposure and laser power for captures that use the camera's range
"""
