"""docs/generalist.md and the docstring of the environment say what the code does."""

import re
from pathlib import Path

import pytest
import yaml

import rj_gym
from tests.pages import bounds, rows

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "generalist.md").read_text()


def test_settings_table_has_every_key_and_its_default():
    config = rj_gym.MechanismsConfig()
    settings = [row for row in rows(PAGE, "### MechanismsConfig") if len(row) == 3][1:]
    table = {key: yaml.safe_load(value) for key, value, _ in settings}
    assert table == {"space": dict(config.space), "links": list(config.links), "designs": list(config.designs)}


def test_docstring_tables_every_entry_of_the_description_with_its_bounds():
    text = rj_gym.ManyMechanismsEnv.__doc__.replace("joint k left, middle, right", "joint k middle")
    table, task = bounds(text), rj_gym.ManyMechanismsEnv().task
    described = task.entries()[len(task.sizes[8].entries()) :]
    assert len(described) == 1 + 7 * 7
    for entry in described:
        kind = re.sub(r"(link|joint) \d", r"\1 k", re.sub(r"hole \d", "hole j", entry.name))
        kind = re.sub(r"left|right", "middle", kind)
        assert table[kind] == (f"{entry.low:g}", f"{entry.high:g}"), entry.name


@pytest.mark.parametrize(
    ("name", "sensing"), [("generalist", {}), ("generalist_blind", {"pose": "none", "tension_noise": 0.1})]
)
def test_configuration_files_differ_from_the_defaults_by_designs_and_sensors(name, sensing):
    values = yaml.safe_load((ROOT / "configs" / "env" / f"{name}.yaml").read_text())
    config = rj_gym.ManyMechanismsConfig.from_dict(values)
    assert config == rj_gym.ManyMechanismsConfig(mechanisms={"designs": (0, 512)}, sensing=sensing)
