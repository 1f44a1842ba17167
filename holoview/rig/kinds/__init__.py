"""Kinds of devices beside those of the virtual bench; `open_rig` lists them all.

options         reads a device's own keys in rig.toml
answers         what devices return, checked against rig.toml
slmsuite_kind   modulators and cameras of slmsuite
manual          lasers and stage that a person sets
serial_line     lasers and stage at a serial line
micromanager    camera, lasers and stage of Micro-Manager
python_file     any device, in a Python file of one's own
stage_axis      a stage's own coordinate, and the distance that it stands for
"""
