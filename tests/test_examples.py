"""Every example runs as it stands, in an empty folder."""

from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs_without_errors_or_warnings(example, run_python):
    run_python(str(example))
