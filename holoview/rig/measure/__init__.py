"""A session of captures on a rig, by a plan, each on the disk as soon as it is taken.

capture_plan    which captures: patterns, wavelength, distance, power, exposure
exposure_table  laser powers and exposures that `holoview captures plan` wrote
capture_store   captures one by one in a folder; the whole session as one capture file
bench_record    what is found out of the bench beside them, in the same files
exposure_search exposure times that use the camera's range without saturation
picture_check   pictures that a camera can't have taken are taken again
dark_frames     the camera without light, and what rig.toml states of it
settling        how fast a modulator settles
session         takes what is missing, and can be interrupted anywhere
forecast        what a session would do, how long it takes, and what it needs
"""
