"""A real bench: driving it, measuring it, naming what the simulation gets wrong, and learning its maps.

captures    measured data, virtual measurements, and the expected camera images
rig         hardware: devices, their registration, measuring
diagnose    which imperfections explain captures, with intervals
calibrate   maps and tables learned from captures
experiment  the next capture; camera in the loop
"""
