"""Counterexamples: made small, kept as files in found/, and tried again by test_found.py."""

import hashlib
import json
from pathlib import Path

import numpy as np

from rollingjoint import FrictionState, RollingJointError
from rollingjoint.io.mechanism_file import mechanism_from_dict, mechanism_to_dict

FOLDER = Path(__file__).parent / "found"
READERS = {}  # of files that are kept, by the end of their names
_MOST_TRIES = 300


def keep_input(path, read):
    """Keep the content of a file that `read`, which reads that file, does not survive."""

    def fails(content):
        path.write_bytes(content)
        try:
            read()
        except (RollingJointError, OSError):
            return False
        except Exception:
            return True
        return False

    content = smallest(path.read_bytes(), fails)
    return _written(f"{hashlib.sha256(content).hexdigest()[:8]}{path.suffix}", content)


def smallest(content, fails):
    """The bytes without all that can be left out while they still fail."""
    width, tries = max(1, len(content) // 2), 0
    while tries < _MOST_TRIES:
        before = len(content)
        place = 0
        while place < len(content) and tries < _MOST_TRIES:
            tries += 1
            less = content[:place] + content[place + width :]
            if fails(less):
                content = less
            else:
                place += width
        if width == 1 and len(content) == before:
            break
        width = max(1, width // 2)
    return content


def keep_solve(case, row):
    """Keep one row of a case, with as few loads as it still fails with; None where it does not fail alone."""
    one = alone(case, row)
    if not fails(one):
        return None
    for place in reversed(range(one.tables.shape[1])):
        less = alone(one, 0)
        less.tables = np.delete(one.tables, place, axis=1)
        one = less if fails(less) else one
    values = {
        "mechanism": mechanism_to_dict(one.mechanism),
        "given": one.given,
        "inputs": one.inputs.tolist(),
        "tables": [one.tables.tolist(), list(one.tables.shape)],
        "starts": one.starts.tolist(),
        "limits": list(one.limits),
        "before": None if one.before is None else [array.tolist() for array in one.before],
    }
    text = json.dumps(values, indent=1)
    return _written(f"{hashlib.sha256(text.encode()).hexdigest()[:8]}.solve", text.encode())


def read_solve(path):
    """The case in a kept file."""
    from tests.attack.solves import Case

    values = json.loads(path.read_text("utf-8"))
    tables, shape = values["tables"]
    before = values["before"] and FrictionState(*map(np.array, values["before"]))
    arrays = (np.array(values[name]) for name in ("inputs", "starts"))
    inputs, starts = arrays
    mechanism = mechanism_from_dict(values["mechanism"])
    limits = tuple(values["limits"])
    return Case(mechanism, values["given"], inputs, np.array(tables).reshape(shape), starts, limits, before)


def alone(case, row):
    """The case with one of its rows."""
    rows = slice(row, row + 1)
    before = case.before and FrictionState(*(np.array(array[rows]) for array in case.before))
    arrays = (np.array(array[rows]) for array in (case.inputs, case.tables, case.starts))
    return type(case)(case.mechanism, case.given, *arrays, case.limits, before)


def fails(case):
    """Whether recomputing the case finds anything wrong."""
    with np.errstate(invalid="ignore"):
        numbers = [case.inputs, case.starts, case.tables]
        unusable = np.array(
            [not all(np.all(np.abs(each[row]) <= 1e12) for each in numbers) for row in range(len(case.inputs))]
        )
    faults, _ = case.faults(case.solve(), unusable)
    return bool(faults)


def _written(name, content):
    FOLDER.mkdir(exist_ok=True)
    path = FOLDER / name
    path.write_bytes(content)
    print(f"kept: {path}", flush=True)
    return path
