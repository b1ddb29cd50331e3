"""SIGKILL at any moment of train, tune, search and campaign: they go on and end as what nothing interrupted.

Processes are forked from this one, which has imported everything and started no threads; each has a session of its own,
so that a campaign dies with all it has started.
"""

import contextlib
import gc
import json
import multiprocessing
import os
import shutil
import tempfile
import time
import zipfile
from multiprocessing.connection import Connection
from pathlib import Path

from tests.attack.child import Child

ROOT = Path(__file__).resolve().parents[2]
TRAIN = ["--config", str(ROOT / "configs/train/demo.yaml")]
for each in ("total_timesteps=400", "env.n_envs=2", "env.settings.episode_steps=10", "policy.hidden=[8]",
             "evaluation.every=40", "evaluation.episodes=2", "checkpoint_every=40",
             "parameters={n_steps: 10, batch_size: 20, n_epochs: 2, learning_rate: {linear: [1e-2, 0]}}"):  # fmt: skip
    TRAIN += ["--set", each]
INTERVAL = 40  # steps between checkpoints
_CAMPAIGN_RUN = """algorithm: ppo
total_timesteps: 200
env: {n_envs: 2, settings: {episode_steps: 10}}
parameters: {n_steps: 10, batch_size: 20, n_epochs: 1}
policy: {hidden: [8]}
evaluation: {every: 1000, episodes: 2}
checkpoint_every: 20
"""
_STUDY = f"""config: {ROOT}/configs/train/demo.yaml
set:
  {{total_timesteps: 80, env.n_envs: 2, env.settings.episode_steps: 10, parameters.n_steps: 10,
   parameters.batch_size: 20, parameters.n_epochs: 1, policy.hidden: [8], evaluation.every: 40}}
space:
  parameters.gamma: {{low: 0.5, high: 0.99}}
  policy.hidden: {{choices: [[4], [8, 8]]}}
episodes: 2
startup: 2
trials: 4
"""
_SEARCH = """space: {knots: 3}
objectives:
  - {kind: lateral_stiffness, tensions: [[5, 5]]}
limits:
  - {kind: tendon_travel, cases: 3, high: reference}
methods:
  METHOD
budget: 200
seeds: [1]
"""
_METHODS = ("random: {batch: 10}", "cma_es: {population: 10}", "gradient: {starts: 5}")
MOST_KILLS = 12  # of one run, before it may end


def attack(rng, report):
    """One command, killed again and again, against one that nothing interrupted."""
    kind = ("train", "search", "tune", "campaign")[report.round % 4]
    with tempfile.TemporaryDirectory(prefix="attack-") as folder:
        _KINDS[kind](rng, report, Path(folder))


def _interrupted(rng, report, kind, start, log, check=lambda: None, most=MOST_KILLS):
    """Start it and kill it at random moments until it has been killed often enough; then let it end."""
    kills, longest = 0, 2.0
    for _ in range(3 * most + 1):
        child = Child(start, log)
        begin = time.monotonic()
        if kills == most:
            if not child.wait(300.0):
                child.kill()
                report.fail(f"{kind}: does not end")
            break
        if child.wait(float(rng.uniform(0.0, 1.0)) ** 1.5 * longest):
            longest = max(0.2, 0.7 * (time.monotonic() - begin))
            break
        if child.kill():
            kills += 1
            report.count("kills")
            report.count(f"kills: {kind}")
            check()
    text = log.read_text("utf-8", "replace")
    if "Traceback" in text:
        report.fail(f"{kind}: a traceback: {text[text.index('Traceback') :][-400:]}")
    if child.code != 0:
        report.fail(f"{kind}: exit code {child.code} after {kills} kills: {text[-300:]}")
        return False
    report.count(f"runs compared after kills: {kind}")
    return True


def _train(rng, report, folder):
    from agents import train

    run, log = folder / "run", folder / "log"
    progress = [0]

    def start():
        begun = (run / "config.yaml").exists()
        return train.main(["--resume", str(run)] if begun else [*TRAIN, "--run-dir", str(run), "--force"])

    def check():
        reached = _steps_of_checkpoints(run)
        if reached < progress[0]:
            report.fail(f"train: checkpoint {progress[0]} is gone, the newest is {reached}")
        printed = [int(line.split()[0]) for line in log.read_text().splitlines() if line[:1].isdigit()]
        if printed and max(printed) - reached > INTERVAL + 20:
            report.fail(f"train: {max(printed)} steps were done, the newest checkpoint has {reached}")
        progress[0] = reached

    if _interrupted(rng, report, "train", start, log, check):
        whole = _whole_training()
        _equal_files(report, "train", _weights(run), _weights(whole))
        _equal_files(report, "train", (run / "evaluations.csv").read_bytes(), (whole / "evaluations.csv").read_bytes())


def _steps_of_checkpoints(run):
    return max((int(path.name) for path in (run / "checkpoints").glob("[0-9]*")), default=0)


def _weights(run):
    with zipfile.ZipFile(run / "policy.zip") as archive:
        return archive.read("policy.pth")


def _equal_files(report, kind, one, other):
    if one != other:
        report.fail(f"{kind}: what went on differs from what nothing interrupted")


def _tune(rng, report, folder):
    from agents import tune
    from agents.evaluation import output
    from agents.tuning import report as page
    from agents.tuning.journal import journal_storage

    for module, names in ((output, ("film", "animation")), (page, ("history", "parameters"))):
        for name in names:
            if hasattr(module, name):
                setattr(module, name, lambda *_: b"")  # pictures take longer than the trials
    (folder / "study.yaml").write_text(_STUDY)
    study, log = folder / "study", folder / "log"

    def start():
        begun = ["--study", str(study)] if (study / "study.yaml").exists() else []
        return tune.main(begun or ["--config", str(folder / "study.yaml"), "--study", str(study)])

    done = {}

    def check():
        now = _complete_trials(journal_storage, study)
        if not done.items() <= now.items():
            report.fail("tune: a trial that was finished is gone or another")
        done.update(now)

    if _interrupted(rng, report, "tune", start, log, check, most=6):  # a trial that is killed twice is given up
        check()
        ends = [_end(trial) for trial in _trials(journal_storage, study)]
        report.count("trials that were pruned or killed twice", ends.count("PRUNED") + ends.count("killed twice"))
        if sum(end in ("COMPLETE", "PRUNED", "killed twice") for end in ends) != 4:
            report.fail(f"tune: not every one of 4 trials has ended: {ends}")


def _end(trial):
    """How a trial ended."""
    reason = str(trial.user_attrs.get("reason", ""))
    return "killed twice" if reason.endswith("twice") else f"{trial.state.name} {reason}".strip()


def _complete_trials(journal_storage, study):
    """Values by number of the trials that are complete."""
    complete = [trial for trial in _trials(journal_storage, study) if trial.state.name == "COMPLETE"]
    return {trial.number: (json.dumps(trial.params, sort_keys=True), trial.value) for trial in complete}


def _trials(journal_storage, study):
    import optuna

    if not (study / "journal.log").exists():
        return []
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    with contextlib.suppress(KeyError):  # no study yet
        return optuna.load_study(study_name="study", storage=journal_storage(study / "journal.log")).get_trials()
    return []


def _search(rng, report, folder):
    from agents.search.config import load_search
    from agents.search.folder import SearchRun
    from agents.search.run import search_in

    method = _METHODS[rng.integers(len(_METHODS))]
    (folder / "search.yaml").write_text(_SEARCH.replace("METHOD", method))
    (config,) = load_search(folder / "search.yaml").runs()

    def run(name):
        def start():
            SearchRun.begin(folder / name, config, ["typed"])
            search_in(folder / name)
            return 0

        return start

    journal, seen = folder / "run" / "evaluations.jsonl", [0]

    def check():
        lines = journal.read_bytes().count(b"\n") if journal.exists() else 0
        if lines < seen[0]:
            report.fail(f"search: {seen[0]} batches were on the disk, {lines} are")
        seen[0] = lines

    if _interrupted(rng, report, f"search {method.split(':')[0]}", run("run"), folder / "log", check):
        whole = Child(run("whole"), folder / "log")
        whole.wait(300.0)
        one, other = (_without_seconds(folder / name / "evaluations.jsonl") for name in ("run", "whole"))
        _equal_files(report, "search", one, other)


def _without_seconds(journal):
    return [{**json.loads(line), "seconds": 0} for line in journal.read_text().splitlines()]


def _campaign(rng, report, folder):
    from agents import campaign as command
    from agents import train
    from agents.executors import local

    (folder / "near.yaml").write_text(_CAMPAIGN_RUN)
    (folder / "list.yaml").write_text("runs:\n  - {config: near.yaml, seeds: [1, 2]}\n")
    out, serve = folder / "out", local.serve

    def alone_with_pipe(pipe):
        """Serve, without the other ends of pipes that a fork inherits: while they are open no pipe ends."""
        for one in gc.get_objects():
            if isinstance(one, Connection) and one is not pipe:
                one.close()
        serve(pipe)

    def start():
        forked = multiprocessing.get_context("fork")
        local.get_context, os.setsid = lambda _: forked, lambda: None  # workers begin at once, and die with it
        local.serve = alone_with_pipe
        return command.main([str(folder / "list.yaml"), "--out", str(out), "--jobs", "2"])

    if _interrupted(rng, report, "campaign", start, folder / "log"):
        for seed in (1, 2):
            words = ["--config", str(folder / "near.yaml"), "--set", f"seed={seed}", "--run-dir", str(folder / "alone")]
            alone = Child(lambda words=words: train.main([*words, "--force"]), folder / "log")
            alone.wait(300.0)
            _equal_files(report, "campaign", _weights(out / f"near/seed_{seed}"), _weights(folder / "alone"))
            shutil.rmtree(folder / "alone")


_KINDS = {"train": _train, "tune": _tune, "search": _search, "campaign": _campaign}
_finished = []


def _whole_training():
    """The folder of the training that nothing interrupted, made once per process in a forked one."""
    if not _finished:
        from agents import train

        keep = Path(tempfile.mkdtemp(prefix="attack-run-"))
        child = Child(lambda: train.main([*TRAIN, "--run-dir", str(keep / "run")]), keep / "log")
        child.wait(300.0)
        _finished.append(keep / "run")
        import atexit

        owner = os.getpid()
        atexit.register(lambda: os.getpid() == owner and shutil.rmtree(keep, ignore_errors=True))
    return _finished[0]


def _preload():
    """Import what the commands import, before anything is forked."""
    import agents.training.learn
    import agents.tuning.trials  # noqa: F401


_preload()
