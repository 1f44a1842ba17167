"""`python -m holoview`: the command line, for launchers that start modules."""

import sys

from holoview.cli import main

if __name__ == "__main__":
    sys.exit(main())
