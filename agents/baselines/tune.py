"""The former name of the command python -m agents.controllers.tune."""

import sys

from agents.controllers.tune import main

if __name__ == "__main__":
    sys.exit(main())
