"""Makes `python -m holoview` run the command line, for launchers such as torchrun that start modules."""

import sys

from holoview.cli import main

if __name__ == "__main__":
    sys.exit(main())
