"""``python -m unitsel`` is the command ``unitsel``."""

import sys

from unitsel.cli import main

if __name__ == "__main__":
    sys.exit(main())
