"""Calibration: learns corrections to a bench's model from camera captures.

lut_fit             fits a modulator's look-up table to a diffraction-efficiency sweep
exposure            plans laser power and exposure time of captures
training_plan       settings, held-out captures, and which maps the captures can determine
train               trains the maps (those of `holoview.model.effects.learned_maps`) with Adam
calibration_result  scores, response of the lasers, and the calibrated preset
map_plots           plots the maps and the residuals
"""
