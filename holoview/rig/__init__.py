"""Hardware: the devices of a bench, real or virtual, their limits, where they are, and measuring with them.

devices        what a modulator, a camera, lasers and a stage can do; `Devices`, which are closed safely
description    reads rig.toml: devices, their facts, safety limits, nominal geometry
registration   where the devices are: RIG.placement.toml; devices as if they were mounted as the model has them
limits         lasers, camera and stage that can't leave the safety limits
open_rig       opens the devices that a description names; lasers that go off with the program
guard_process  the process that switches them off
live_devices   devices that a window uses: nothing waits for them, and lasers go off at any time
kinds          devices of slmsuite, Micro-Manager and serial lines, manual ones, and Python files of one's own
align          finds where the devices are, from patterns that it sends
virtual        a virtual bench in a process of its own
measure        captures by a plan, each on the disk at once
"""

from holoview.rig.description import RigDescription, read_rig
from holoview.rig.open_rig import open_rig

__all__ = ["RigDescription", "open_rig", "read_rig"]
