"""A training run that is killed, stopped or out of disk goes on as if nothing had happened."""

import csv
import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from agents import evaluate, train
from agents.evaluation.rollout import run_episodes
from agents.policies.trained import load_trained
from agents.results.runs import FinishedRun
from agents.runs.config import load_config
from agents.runs.files import RunFolderError
from agents.runs.folder import RunFolder
from agents.runs.locks import file_lock
from agents.training import checkpoint
from agents.training.callbacks import Evaluator
from agents.training.log import _Events
from tests.agents.forked import Forked

ENV = ["env.n_envs=2", "env.settings.episode_steps=10", "policy.hidden=[8]", "evaluation.every=40",
       "evaluation.episodes=2", "checkpoint_every=40"]  # fmt: skip
PPO = ["--config", "configs/train/demo.yaml", "--set", "total_timesteps=160"]
PPO += ["--set", "parameters={n_steps: 10, batch_size: 20, n_epochs: 2, learning_rate: {linear: [1e-2, 0]}}"]
HER = ["--config", "configs/train/sac_rolling_joint.yaml", "--set", "total_timesteps=160", "--set", "her={goals: 2}"]
HER += ["--set", "env.id=rj_gym/RollingJointGoal-v0", "--set", "algorithm=tqc"]
HER += ["--set", "parameters={learning_starts: 20, batch_size: 16, buffer_size: 60, gradient_steps: 2}"]
for words in (PPO, HER):
    words += [word for override in ENV for word in ("--set", override)]
PPO += ["--set", "env.settings.episode_steps=15", "--set", "env.settings.friction.mu=[0.02, 0.1]"]  # history goes on

# Kills its own process when a file of this name is about to be written for the n-th time.
KILLED_WHILE_WRITING = """
import os, signal, sys
from agents import train
from agents.training import checkpoint
from agents.runs.files import write_hashed as write
seen = []
def killing(path, content):
    seen.extend([1] if path.name == sys.argv[1] else [])
    if len(seen) == int(sys.argv[2]):
        (path.parent).mkdir(parents=True, exist_ok=True)
        path.with_name(f".{path.name}.{os.getpid()}").write_bytes(b"half a file")
        os.kill(os.getpid(), signal.SIGKILL)
    write(path, content)
checkpoint.write_hashed_bytes = lambda path, content: killing(path, lambda stream: stream.write(content))
train.main(sys.argv[3:])
"""


def killed_after(line: str, arguments: list[str]) -> None:
    """Start training and send SIGKILL when it has printed this."""
    command = [sys.executable, "-m", "agents.train", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        for printed in child.stdout:
            if line in printed:
                child.kill()
    assert child.returncode == -signal.SIGKILL


def weights(run: Path, which: str = "policy.zip") -> bytes:
    with zipfile.ZipFile(run / which) as archive:
        return archive.read("policy.pth")


def columns(run: Path, *names: str) -> list[tuple[str, ...]]:
    rows = list(csv.DictReader((run / "logs" / "progress.csv").read_text().splitlines()))
    return [tuple(row.get(name, "") for name in names) for row in rows]


def events(run: Path) -> list[int]:
    """Steps of the training reward in TensorBoard."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    log = EventAccumulator(str(run / "logs"))
    log.Reload()
    return [event.step for event in log.Scalars("rollout/ep_rew_mean")]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, Path]:
    """Runs that nothing interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    for name, words in (("ppo", PPO), ("her", HER)):
        assert train.main([*words, "--run-dir", str(folder / name)]) == 0
    return {"ppo": folder / "ppo", "her": folder / "her"}


@pytest.mark.slow  # a run that a signal stops, below, takes less time
@pytest.mark.parametrize(("name", "words"), [("ppo", PPO), ("her", HER)])
def test_a_killed_run_goes_on_to_the_same_weights_and_logs(name, words, whole, tmp_path, capsys):
    run = tmp_path / "run"
    file = {"ppo": "training.safetensors", "her": "replay_buffer.safetensors"}[name]
    command = [sys.executable, "-c", KILLED_WHILE_WRITING, file, "2", *words, "--run-dir", str(run)]
    assert Forked(command, stdout=subprocess.DEVNULL).wait() == -signal.SIGKILL
    assert sorted(path.name for path in run.glob("checkpoints/*")) == [".000000080", "000000040"]
    if name == "ppo":
        killed_after("120 steps: mean", ["--resume", str(run)])
    assert train.main(["--resume", str(run)]) == 0
    assert "from step" in capsys.readouterr().out
    assert weights(run) == weights(whole[name])
    assert weights(run, "best/policy.zip") == weights(whole[name], "best/policy.zip")
    assert (run / "evaluations.csv").read_text() == (whole[name] / "evaluations.csv").read_text()
    seconds = [float(value) for (value,) in columns(run, "time/processor_seconds") if value]
    assert seconds == sorted(seconds) and seconds[0] > 0  # goes on where the interrupted process had come to
    logged = ["time/total_timesteps", "time/iterations", "rollout/ep_rew_mean", "train/loss", "evaluation/mean_mm"]
    assert columns(run, *logged) == columns(whole[name], *logged)
    assert len(set(events(run))) == len(events(run)) > 1
    assert events(run) == events(whole[name])
    assert not list(run.rglob(".*"))
    assert len((run / "command.txt").read_text().splitlines()) == (3 if name == "ppo" else 2)


@pytest.mark.slow
def test_a_run_killed_before_its_first_checkpoint_begins_anew(whole, tmp_path):
    run = RunFolder.create(tmp_path / "run", RunFolder.open(whole["ppo"]).config(), ["typed"])
    run.logs.mkdir()
    run.evaluations.write_text("steps,mean_mm,median_mm,p95_mm,mean_reward\n20,0.001,0,0,0\n")
    assert train.main(["--resume", str(run.path)]) == 0
    assert weights(run.path) == weights(whole["ppo"])
    assert run.evaluations.read_text() == (whole["ppo"] / "evaluations.csv").read_text()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "words"), [("ppo", PPO), ("her", HER)])
def test_a_run_stopped_by_a_signal_goes_on_to_the_same_weights(name, words, whole, tmp_path, monkeypatch, capsys):
    run, evaluate = tmp_path / "run", Evaluator.evaluate
    with monkeypatch.context() as patch:
        patch.setattr(Evaluator, "evaluate", lambda self: os.kill(os.getpid(), signal.SIGTERM) or evaluate(self))
        patch.setattr(Evaluator, "_on_training_end", lambda self: None)
        assert train.main([*words, "--run-dir", str(run)]) == 128 + signal.SIGTERM
    assert f"--resume {run}" in capsys.readouterr().out
    assert train.main(["--resume", str(run)]) == 0
    assert weights(run) == weights(whole[name])
    assert (run / "evaluations.csv").read_text() == (whole[name] / "evaluations.csv").read_text()


OFF_POLICY = "learning_starts: 20, batch_size: 16, buffer_size: 60, gradient_steps: 2"
OTHERS = {
    "sac": f"algorithm=sac parameters={{{OFF_POLICY}, use_sde: true, n_steps: 2}}",
    "crossq": f"algorithm=crossq parameters={{{OFF_POLICY.replace('20', '60')}}} env.id=rj_gym/LatePose-v0",
    "recurrent": "algorithm=recurrent_ppo policy.memory=8 policy.critic=privileged env.id=rj_gym/InstrumentShift-v0 "
    "parameters={n_steps: 8, batch_size: 16, n_epochs: 1}",
    "arm": "env.id=rj_gym/ArmInstrument-v0 env.settings.randomization.stiffness_spread=0.1 "
    "parameters={n_steps: 8, batch_size: 16, n_epochs: 1, use_sde: true}",
    "design": "env.id=rj_gym/CurvatureDesign-v0 parameters={n_steps: 8, batch_size: 16, n_epochs: 1}",
}


@pytest.mark.slow
@pytest.mark.parametrize("changes", OTHERS.values(), ids=OTHERS)
def test_a_stopped_run_of_any_algorithm_and_task_goes_on_to_the_same_weights(changes, tmp_path, monkeypatch):
    small = [*ENV, "total_timesteps=120", *re.split(r" (?=[\w.]+=)", changes)]
    begin = ["--config", "configs/train/demo.yaml", *(word for each in small for word in ("--set", each)), "--run-dir"]
    begin[2:2] = ["--set", "env.file=null", "--set", "env.settings={}"]
    assert train.main([*begin, str(tmp_path / "whole")]) == 0
    evaluation = Evaluator.evaluate
    with monkeypatch.context() as patch:
        patch.setattr(Evaluator, "evaluate", lambda self: os.kill(os.getpid(), signal.SIGTERM) or evaluation(self))
        patch.setattr(Evaluator, "_on_training_end", lambda self: None)
        assert train.main([*begin, str(tmp_path / "stopped")]) == 128 + signal.SIGTERM
    assert train.main(["--resume", str(tmp_path / "stopped")]) == 0
    assert weights(tmp_path / "stopped") == weights(tmp_path / "whole")
    scores = [(tmp_path / name / "evaluations.csv").read_text() for name in ("stopped", "whole")]
    assert scores[0] == scores[1]


def test_a_policy_that_learned_by_hindsight_loads_and_scores_as_it_did_in_training(whole):
    run = RunFolder.open(whole["her"])
    evaluation = run.config().evaluation
    seeds = range(evaluation.seed, evaluation.seed + evaluation.episodes)
    scored = run_episodes(run.config().env, load_trained(run, "last"), seeds).final_errors.mean()
    rows = list(csv.DictReader(run.evaluations.read_text().splitlines()))
    assert scored == pytest.approx(float(rows[-1]["mean_mm"]), rel=1e-5)


def test_only_the_newest_two_checkpoints_keep_what_resuming_needs(whole):
    folders = sorted((whole["her"] / "checkpoints").iterdir())
    assert [folder.name for folder in folders] == [f"{steps:09d}" for steps in (40, 80, 120, 160)]
    assert [(folder / "resume").exists() for folder in folders] == [False, False, True, True]
    assert all((folder / "policy.zip").is_file() and (folder / "normaliser.pkl").is_file() for folder in folders)
    assert checkpoint.newest(RunFolder.open(whole["her"])) == folders[-1]


def flip_a_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def files_of(checkpoint: Path) -> list[str]:
    return [str(path.relative_to(checkpoint)) for path in sorted(checkpoint.rglob("*")) if path.is_file()]


@pytest.mark.parametrize(("name", "words"), [("ppo", PPO), ("her", HER)])
def test_a_damaged_newest_checkpoint_costs_one_interval(name, words, whole, tmp_path, capsys):
    run = shutil.copytree(whole[name], tmp_path / "run")
    for file in ("policy.safetensors", "policy.zip", "normaliser.pkl"):
        (run / file).unlink()
    flip_a_bit(run / "checkpoints/000000160/resume/training.safetensors")
    (run / "checkpoints/notes").mkdir()
    assert train.main(["--resume", str(run)]) == 0
    said = capsys.readouterr()
    assert "training.safetensors is damaged: from step 120 on, 40 steps are lost and done again" in said.err
    assert "from step 120 on" in said.out
    assert weights(run) == weights(whole[name])
    assert (run / "evaluations.csv").read_text() == (whole[name] / "evaluations.csv").read_text()
    names = {path.name for path in run.glob("checkpoints/*")}
    assert names == {"000000040", "000000080", "000000120", "000000160", "damaged-000000160", "notes"}
    assert train.main(["--resume", str(run)]) == 0
    assert "finished" in capsys.readouterr().out


def test_a_damaged_file_of_a_checkpoint_is_noticed_whichever_it_is(whole, tmp_path):
    folder = shutil.copytree(whole["her"] / "checkpoints/000000160", tmp_path / "checkpoints/000000160")
    assert checkpoint.damaged_file(folder) is None
    names = files_of(folder)
    assert {"resume/replay_buffer.safetensors", "resume/best/policy.zip", "resume/progress.csv"} < set(names)
    for name in names:
        content = (folder / name).read_bytes()
        flip_a_bit(folder / name)
        assert str(checkpoint.damaged_file(folder)) == str(folder / name).removesuffix(".sha256")
        (folder / name).write_bytes(content[:-1])
        if not name.endswith(".sha256"):  # its last byte ends the line
            assert checkpoint.damaged_file(folder) == folder / name
            (folder / name).unlink()
            assert checkpoint.damaged_file(folder) == folder / name
        (folder / name).write_bytes(content)
    assert checkpoint.damaged_file(folder) is None


def test_a_run_whose_checkpoints_are_all_damaged_ends_with_one_line_and_stays_as_it_is(whole, tmp_path, capsys):
    run = shutil.copytree(whole["ppo"], tmp_path / "run")
    for steps in (120, 160):
        flip_a_bit(run / f"checkpoints/{steps:09d}/resume/training.safetensors")
    before = files_of(run)
    assert train.main(["--resume", str(run)]) == 2
    error = capsys.readouterr().err
    assert "000000160/resume/training.safetensors" in error and "--run-dir NEW" in error
    assert error.count("\n") == 1
    assert files_of(run) == before


@pytest.mark.parametrize(
    "name",
    ["config.yaml", "command.txt", "seeds.json", "versions.json", "policy.safetensors", "policy.zip", "normaliser.pkl",
     "best/policy.safetensors", "best/policy.zip", "best/normaliser.pkl"],
)  # fmt: skip
def test_a_flipped_bit_in_a_run_folder_is_refused_with_one_line(name, whole, tmp_path, capsys):
    run = shutil.copytree(whole["ppo"], tmp_path / "run")
    flip_a_bit(run / name)
    which = "best" if name.startswith("best") else "last"
    assert evaluate.main([str(run), "--policy", which]) == 2
    error = capsys.readouterr().err
    assert str(run / name) in error and f"delete {Path(name).name}.sha256" in error
    assert error.count("\n") == 1


def test_a_policy_that_is_damaged_during_training_goes_into_no_checkpoint(whole, tmp_path, monkeypatch, capsys):
    run, save = tmp_path / "run", checkpoint.save

    def damaged(model, folder):
        if model.num_timesteps == 80:
            flip_a_bit(run / "best/policy.zip")
        return save(model, folder)

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "save", damaged)
        assert train.main([*PPO, "--run-dir", str(run)]) == 2
    error = capsys.readouterr().err
    assert "best/policy.zip" in error and "From step 40 on" in error
    assert error.count("\n") == 1
    assert train.main(["--resume", str(run)]) == 0
    assert weights(run, "best/policy.zip") == weights(whole["ppo"], "best/policy.zip")


@pytest.mark.parametrize("name", ["evaluations.csv", "logs/progress.csv"])
def test_a_flipped_bit_in_a_table_of_a_finished_run_is_refused(name, whole, tmp_path):
    run = shutil.copytree(whole["ppo"], tmp_path / "run")
    assert FinishedRun.read(run).seconds > 0
    flip_a_bit(run / name)
    with pytest.raises(RunFolderError, match=f"{name}.*delete {Path(name).name}.sha256"):
        FinishedRun.read(run)


def test_a_finished_run_says_so_and_stays_as_it_is(whole, capsys):
    before = {path: path.stat().st_mtime_ns for path in whole["ppo"].rglob("*") if path.name != "lock"}
    assert train.main(["--resume", str(whole["ppo"])]) == 0
    assert "finished: 160 steps" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in whole["ppo"].rglob("*") if path.name != "lock"} == before


def test_a_longer_run_equals_a_finished_one_that_was_extended(tmp_path):
    constant = [*PPO, "--set", "parameters.learning_rate=0.01"]
    assert train.main([*constant, "--run-dir", str(tmp_path / "long")]) == 0
    assert train.main([*constant, "--run-dir", str(tmp_path / "short"), "--set", "total_timesteps=100"]) == 0
    assert train.main(["--resume", str(tmp_path / "short"), "--set", "total_timesteps=160"]) == 0
    assert weights(tmp_path / "short") == weights(tmp_path / "long")
    assert load_config(tmp_path / "short" / "config.yaml").total_timesteps == 160


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (["--set", "seed=3"], "total_timesteps=N and nothing else"),
        (["--set", "total_timesteps=200", "--set", "parameters.gamma=0.5"], "total_timesteps=N and nothing else"),
        (["--set", "total_timesteps=100"], "no fewer than the 160 steps"),
        (["--force"], "no --force"),
        (["--run-dir", "elsewhere"], "no --run-dir"),
    ],
)
def test_resuming_changes_nothing_but_the_number_of_steps(extra, words, whole, capsys):
    assert train.main(["--resume", str(whole["ppo"]), *extra]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_a_run_without_a_checkpoint_but_with_a_policy_is_not_begun_anew(tmp_path, capsys):
    run = RunFolder.create(tmp_path / "run", load_config("configs/train/demo.yaml"), [])
    (run.path / "policy.zip").write_bytes(b"precious")
    assert train.main(["--resume", str(run.path)]) == 2
    assert "--force" in capsys.readouterr().err
    assert (run.path / "policy.zip").read_bytes() == b"precious"


@pytest.mark.parametrize("name", ["training.pkl", "training.safetensors"])
def test_a_checkpoint_that_cannot_be_read_ends_with_one_line(name, whole, tmp_path, capsys):
    run = RunFolder.create(tmp_path / "run", RunFolder.open(whole["ppo"]).config(), [])
    (run.checkpoints / "000000040" / "resume").mkdir(parents=True)
    (run.checkpoints / "000000040" / "resume" / name).write_bytes(b"no such file")
    assert train.main(["--resume", str(run.path), "--trust"]) == 2
    error = capsys.readouterr().err
    assert "000000040" in error
    assert error.count("\n") == 1


def test_two_trainings_in_one_folder_are_refused(whole, tmp_path, capsys):
    again = ["--config", str(whole["ppo"] / "config.yaml"), "--run-dir", str(whole["ppo"]), "--force"]
    before = (whole["ppo"] / "policy.zip").read_bytes()
    with file_lock(whole["ppo"] / "lock"):
        for arguments in (["--resume", str(whole["ppo"])], again):
            assert train.main(arguments) == 2
            error = capsys.readouterr().err
            assert "in which no training runs" in error
            assert error.count("\n") == 1
    assert (whole["ppo"] / "policy.zip").read_bytes() == before
    assert [path.name for path in whole["ppo"].parent.iterdir() if "ppo" in path.name] == ["ppo"]


@pytest.mark.slow
@pytest.mark.parametrize("number", [16, 17, 24, 40, 54])
def test_a_full_disk_ends_with_one_line_and_leaves_a_run_that_goes_on(number, whole, tmp_path, monkeypatch, capsys):
    run, written, fsync = tmp_path / "run", [], os.fsync

    def full(descriptor):
        written.append(descriptor)
        if len(written) >= number:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        assert train.main([*PPO, "--run-dir", str(run)]) == 2
    error = capsys.readouterr().err
    assert "No space left" in error
    assert error.count("\n") == 1
    assert not list(run.rglob(".*"))
    assert train.main(["--resume", str(run)]) == 0
    assert weights(run) == weights(whole["ppo"])


def test_a_full_disk_before_training_leaves_no_run_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(os, "fsync", lambda descriptor: (_ for _ in ()).throw(OSError(errno.ENOSPC, "No space left")))
    assert train.main([*PPO, "--run-dir", str(tmp_path / "run")]) == 2
    assert "No space left" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


LIMITED = """
import resource, sys
from agents import train
from agents.training import checkpoint
save = checkpoint.save
def limited(model, run):
    done = save(model, run)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
    return done
checkpoint.save = limited
sys.exit(train.main(sys.argv[2:]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("limit", ["100", "20000"])
def test_files_that_may_not_grow_end_training_with_one_line(limit, whole, tmp_path):
    """After the first checkpoint no file may exceed the limit: logs and tables (100), or the next policy (20000)."""
    run = tmp_path / "run"
    command = [sys.executable, "-c", LIMITED, limit, *PPO, "--run-dir", str(run)]
    child = subprocess.run(command, capture_output=True, text=True)
    assert child.returncode == 2
    assert "File too large" in child.stderr
    assert "--resume" in child.stderr
    assert child.stderr.count("\n") == 1
    assert train.main(["--resume", str(run)]) == 0
    assert weights(run) == weights(whole["ppo"])


def test_the_events_of_a_later_writer_are_read_later(tmp_path):
    for steps in (0, 40, 80):
        _Events(tmp_path, steps).writer.close()
    seconds = [int(path.name.split(".")[3]) for path in tmp_path.iterdir()]
    assert len(set(seconds)) == 3
