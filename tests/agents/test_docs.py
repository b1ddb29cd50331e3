"""The commands of docs/training.md run, in their order, with few steps."""

import re
import shlex
import sys
from pathlib import Path

import gymnasium
import pytest

from agents import evaluate, train

TEXT = Path("docs/training.md").read_text(encoding="utf-8")
FEW_STEPS = {
    "demo": "total_timesteps=40 env.n_envs=2 parameters.n_steps=20 parameters.batch_size=20",
    "ppo_rolling_joint": "total_timesteps=40 env.n_envs=2 parameters.n_steps=20 parameters.batch_size=20",
    "sac_rolling_joint": "total_timesteps=40 env.n_envs=2 parameters.learning_starts=20",
    "recurrent_ppo_instrument": "total_timesteps=40 env.n_envs=2 parameters.n_steps=20 parameters.batch_size=20",
    "distill_instrument": "total_timesteps=40 env.n_envs=2 parameters.gradient_steps=1 parameters.batch_size=2",
    "ppo_late_pose": "total_timesteps=40 env.n_envs=2 parameters.n_steps=20 parameters.batch_size=20",
    "ppo_instrument_shift": "total_timesteps=40 env.n_envs=2 parameters.n_steps=20 parameters.batch_size=20",
    "plain_ppo": "total_timesteps=40 env.n_envs=2 parameters.n_steps=20 parameters.batch_size=20",
    "apg_fixed_target": "total_timesteps=40 env.n_envs=2",
    "apg_instrument": "total_timesteps=40 env.n_envs=2",
    "config": "",
}


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, flags=re.MULTILINE | re.DOTALL)


def run(command: str) -> int:
    """Exit code of one command, shortened."""
    rj, name, *arguments = shlex.split(command)
    assert rj == "rj"
    if name == "evaluate":
        return evaluate.main([*arguments, "--episodes", "2"])
    assert name == "train"
    config = Path(arguments[0]).stem
    few = [*FEW_STEPS[config].split(), "env.settings.episode_steps=10", "evaluation.episodes=1"]
    return train.main([*arguments, *(word for override in few for word in ("--set", override))])


@pytest.mark.slow
def test_every_command_of_the_training_documentation_runs(tmp_path, monkeypatch, no_pictures):
    for name in ("configs", "docs"):
        (tmp_path / name).symlink_to(Path(name).resolve())
    for name, program in zip(("reach", "my_controller"), blocks("python"), strict=False):
        (tmp_path / f"{name}.py").write_text(program)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    commands = "".join(blocks("bash")).splitlines()
    assert len(commands) >= 7
    assert [command for command in commands if run(command) != 0] == []
    assert "Corrected" in Path("runs/demo/corrected/report.md").read_text()
    for name in ("reach", "my_controller"):
        sys.modules.pop(name)
    gymnasium.registry.pop("mine/Reach-v0")


def test_controllers_are_scored_from_python_as_the_documentation_says(capsys):
    *_, program = blocks("python")
    exec(program, {})
    rows = capsys.readouterr().out.splitlines()[2:]
    assert [row.split("  ")[0] for row in rows] == ["feedback", "open loop", "floor"]


def test_every_file_of_a_run_folder_is_in_the_documentation():
    from agents.runs import folder as run_folder

    for name in re.findall(r"^    (\S+?)/? {2,}\S", run_folder.__doc__, flags=re.MULTILINE):
        assert name in TEXT
