"""What the effect `calibrated` applies; apart from the effects, since it needs torch, which takes a second to import.

learned_maps      the maps that a calibration learned from captures, and what they do to light
map_schema        what that file may hold
calibration_file  the file that holds them
"""
