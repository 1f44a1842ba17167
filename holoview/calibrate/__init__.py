"""Calibration: learns corrections to a bench's model from camera captures.

lut_fit             fits a modulator's look-up table to a diffraction-efficiency sweep; plans laser power and exposures
train               settings, held-out captures, and maps that the captures can determine; trains the maps (those of
                    `holoview.model.effects.learned_maps`) with Adam
calibration_result  scores, response of the lasers, and the calibrated preset; plots; the whole calibration
"""
