"""Hardware: the devices of a bench, real or virtual, their limits, where they are, and measuring with them.

devices       what a modulator, a camera, lasers and a stage can do; `Devices`, which are closed safely
description   reads rig.toml: devices, their facts, safety limits, nominal geometry
placement     where the devices are: RIG.placement.toml
placed_devices  devices as if they were mounted as the model has them
limits        lasers, camera and stage that can't leave the safety limits
open_rig      opens the devices that a description names
laser_guard   lasers that go off when the program that had opened them is gone
guard_process the process that switches them off
kinds         devices of slmsuite, Micro-Manager and serial lines, manual ones, and Python files of one's own
align         finds where they are, from patterns that it sends
virtual       a virtual bench in a process of its own
measure       a session of captures by a plan, each on the disk at once
"""

from holoview.rig.description import RigDescription, read_rig
from holoview.rig.open_rig import open_rig

__all__ = ["RigDescription", "open_rig", "read_rig"]
