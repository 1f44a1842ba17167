"""Hardware: the devices of a bench, real or virtual, their limits, where they are, and measuring with them.

devices         what a modulator, a camera, lasers and a stage can do; `Devices`, which are closed safely; devices that
                can't leave the safety limits
description     reads rig.toml: devices, their facts, safety limits, nominal geometry
registration    where the devices are: RIG.placement.toml; devices as if they were mounted as the model has them
open_rig        opens the devices that a description names; lasers that go off with the program
guard_process   the process that switches them off
live_devices    devices that a window uses: nothing waits for them, and lasers go off at any time
kinds           devices of slmsuite, Micro-Manager and serial lines, manual ones, and Python files of one's own
virtual         a virtual bench in a process of its own

dots            patterns that make dots (lenslets with a carrier, gratings); dots in pictures, their bias; where dots
                fall, and the fit of the geometry
align           from the first dot to the geometry, the registration and its check

capture_plan    which captures are taken: patterns, wavelength, distance, power, exposure; how long they take
camera_pictures pictures that measurements can rely on: exposed, checked, dark; how fast a modulator settles
measurement     takes the missing captures of a plan, and can be interrupted anywhere
capture_folder  captures one by one in a folder, in the end one capture file; the record of the bench beside them
"""

from holoview.bench.rig.description import RigDescription, read_rig
from holoview.bench.rig.open_rig import open_rig

__all__ = ["RigDescription", "open_rig", "read_rig"]
