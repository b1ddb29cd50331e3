"""docs/generalist.md and the docstring of the environment say what the code does."""

import re
from pathlib import Path

import pytest
import yaml

import rj_gym
from tests.pages import bounds, rows

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "generalist.md").read_text()


@pytest.mark.parametrize(
    ("config", "heading"),
    [
        (rj_gym.MechanismsConfig(), "### MechanismsConfig"),
        (rj_gym.MechanismsInSpaceConfig(), "### MechanismsInSpaceConfig"),
    ],
    ids=["plane", "space"],
)
def test_settings_table_has_every_key_and_its_default(config, heading):
    settings = [row for row in rows(PAGE, heading) if len(row) == 3][1:]
    table = {key: yaml.safe_load(value) for key, value, _ in settings}
    assert table == {"space": dict(config.space), "links": list(config.links), "designs": list(config.designs)}


@pytest.mark.parametrize(
    ("kind", "per_link"), [(rj_gym.ManyMechanismsEnv, 7), (rj_gym.ManyMechanismsInSpaceEnv, 20)], ids=["plane", "space"]
)
def test_docstring_tables_every_entry_of_the_description_with_its_bounds(kind, per_link):
    text = kind.__doc__.replace("joint k left, middle, right", "joint k middle").replace("hole j x, y, z", "hole j x")
    table, task = bounds(text), kind().task
    described = task.entries()[len(task.sizes[8].entries()) :]
    assert len(described) == 1 + 7 * per_link
    for entry in described:
        name = re.sub(r"(link|joint) \d", r"\1 k", re.sub(r"hole \d", "hole j", entry.name))
        name = re.sub(r"left|right", "middle", re.sub(r"hole j [yz]", "hole j x", name))
        assert table[name] == (f"{entry.low:g}", f"{entry.high:g}"), entry.name


@pytest.mark.parametrize(
    ("kind", "name", "sensing"),
    [
        (kind, f"{name}{hidden}", sensing)
        for kind, name in (
            (rj_gym.ManyMechanismsConfig, "generalist"),
            (rj_gym.ManyMechanismsInSpaceConfig, "generalist_space"),
        )
        for hidden, sensing in (("", {}), ("_blind", {"pose": "none", "tension_noise": 0.1}))
    ],
)
def test_configuration_files_differ_from_the_defaults_by_designs_and_sensors(kind, name, sensing):
    values = yaml.safe_load((ROOT / "configs" / "env" / f"{name}.yaml").read_text())
    first, stop = values["mechanisms"]["designs"]
    assert (first, stop) == (0, 2048 if name == "generalist_space_blind" else 512)
    assert kind.from_dict(values) == kind(mechanisms={"designs": (first, stop)}, sensing=sensing)
