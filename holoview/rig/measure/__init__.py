"""A session of captures on a rig, by a plan, each on the disk as soon as it is taken.

capture_plan    which captures: patterns, wavelength, distance, power, exposure
capture_store   captures one by one in a folder; the whole session as one capture file
exposure_search exposure times that use the camera's range without saturation
session         takes what is missing, and can be interrupted anywhere
"""
