"""docs/surroundings_tasks.md says what the code does: its examples run, its tables are the code's."""

import re
from pathlib import Path

import pytest
import yaml

import rj_gym
from tests.pages import bounds, examples, rows

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "surroundings_tasks.md").read_text()
EXAMPLES = examples(PAGE)


@pytest.mark.parametrize(("program", "output"), EXAMPLES)
def test_example_prints_what_the_page_says(program, output, capsys):
    exec(program, {})
    assert capsys.readouterr().out == output


def test_every_python_block_has_its_output():
    assert PAGE.count("```python") == len(EXAMPLES) == 1


def test_the_table_of_families_is_the_code_s():
    table = {row[0].split("`")[0].split(" ")[0]: row[1:] for row in rows(PAGE, "each episode draws one of them")[1:]}
    assert table.keys() == rj_gym.FAMILIES.keys()
    for name, family in rj_gym.FAMILIES.items():
        bends, radius, bend_radii, turns, stiffness, mu = table[name]
        assert (int(bends), float(radius), float(mu)) == (family.bends, family.radius, family.mu)
        assert [float(number) for number in re.findall(r"[\d.]+", bend_radii)] == list(family.bend_radius)
        flat = [number for turn in family.angles for number in turn]
        assert [float(number) for number in re.findall(r"[\d.]+", turns)] == flat
        assert {float(number) for number in re.findall(r"[\d.]+", stiffness)} == set(family.stiffness)


@pytest.mark.parametrize("name", ["Lumen", "Obstacles", "HiddenWall"])
def test_docstrings_table_every_kind_of_entry_with_its_bounds(name):
    table = bounds(rj_gym.LumenEnv.__doc__) | bounds(getattr(rj_gym, f"{name}Env").__doc__)
    settings = {"Lumen": {"walls": "ahead"}, "HiddenWall": {"observe_force": True}}.get(name, {})
    config = getattr(rj_gym, f"{name}Config")(**settings)
    for entry in rj_gym.surroundings_observation_entries(config):
        kind = re.sub(r"centre \d+", "centre d", re.sub(r"disc \d", "disc i", entry.name))
        kind = re.sub(r"link \d", "link k", re.sub(r"tendon \d", "tendon j", kind)).split(",")[0]
        assert table[kind] == (f"{entry.low:g}", f"{entry.high:g}"), entry.name


@pytest.mark.parametrize("name", ["Lumen", "Obstacles", "HiddenWall"])
def test_configuration_files_hold_the_defaults(name):
    kind, file = getattr(rj_gym, f"{name}Config"), {"HiddenWall": "hidden_wall"}.get(name, name.lower())
    values = yaml.safe_load((ROOT / "configs" / "env" / f"{file}.yaml").read_text())
    config, default = kind.from_dict({key: value for key, value in values.items() if key != "mechanism"}), kind()
    assert config.updated({"mechanism": default.mechanism}) == default


def test_docstrings_name_every_info():
    env = rj_gym.LumenEnv()
    _, start = env.reset(seed=0)
    *_, info = env.step([0.0] * 5)
    text = rj_gym.LumenEnv.__doc__.split("## Info")[1].split("## Arguments")[0]
    assert set(re.findall(r"`(\w+)`", text)) >= (start.keys() | info.keys())
