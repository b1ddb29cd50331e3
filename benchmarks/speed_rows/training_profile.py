"""Where the wall time of a training run goes, now and before the kernels were rewritten."""

from __future__ import annotations

import importlib.util
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from agents.runs.config import TrainConfig, load_config
from agents.training.build import build_model, close
from speed_rows import machine
from speed_rows.processes import ROOT
from speed_rows.row import Peer, Row
from speed_rows.sizes import Sizes

BEFORE = Path(__file__).resolve().parents[1] / "training_before.json"

TITLE = "Where a training run spends its time"
ONCE = True
TEXT = """PPO as `rj train` builds it, without evaluations and checkpoints: the demo's configuration
(`configs/train/demo.yaml`, 16 lanes), and the same with 1,024 lanes and rollouts of 8 steps. Wall time per frame,
by what it was spent on; *environment step* holds the adapter, *wrappers* are VecMonitor and VecNormalize. The peer
is the measurement kept in `benchmarks/training_before.json`, with the command and the machine it was made on."""

CONFIGS: dict[str, list[str]] = {
    "demo, 16 lanes": [],
    "1,024 lanes": ["env.n_envs=1024", "parameters.n_steps=8", "parameters.batch_size=8192"],
}
PARTS = ("environment step", "wrappers", "rollout inference", "gradient update", "rest of Stable-Baselines3")
TOTAL = "all"


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    before = json.loads(BEFORE.read_text("utf-8"))
    for name in CONFIGS:
        if importlib.util.find_spec("stable_baselines3") is None:
            yield Row(name, None, "µs", note="stable-baselines3 is not installed")
            continue
        now, sample = profile(name, sizes)
        kept = before["profiles"][name]
        for part, value in now.items():
            peer = Peer(f"commit {before['commit']}", kept[part], _share(kept, part))
            yield Row(f"{name}: {part}, per frame", value, "µs", sample, peers=(peer,), note=_share(now, part))


def profile(name: str, sizes: Sizes) -> tuple[dict[str, float], str]:
    """Microseconds per frame by part, and all of them, of the fastest of several runs; and the sample in words."""
    config = load_config(ROOT / "configs" / "train" / "demo.yaml", CONFIGS[name])
    runs = [_profile(config, sizes.profile_updates) for _ in range(sizes.profile_repeats)]
    fastest, frames = min(runs, key=lambda run: run[0][TOTAL])
    return fastest, f"best of {len(runs)} × {frames:,} frames"


def _profile(config: TrainConfig, updates: int) -> tuple[dict[str, float], int]:
    frames = updates * config.env.n_envs * config.parameters["n_steps"]
    model = build_model(replace(config, total_timesteps=frames))
    seconds = dict.fromkeys(("wrapped step", "environment step", "rollout inference", "gradient update"), 0.0)
    _watch(model, seconds)
    begin = time.perf_counter()
    model.learn(frames)
    whole = time.perf_counter() - begin
    close(model)
    seconds["wrappers"] = seconds.pop("wrapped step") - seconds["environment step"]
    seconds["rest of Stable-Baselines3"] = whole - sum(seconds.values())
    return {part: 1e6 * ({TOTAL: whole} | seconds)[part] / frames for part in (*PARTS, TOTAL)}, frames


def keep(path: Path, sizes: Sizes, commit: str) -> None:
    """Write the profiles of this version to a file, for later comparison."""
    profiles = {name: profile(name, sizes) for name in CONFIGS}
    kept = {
        "commit": commit,
        "sources": "rollingjoint, rj_gym, agents and configs of that commit, their folder first on PYTHONPATH",
        "command": f"python benchmarks/speed.py --keep-profile benchmarks/{path.name} --commit {commit}",
        "machine": machine.in_words(),
        "unit": "µs per frame",
        "samples": {name: sample for name, (_, sample) in profiles.items()},
        "profiles": {name: parts for name, (parts, _) in profiles.items()},
    }
    path.write_text(json.dumps(kept, indent=2, ensure_ascii=False) + "\n", "utf-8")


def _watch(model: Any, seconds: dict[str, float]) -> None:
    """Let the model's parts add up the time that they take."""
    env = model.get_env()
    _clock(env, "step", "wrapped step", seconds)
    _clock(env.unwrapped, "step_wait", "environment step", seconds)
    _clock(model.policy, "forward", "rollout inference", seconds)
    _clock(model, "train", "gradient update", seconds)


def _clock(owner: Any, method: str, part: str, seconds: dict[str, float]) -> None:
    plain = getattr(owner, method)

    def clocked(*args: Any, **kwargs: Any) -> Any:
        begin = time.perf_counter()
        try:
            return plain(*args, **kwargs)
        finally:
            seconds[part] += time.perf_counter() - begin

    setattr(owner, method, clocked)


def _share(profile: Mapping[str, float], part: str) -> str:
    return f"{100.0 * profile[part] / profile[TOTAL]:.0f} % of the time"
