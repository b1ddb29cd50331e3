"""`python -m rollingjoint` is `rj`."""

import sys

from rollingjoint.cli import main

if __name__ == "__main__":
    sys.exit(main())
