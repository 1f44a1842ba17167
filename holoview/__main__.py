"""The program `holoview`, also as `python -m holoview`: it can be interrupted from its first moment on.

Its modules take some tenths of a second to import. Ctrl-C in that time, and while Python ends, leaves at once, without
a traceback; there is nothing to save. The viewer runs in a process of its own, which alone imports them: nobody waits
for them twice.
"""

import _signal as signal  # type: ignore[import-not-found]  # what `signal` wraps, which takes longer to load
import os
import sys


def run() -> int:
    """Runs the command line and returns its exit code."""
    _leave_on_interrupt()
    if not sys.warnoptions:  # warnings of libraries are for programmers: python -W default -m holoview
        _silence_libraries()
    from holoview.commands.supervisor import is_supervised, run_commands, supervise

    words = sys.argv[1:]
    code = supervise(run_commands, words) if is_supervised(words) else run_commands(words)
    _leave_on_interrupt(code)
    return code


def _leave_on_interrupt(code: int = 128 + signal.SIGINT) -> None:
    """From now on Ctrl-C ends the process with this exit code, unless it is ignored, as in a background job."""
    if signal.getsignal(signal.SIGINT) not in (signal.SIG_IGN, None):
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(code))


def _silence_libraries() -> None:
    """Hides warnings and notes of libraries, here and in processes that are started; errors that they log stay."""
    import logging
    import warnings

    warnings.simplefilter("ignore")
    os.environ.setdefault("PYTHONWARNINGS", "ignore")
    if logging.lastResort is not None:
        logging.lastResort.setLevel(logging.ERROR)


if __name__ == "__main__":
    sys.exit(run())
