"""Mechanism files, run folders and shipped policies of the older checkout, read. Runs inside a checkout."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml

from guard_rows.drawing import ARM_KINDS, KINDS, Sizes, arm_cases, planar_cases
from guard_rows.record import Record
from rollingjoint.errors import RollingJointError
from rollingjoint.io.mechanism_file import dump_mechanism, load_mechanism

RUNS = {"instrument": "rj_gym/Instrument-v0", "arm": "rj_gym/FlexibleArm-v0"}
_SHORT = (
    "total_timesteps=80",
    "parameters={n_steps: 20, batch_size: 40, n_epochs: 1}",
    "env.n_envs=2",
    "env.file=null",
    "evaluation={every: 40, episodes: 2}",
    "checkpoint_every=40",
)
_OBSERVATIONS = 5
_PATIENCE = 600.0  # s that the newer checkout waits for the older one's run folders


def records(sizes: Sizes, older: Path, out: Path) -> Iterator[Record]:
    """Records of all kinds of files."""
    yield _mechanisms(sizes, older)
    yield _dumps(sizes)
    if sizes.runs:
        yield _run_folders(older, out)
    yield _policies(sizes, older)


def _mechanisms(sizes: Sizes, older: Path) -> Record:
    """The files of configs/, as they are written again."""
    record = Record("mechanism files")
    for path in sorted((older / "configs" / "mechanism").glob("*.yaml")):
        record.add(path.name, {"content": dump_mechanism(load_mechanism(path))})
    record.count = len(record.arrays)
    return record


def _dumps(sizes: Sizes) -> Record:
    """Drawn mechanisms through a file and back; of one that is refused, the message."""
    record = Record("mechanisms written and read")
    cases = [case for kind in KINDS for case in planar_cases(kind, sizes.links[:8])]
    cases += [case for kind in ARM_KINDS for case in arm_cases(kind, min(2, sizes.arms))]
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        path = Path("drawn.yaml")
        for case in cases:
            path.write_text(yaml.safe_dump(case.mechanism), "utf-8")
            try:
                text = dump_mechanism(load_mechanism(path))
                path.write_text(text, "utf-8")
                assert dump_mechanism(load_mechanism(path)) == text
            except RollingJointError as error:
                text = str(error)
            record.add(case.name, {"content": text})
    record.count = len(record.arrays)
    return record


def _run_folders(older: Path, out: Path) -> Record:
    """Short runs of the older checkout: their policies' actions, and what rj evaluate says of them."""
    from agents.shipped import load_policy

    made = out.parent / "runs"
    if out.name == "before":
        for name, env_id in RUNS.items():
            words = [word for each in (*_SHORT, f"env.id={env_id}") for word in ("--set", each)]
            _train(older, [*words, "--run-dir", str(made / name)])
        (made / "done").touch()
    _wait_for(made / "done")
    record = Record("run folders")
    for name in RUNS:
        run = made / name
        policy = load_policy(run / "best" / "policy.safetensors")
        seen = np.random.default_rng(0).normal(size=(_OBSERVATIONS, len(policy.entries)))
        record.add(name, {"actions": policy(seen), "report": _evaluated(run, out / f"evaluation-{name}")})
    record.count = len(RUNS)
    return record


def _train(older: Path, words: list[str]) -> None:
    command = [sys.executable, "-m", "agents.train", "--config", str(older / "configs/train/demo.yaml"), *words]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def _wait_for(path: Path) -> None:
    end = time.monotonic() + _PATIENCE
    while not path.exists():
        if time.monotonic() > end:
            raise SystemExit("the older checkout has made no run folders")
        time.sleep(0.5)


def _evaluated(run: Path, out: Path) -> str:
    """The table that the command prints, without its last lines, which name folders."""
    from agents import evaluate

    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        code = evaluate.main([str(run), "--episodes", "2", "--out", str(out)])
    return f"exit code {code}\n" + said.getvalue().replace(str(out), "OUT").replace(str(run), "RUN")


def _policies(sizes: Sizes, older: Path) -> Record:
    """The older checkout's shipped policies: their hash, and actions on observations."""
    from agents.shipped import list_policies, load_policy

    record = Record("shipped policies: files")
    for path in sorted((older / "agents" / "policies").glob("*.safetensors"))[: None if sizes.runs else 2]:
        policy = load_policy(path)
        seen = np.random.default_rng(0).normal(size=(_OBSERVATIONS, len(policy.entries)))
        about = {"sha256": policy.sha256, "entries": ", ".join(policy.entries), "shipped": path.stem in list_policies()}
        record.add(path.stem, {"actions": policy(seen), **about})
    record.count = len(record.arrays)
    return record
