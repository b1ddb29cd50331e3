"""What docs/interchange.md says of formats of other programs: its commands run, its tables have every key."""

import inspect
import re
import shlex
from pathlib import Path

import gymnasium
import pytest
import yaml

from agents import dataset, export
from agents.policies.contract import contract
from agents.shipped import load_policy
from rollingjoint import cli

PAGE = Path("docs/interchange.md").read_text("utf-8")
MAINS = {
    ("rj", "export-policy"): export.main,
    ("rj", "dataset"): dataset.main,
    ("rj",): cli.main,
}


def commands():
    blocks = re.findall(r"```bash\n(.*?)```", PAGE, re.DOTALL)
    return [line for block in blocks for line in block.splitlines()]


@pytest.mark.parametrize("line", commands())
def test_command_of_the_page_runs(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    words = shlex.split(line)
    start = next(start for start in MAINS if tuple(words[: len(start)]) == start)
    assert MAINS[start](words[len(start) :]) == 0
    assert list(tmp_path.iterdir())


def test_page_names_every_key_of_a_contract():
    values = contract(load_policy("late_pose"))
    parts = [*values["inputs"], *values["outputs"]]
    entries = [entry for part in parts for entry in part.get("entries", [])]
    keys = {key for each in [values, *parts, *entries, entries[0]["normaliser"]] for key in each}
    assert sorted(key for key in keys if f"`{key}`" not in PAGE) == []


def test_settings_for_rl_zoo3_are_of_registered_environments_and_of_ppo():
    from stable_baselines3 import PPO

    known = {*inspect.signature(PPO).parameters, "n_timesteps", "n_envs", "normalize"}
    given = yaml.safe_load(Path("examples/libraries/rl_zoo3_ppo.yaml").read_text("utf-8"))
    assert given.keys() <= gymnasium.registry.keys() and "--conf-file examples/libraries/rl_zoo3_ppo.yaml" in PAGE
    assert [key for settings in given.values() for key in settings if key not in known] == []
