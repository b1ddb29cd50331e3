"""Measurement files: what they hold, and one line for everything that is wrong in them."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.identify import KINDS, Input, load_measurements, measurements_from_dict
from rollingjoint.identify.measurement_file import KEYS
from rollingjoint.load import WorldForce
from tests.pages import rows

ROOT = Path(__file__).parents[3]
DATA = ROOT / "examples" / "data"
PAGE = (ROOT / "docs" / "fidelity.md").read_text("utf-8")

ONE = """
mechanism: five_link
runs:
  A:
    - {tensions: [3, 6], approach: [{tensions: [3, 3]}, {lengths: [92, 96]}], tip: [1, 80], weight: 2}
    - {tensions: [3, 3], lengths: [90, 99], positions: [null, [0, 20], null, null, [1, 80]], forces: [[-1, 0.1, 0]]}
"""


def test_photographed_runs_are_those_of_the_earlier_file():
    measurements = load_measurements(DATA / "two_runs_raw.yaml")
    poses = yaml.safe_load((DATA / "measured_poses.json").read_text("utf-8"))["poses"]
    steps = measurements.runs[0].steps
    for step, pose in zip(steps, poses, strict=True):
        np.testing.assert_array_equal(np.column_stack([step.positions, step.angles]), pose["link_poses"])
        assert step.lengths == pose["tendon_lengths"]
        np.testing.assert_allclose(step.tensions, 2.94 * np.array(pose["tension_ratio"]))
    assert [run.name for run in measurements.runs] == ["A", "B"]
    assert "photographs" in measurements.source


def test_everything_in_a_file_is_read():
    measurements = measurements_from_dict(yaml.safe_load(ONE))
    first, second = measurements.runs[0].steps
    assert first.approach == [Input("tensions", (3.0, 3.0)), Input("lengths", (92.0, 96.0))]
    assert second.forces == [WorldForce(-1, (0.1, 0.0))]
    readings = measurements.readings(measurements.runs)
    assert np.flatnonzero(np.isfinite(readings[0])).tolist() == [8, 9]
    assert np.flatnonzero(np.isfinite(readings[1])).tolist() == [2, 3, 8, 9, 15, 16]
    assert first.weight == 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("five_link", "five_lnik", "Did you mean 'five_link'"),
        ("runs:", "run:", "unknown key = 'run'.*Did you mean 'runs'"),
        ("tensions: [3, 6]", "tensions: [3, 6, 1]", "run A, step 0: tensions.*2 numbers"),
        ("tensions: [3, 6]", "tensions: [3, -6]", "no negative tension"),
        ("tensions: [3, 6], ", "", "run A, step 0: tensions of a step = None: expected tensions, which were given"),
        ("tip: [1, 80]", "tip: [1, 80, 3]", r"runs.A\[0\].tip.*2 numbers, or null"),
        ("[null, [0, 20]", "[[0, 20]", r"runs.A\[1\].positions.*5 rows"),
        ("positions: [", "tip: [1, 2], positions: [", "one of poses, positions, tip and photograph"),
        ("forces: [[-1, 0.1, 0]]", "forces: [[-1, 0.1]]", "a link and 2 numbers"),
        ("forces: [[-1,", "forces: [[7,", "an integer from -5 to 4"),
        ("{lengths: [92, 96]}", "{lengths: [92, 96], tensions: [1, 1]}", "either tensions or lengths"),
        ("weight: 2", "weight: 0", "weight = 0.0: expected a positive number"),
        ("mechanism:", "given: angles\nmechanism:", "one of 'tensions', 'lengths'"),
        ("mechanism:", "deviations: {tension: 0.1}\nmechanism:", "at least one quantity that was measured"),
        ("mechanism:", "deviations: {position: 0}\nmechanism:", r"a positive number \[mm\]"),
        ("mechanism:", "absolute: maybe\nmechanism:", "true or false"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(old, new, message, tmp_path):
    assert old in ONE
    path = tmp_path / "runs.yaml"
    path.write_text(ONE.replace(old, new, 1), "utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        load_measurements(path)
    assert "\n" not in str(caught.value)


def test_the_mechanism_may_stand_beside_the_file_or_in_it(tmp_path):
    chain = (ROOT / "configs" / "mechanism" / "five_link.yaml").read_text("utf-8")
    (tmp_path / "chain.yaml").write_text(chain, "utf-8")
    path = tmp_path / "runs.yaml"
    path.write_text(ONE.replace("five_link", "chain.yaml"), "utf-8")
    assert load_measurements(path).mechanism.n_links == 5
    inside = yaml.safe_load(ONE) | {"mechanism": yaml.safe_load(chain)}
    assert measurements_from_dict(inside).mechanism.n_links == 5


def test_poses_are_those_of_planar_chains():
    content = {"mechanism": "small_arm", "runs": {"A": [{"tensions": [1] * 4, "poses": [[0, 0, 0]] * 5}]}}
    with pytest.raises(ConfigError, match="positions or tip, for an arm"):
        measurements_from_dict(content)
    content["runs"]["A"][0].pop("poses")
    with pytest.raises(InvalidInput, match="at least one quantity"):
        measurements_from_dict(content)


def test_the_page_shows_a_valid_file_and_every_key_and_parameter():
    (block,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    first, second = measurements_from_dict(yaml.safe_load(block)).runs[0].steps
    assert len(first.approach) == 2 and np.isfinite(second.angles).sum() == 2
    keys = {name for row in rows(PAGE, "## Measurement files")[1:] for name in re.findall(r"\w+", row[0])}
    assert keys == set(KEYS)
    table = [row for row in rows(PAGE, "## Identify")[1:]]
    assert [(row[0], row[3]) for row in table] == [(name, kind.meaning) for name, kind in KINDS.items()]
    assert [row[2] for row in table] == [f"{kind.low:g} to {kind.high:g}" for kind in KINDS.values()]
