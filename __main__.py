"""`python -m strata`: the command line outside a Blender binary."""

import sys

if __name__ == "__main__":
    try:
        from .ops.cli import main

        code = main()
    except KeyboardInterrupt:  # while modules load, and a second one while the first is being obeyed
        code = 130
    sys.exit(code)
