"""The former name of the command python -m agents.tuning.controllers."""

import sys

from agents.tuning.controllers import main

if __name__ == "__main__":
    sys.exit(main())
