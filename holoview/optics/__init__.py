"""Optical elements as torch functions, one a file.

source     plane waves that illuminate the first modulator
slm        drive → optical path → phase; pixels onto the simulation grid
propagate  transfer functions and their application
pupil      aberration and apodisation of a relay
slots      what a frame is computed from, gathered for the executors
"""
