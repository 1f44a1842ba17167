"""Kinds of devices beside those of the virtual bench; `open_rig` lists them all.

checks          checks that all kinds share: keys of rig.toml, returned values, a stage's coordinate
slmsuite_kind   modulators and cameras of slmsuite
manual          lasers and stage that a person sets
serial_line     lasers and stage at a serial line
micromanager    camera, lasers and stage of Micro-Manager
python_file     any device, in a Python file of one's own
"""
