"""The shipped generalist, and the commands of docs/generalist.md."""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

from agents import evaluate, train
from agents.controllers import JacobianFeedback, OpenLoop
from agents.evaluation.rollout import run_episodes
from agents.policies.export import policy_in_run
from agents.runs.environment import EnvConfig
from agents.shipped import load_policy

PAGE = Path("docs/generalist.md").read_text("utf-8")
FEW = "total_timesteps=60 env.n_envs=3 env.settings.mechanisms.designs=[0,4] env.settings.episode_steps=10"


PLANE_AND_SPACE = pytest.mark.parametrize(
    ("name", "env_id"),
    [("generalist", "rj_gym/ManyMechanisms-v0"), ("generalist_space", "rj_gym/ManyMechanismsInSpace-v0")],
    ids=["plane", "space"],
)


@PLANE_AND_SPACE
def test_the_generalist_is_at_the_floor_of_feedback_on_designs_that_it_has_not_seen(name, env_id):
    settings = {"mechanisms": {"designs": (2_000_000, 2_000_008)}}
    env = EnvConfig(env_id, settings=settings)
    errors = {
        name: np.median(run_episodes(env, controller, range(60, 68)).last_errors)
        for name, controller in {"policy": load_policy(name), "model": JacobianFeedback()}.items()
    }
    assert errors["policy"] < 1.2 * errors["model"] + 0.02


@PLANE_AND_SPACE
def test_where_the_tip_is_not_seen_the_generalist_comes_nearer_than_the_command_of_every_exact_model(name, env_id):
    policy = load_policy(f"{name}_blind")
    settings = {"mechanisms": {"designs": (2_000_000, 2_000_016)}, "sensing": {"pose": "none", "tension_noise": 0.1}}
    env = EnvConfig(env_id, settings=settings)
    assert policy.settings.sensing == env.arguments()["config"].sensing
    errors = {
        name: np.median(run_episodes(env, controller, range(60, 92)).last_errors)
        for name, controller in {"policy": policy, "model": OpenLoop()}.items()
    }
    assert errors["policy"] < 0.9 * errors["model"]


@PLANE_AND_SPACE
def test_a_run_with_many_mechanisms_is_trained_and_exported(tmp_path, name, env_id):
    few = [*FEW.split(), "evaluation.every=60", "evaluation.episodes=2", "checkpoint_every=60"]
    arguments = ["--config", f"configs/train/{name}.yaml", "--run-dir", str(tmp_path / "run")]
    assert train.main([*arguments, *(word for one in few for word in ("--set", one))]) == 0
    (file,) = tmp_path.glob("run/best/policy.safetensors")
    policy = policy_in_run(file)
    again = type(policy).from_bytes(policy.to_bytes())
    assert policy.env_id == env_id and again.settings == policy.settings and again.sha256 == policy.sha256
    observation, _ = again.make_env().reset(seed=0)
    assert np.array_equal(again(observation), policy(observation))


@pytest.mark.slow
def test_the_commands_of_the_page_run(tmp_path, monkeypatch, no_pictures):
    import importlib.util

    script = Path("benchmarks/generalist.py").resolve()
    for name in ("configs", "docs"):
        (tmp_path / name).symlink_to(Path(name).resolve())
    monkeypatch.chdir(tmp_path)
    commands = "".join(re.findall(r"^```bash\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)).splitlines()
    assert len(commands) == 13
    few = [*FEW.split(), "evaluation.every=60", "evaluation.episodes=2", "checkpoint_every=60"]
    spec = importlib.util.spec_from_file_location("generalist_benchmark", script)
    module = importlib.util.module_from_spec(spec)
    sys.modules["generalist_benchmark"] = module
    spec.loader.exec_module(module)
    short = {
        "train": lambda words: train.main([*words, *(word for one in few for word in ("--set", one))]),
        "evaluate": lambda words: evaluate.main([*words, "--episodes", "2"]),
        "benchmarks/generalist.py": lambda words: module.main([*words, "--designs", "6", "--episodes", "1"]),
    }
    for command in commands:
        _, name, *words = shlex.split(command)
        assert short[name](words) == 0, command
    assert module.main(["--lost", "--designs", "2", "--episodes", "1"]) == 0
    sys.modules.pop("generalist_benchmark")
