"""Run folders for tests: short runs of several learners and tasks, and folders that are no finished runs."""

import shutil
from pathlib import Path

from agents import train
from agents.runs.files import hash_file

COMMON = ["total_timesteps=80", "env.n_envs=2", "env.settings.episode_steps=12", "policy.hidden=[8]",
          "evaluation.every=40", "evaluation.episodes=2", "normalise.reward=false"]  # fmt: skip
RECIPES = {
    "ppo_near": ["parameters={n_steps: 20, batch_size: 40, n_epochs: 1}"],
    "sac_near": [
        "algorithm=sac",
        "parameters={learning_starts: 20, batch_size: 8}",
        "env.settings.reward.effort=0",
        "env.id=rj_gym/RollingJointGoal-v0",
    ],
    "apg_drift": [
        "algorithm=apg",
        "parameters={}",
        "policy={memory: 4}",
        "env={id: rj_gym/Instrument-v0, n_envs: 2, settings: {episode_steps: 12, observe_history: 1}}",
        "env.settings.load.process=ou",
        "env.settings.randomization={link_tolerance_mm: 0, link_tolerance_rad: 0, stiffness_spread: 0}",
    ],
    "ppo_reach": [
        "parameters={n_steps: 20, batch_size: 40, n_epochs: 1}",
        "env={id: rj_gym/FlexibleArm-v0, n_envs: 2, settings: {mechanism: small_arm, episode_steps: 12}}",
    ],
}
SEEDS = {"ppo_near": (1, 2), "sac_near": (1, 2), "apg_drift": (3,), "ppo_reach": (4,)}


def train_all(folder: Path) -> None:
    """Finished runs, one that is not finished, one whose policy is damaged, one of which nothing but files is left."""
    for name, overrides in RECIPES.items():
        for seed in SEEDS[name]:
            words = [word for text in [*COMMON, *overrides, f"seed={seed}"] for word in ("--set", text)]
            out = str(folder / name / f"seed_{seed}")
            assert train.main(["--config", "configs/train/demo.yaml", "--run-dir", out, *words]) == 0
    for broken in ("unfinished", "damaged", "empty"):
        shutil.copytree(folder / "ppo_near/seed_1", folder / broken / "seed_9")
    shutil.rmtree(folder / "unfinished/seed_9/checkpoints")
    (folder / "damaged/seed_9/best/policy.zip").write_bytes(b"PK")
    (folder / "empty/seed_9/config.yaml").write_text("algorithm: [")
    hash_file(folder / "empty/seed_9/config.yaml").unlink()
    shutil.copytree(folder / "ppo_near/seed_1", folder / "second/seed_1")
    (folder / "command.txt").write_text("python -m agents.campaign list.yaml\n")
