"""Rows of the speed page, one module per kind; `python benchmarks/speed.py` measures them."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2]))  # where tests.second_opinions, some of the peers, lies
