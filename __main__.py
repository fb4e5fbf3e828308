"""`python -m strata`: the command line outside a Blender binary."""

import sys

from .ops.cli import main

if __name__ == "__main__":
    sys.exit(main())
