"""The process that switches lasers off for a program that is gone: `python -m holoview.bench.rig.guard_process RIG`.

It reads stdin to its end. Unless it has read that the lasers are off, it opens them itself and switches them off.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from holoview.bench.rig.description import read_rig
from holoview.bench.rig.devices import LasersDevice
from holoview.bench.rig.open_rig import ALL_OFF, open_lasers
from holoview.util.errors import UserError

_TRIES, _PAUSE_S = 10, 0.5  # the system may need a moment to free the port of a program that is gone


def switch_off(open_them: Callable[[], LasersDevice]) -> int:
    """Opens lasers and switches them off, in several attempts; describes its actions. Returns the exit code."""
    for number in range(1, _TRIES + 1):
        try:
            lasers = open_them()
            try:
                lasers.switch_off()
            finally:
                lasers.close()
        except UserError as error:
            if number == _TRIES:
                print(f"lasers: couldn't be switched off ({error}): do it by hand", file=sys.stderr, flush=True)
                return 1
            time.sleep(_PAUSE_S)
        else:
            break
    print("lasers: switched off, since the program that used them is gone", file=sys.stderr, flush=True)
    return 0


def main() -> int:
    """Guards the lasers of the rig of the first argument."""
    rig = read_rig(sys.argv[1])
    return 0 if sys.stdin.read() == ALL_OFF else switch_off(lambda: open_lasers(rig))


if __name__ == "__main__":
    raise SystemExit(main())
