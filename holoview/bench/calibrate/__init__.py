"""Calibration: learns corrections to a bench's model from camera captures.

sweep               measured sweeps of a modulator's grey level, from files
lut_fit             fits a modulator's look-up table to sweeps
lut_table           look-up tables in files, in a bench and for people; tables of vendors
exposure            plans laser power and exposures
train               settings, held-out captures, and maps that the captures can determine; trains the maps (those of
                    `holoview.light.model.effects.learned_maps`) with Adam
calibration_result  scores, response of the lasers, and the calibrated preset; plots; the whole calibration
"""
