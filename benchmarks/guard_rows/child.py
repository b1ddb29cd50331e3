"""One section in one checkout, in a process of its own.

    python -m guard_rows.child SECTION OUT CHECKOUT OLDER [--quick]

OLDER is the older checkout, whose pages and files both read.
"""

from __future__ import annotations

import sys
import time
from importlib import import_module
from pathlib import Path

from guard_rows.drawing import FULL, QUICK


def main() -> None:
    section, out, checkout, older = sys.argv[1], *map(Path, sys.argv[2:5])
    sizes = QUICK if "--quick" in sys.argv else FULL
    check_imports(checkout)
    module = import_module(f"guard_rows.{section}")
    arguments = (sizes, older, out) if section in ("names", "files") else (sizes,)
    begin = time.perf_counter()
    for number, record in enumerate(module.records(*arguments)):
        record.write(out / f"{number:03}.npz")
        done = f"{time.perf_counter() - begin:.0f} s: {out.name}: {record.row}: {record.count:,}"
        print(done, file=sys.stderr, flush=True)


def check_imports(checkout: Path) -> None:
    """Exit where the package is imported from elsewhere, as from an installed checkout."""
    import rollingjoint

    if checkout not in Path(rollingjoint.__file__).parents:
        sys.exit(f"rollingjoint comes from {rollingjoint.__file__}, not from {checkout}")


if __name__ == "__main__":
    main()
