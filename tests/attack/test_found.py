"""What the attack has found once stays repaired."""

import pytest

from rollingjoint import RollingJointError
from tests.attack import found, inputs  # noqa: F401  # registers the readers

KEPT = sorted(found.FOLDER.iterdir())


@pytest.mark.parametrize("path", KEPT, ids=[path.name for path in KEPT])
def test_what_was_found_stays_repaired(path):
    kind = path.suffix.removeprefix(".")
    if kind == "solve":
        assert not found.fails(found.read_solve(path))
        return
    try:
        found.READERS[kind](path)
    except (RollingJointError, OSError) as error:
        assert len(str(error).splitlines()) == 1
