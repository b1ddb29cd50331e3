"""docs/environment.md says what the code does: its examples run, its tables are the code's."""

import dataclasses
import re
from pathlib import Path

import pytest
import yaml

import rj_gym
from rj_gym.tracking.options import OPTIONS

PAGE = (Path(__file__).parent.parent / "docs" / "environment.md").read_text()
EXAMPLES = re.findall(r"^```python\n(.*?)^```\n\n```text\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
SETTINGS = ("TrackingConfig", "LoadConfig", "TargetConfig", "RewardConfig", "RandomizationConfig")
NESTED = {"load", "target", "reward", "randomization"}


def rows(heading):
    """Cells of the first table below a heading."""
    section = PAGE.split(heading, 1)[1].split("\n#", 1)[0]
    return [
        [cell.strip(" `") for cell in line.strip("|").split(" | ")] for line in section.splitlines() if line[:2] == "| "
    ]


@pytest.mark.parametrize(("program", "output"), EXAMPLES)
def test_example_prints_what_the_page_says(program, output, capsys):
    exec(program, {})
    assert capsys.readouterr().out == output


def test_every_python_block_has_its_output():
    assert PAGE.count("```python") == len(EXAMPLES) == 4


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_table_has_every_key_and_its_default(name):
    default = getattr(rj_gym, name)()
    table = {key: yaml.safe_load(value) for key, value, *_ in rows(f"### {name}")[1:]}
    fields = {f.name: getattr(default, f.name) for f in dataclasses.fields(default) if f.name not in NESTED}
    assert table == {key: list(value) if isinstance(value, tuple) else value for key, value in fields.items()}


def test_options_table_is_complete():
    assert [key for key, *_ in rows("## Fixing an episode")[1:]] == list(OPTIONS)


def test_info_and_reward_tables_are_complete():
    env = rj_gym.RollingJointGoalEnv()
    _, start = env.reset(seed=0)
    info = env.step([0.0, 0.0])[-1]
    named = {name for key, *_ in rows("## Info")[1:] for name in re.findall(r"\w+", key)}
    assert named == start.keys() | info.keys()
    env = rj_gym.RollingJointEnv()
    env.reset(seed=0)
    assert [key for key, *_ in rows("## Reward")[1:]] == list(env.step([0.0, 0.0])[-1]["reward_terms"])


def test_class_docstring_tables_every_kind_of_entry_with_its_bounds():
    table = {}
    for line in re.findall(r"^ *\| (.*) \|$", rj_gym.RollingJointEnv.__doc__, re.MULTILINE):
        names, _, _, low, high = line.split(" | ") if line.count(" | ") == 4 else [""] * 5
        for name in re.sub(r"\(.*\)", "", names).split(","):
            table[name.strip()] = (low, high)
    env = rj_gym.RollingJointEnv(observe_load=True)
    for entry in rj_gym.observation_entries(env.config, env.task.mechanism):
        kind = re.sub(r"(link) \d", r"\1 k", re.sub(r"(tendon) \d", r"\1 j", entry.name))
        assert table[kind] == (f"{entry.low:g}", f"{entry.high:g}"), entry.name
