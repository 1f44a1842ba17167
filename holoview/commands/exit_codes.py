"""Exit codes of the command line besides 0. This module imports nothing, so that `holoview --help` starts fast."""

EXIT_FAILED = 1
"""The command was carried out in part: what failed is in the file that it wrote, and named on stderr."""

EXIT_USER_ERROR = 2
"""The command wasn't carried out: a mistake of the user, or no memory or disk space. One line on stderr says which."""

EXIT_DEVICE_LOST = 3
"""The graphics device was lost, or the viewer crashed again and again. Work in the viewer is saved."""

# A program that SIGINT (Ctrl-C), SIGTERM or SIGHUP ends returns 128 + the signal's number, as shells report it: 130,
# 143 or 129, see `holoview.util.processes`.
