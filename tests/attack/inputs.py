"""Files and command lines that are damaged or made up: each is read, or refused in one line, within seconds."""

import contextlib
import io
import json
import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
import yaml

from agents.policies.file import pack, unpack
from agents.policies.loading import FOLDER, load_policy
from agents.results.runs import FinishedRun
from agents.runs.config import load_config
from agents.runs.folder import RunFolder
from agents.search.config import load_search
from agents.training.campaign import load_campaign
from agents.tuning.study import load_study
from rj_gym.registry import settings_of
from rollingjoint import RollingJointError
from rollingjoint.cli import main as rj
from rollingjoint.io.mechanism_file import load_mechanism
from tests.attack import found, structures

ROOT = Path(__file__).resolve().parents[2]
READERS = {
    "mechanism": load_mechanism,
    "train": load_config,
    "campaign": load_campaign,
    "tune": load_study,
    "search": load_search,
}
found.READERS.update({**READERS, "policy": load_policy})
_TEXTS = (
    "null", "true", "-1", "0", "1e400", ".nan", "-.inf", "1" * 5000, "[]", "{}", "[[[[[[]]]]]]", "'x'", "!!int abc",
    "!!python/object:os.system x", "*a", "&a [*a]", "2001-13-45", "\x00", "\ud800".encode("utf-8", "replace").decode(),
    "<<: *a", "? [1]", "!!binary x", "~", "0x1F", "1_000", "9" * 300, "é", "\u2028", "- - - - -", "|", ">", "@", "%x",
)  # fmt: skip
_WORDS = (
    "solve", "plot", "export", "mechanisms", "loop", "identify", "five_link", "small_arm", "uniform", "--tensions",
    "--lengths", "--load", "--force", "--body-force", "--moment", "--spring", "--torsion-spring", "--gravity", "--json",
    "--plot", "--out", "--start", "--friction", "1", "-1", "0", "5,5", "5", "nan", "inf", "1e300", "-1e-320", "x", "",
    "\x00", "é", "/", ".", "..", "/dev/null", "out.png", "--", "-", "--help", "99999999999",
)  # fmt: skip


def attack(rng, report):
    """Some hundred inputs of every kind."""
    structures.attack(rng, report)
    with tempfile.TemporaryDirectory(prefix="attack-") as folder, _inside(folder):
        for one, times in COUNTS.items():
            for _ in range(times):
                one(rng, report, Path(folder))


@contextlib.contextmanager
def _inside(folder):
    before = Path.cwd()
    shutil.copytree(ROOT / "configs", Path(folder) / "configs")
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def tried(report, what, call, changed=lambda value: False, path=None):
    """Call it; only our own errors and OSError may come out, with messages of one line.

    changed: whether what was read should have been refused; path: the file that it reads.
    """
    report.count("inputs")
    report.count(f"inputs: {what}")
    with report.limited(what):
        try:
            value = call()
        except (RollingJointError, OSError) as error:
            text = str(error)
            if len(text.splitlines()) > 1 or len(text) > 3000:
                report.fail(f"{what}: a message of several lines or {len(text)} characters: {text[:200]!r}")
            report.count(f"refused: {what}")
        except Exception as error:
            report.fail(f"{what}: traceback: {type(error).__name__}: {error}")
            if path is not None:
                found.keep_input(path, call)
        else:
            if changed(value):
                report.fail(f"{what}: damage was accepted")


def damaged(rng, content):
    """Some of the bytes changed, cut, repeated or replaced."""
    content = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        place = int(rng.integers(len(content) + 1))
        match rng.integers(6):
            case 0 if content:
                content[place % len(content)] ^= 1 << int(rng.integers(8))
            case 1:
                del content[place:]
            case 2:
                del content[place : place + int(rng.integers(1, 20))]
            case 3:
                content[place:place] = rng.integers(0, 256, int(rng.integers(1, 9))).astype(np.uint8).tobytes()
            case 4:
                content[place:place] = content[: int(rng.integers(1, 200))]
            case _:
                content[place:place] = _TEXTS[rng.integers(len(_TEXTS))].encode("utf-8", "replace")
    return bytes(content)


def _yaml(rng, report, folder):
    kind = str(rng.choice(list(READERS)))
    files = sorted((ROOT / "configs" / kind).glob("*.yaml"))
    text = files[rng.integers(len(files))].read_text("utf-8")
    path = folder / "configs" / kind / f"mutated.{kind}"
    path.unlink(missing_ok=True)
    if rng.random() < 0.5:
        path.write_bytes(damaged(rng, text.encode()))
    else:
        with contextlib.suppress(yaml.YAMLError, ValueError):
            path.write_text(_replaced(rng, text), "utf-8", errors="replace")
    if path.exists():
        tried(report, f"YAML of {kind}", lambda: READERS[kind](path), path=path)


def _replaced(rng, text):
    """The text with one scalar or one whole value replaced."""
    lines = text.splitlines()
    at = int(rng.integers(len(lines)))
    key, colon, _ = lines[at].partition(":")
    lines[at] = f"{key}: {_TEXTS[rng.integers(len(_TEXTS))]}" if colon else _TEXTS[rng.integers(len(_TEXTS))]
    return "\n".join(lines) + "\n"


def _policy(rng, report, folder):
    files = sorted(FOLDER.glob("*.safetensors"))
    whole = files[rng.integers(len(files))].read_bytes()
    path = folder / "mutated.policy"
    if rng.random() < 0.5:
        path.write_bytes(changed := damaged(rng, whole))
        tried(report, "policy file", lambda: load_policy(path), lambda _: changed != whole, path)
    else:
        content, tensors = unpack(whole, "policy")
        path.write_bytes(pack(_edited(rng, content), dict(tensors)))
        tried(report, "policy file, sealed again", lambda: load_policy(path), path=path)


def _edited(rng, content):
    """The description with one value somewhere inside replaced."""
    content = json.loads(json.dumps(content))
    at = content
    while True:
        key = list(at)[rng.integers(len(at))] if isinstance(at, dict) else int(rng.integers(len(at)))
        if isinstance(at[key], (dict, list)) and at[key] and rng.random() < 0.8:
            at = at[key]
            continue
        if rng.random() < 0.3 and isinstance(at, dict):
            del at[key]
        else:
            at[key] = [None, "x", -1, 0, 1e300, [], {}, True, 2**70, [1, 2], "../../x"][rng.integers(11)]
        return content


def _command_line(rng, report, folder):
    words = [str(word) for word in rng.choice(_WORDS, int(rng.integers(0, 9)))]
    if rng.random() < 0.7:
        words = ["solve", *rng.choice(["five_link", "small_arm"], 1).tolist(), "--tensions", "5", "5", *words]
    out, err = io.StringIO(), io.StringIO()

    def call():
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = rj(words)
            except SystemExit as stopped:
                code = stopped.code
        if code not in (0, 2, 3):
            report.fail(f"rj {words}: exit code {code}")
        if "Traceback" in err.getvalue():
            report.fail(f"rj {words}: a traceback")

    tried(report, "command line", call)


def _settings(rng, report, folder):
    kind = settings_of(str(rng.choice(["rj_gym/RollingJoint-v0", "rj_gym/FlexibleArm-v0", "rj_gym/Instrument-v0"])))
    junk = [None, "x", -1, 0, 1e300, float("nan"), [], {}, True, 2**70, [1, 2], [[1]], {"mu": "x"}, b"x", (1, np.inf)]
    names = list(kind.__dataclass_fields__)
    given = {names[rng.integers(len(names))]: junk[rng.integers(len(junk))] for _ in range(int(rng.integers(1, 3)))}
    from rj_gym.core.settings import made_settings

    tried(report, "settings", lambda: made_settings(kind, given, {}, False))


_whole = []


def _run_folder(rng, report, folder):
    """A file of a run folder damaged: what reads it notices."""
    whole = _finished_run()
    run = folder / "run"
    shutil.rmtree(run, ignore_errors=True)
    shutil.copytree(whole, run)
    files = sorted(path for path in run.rglob("*") if path.is_file() and "events" not in path.name)
    path = files[rng.integers(len(files))]
    content = path.read_bytes()
    match rng.integers(4):
        case 0:
            path.unlink()
        case 1:
            path.unlink()
            path.mkdir()
        case _:
            path.write_bytes(damaged(rng, content))
    tried(report, "run folder", lambda: FinishedRun.read(run))
    tried(report, "run folder", lambda: RunFolder.open(run).config())
    from agents.policies.trained import load_driving

    changed = path.is_dir() or not path.exists() or path.read_bytes() != content
    read = {run / "config.yaml", *RunFolder.open(whole).policy_files("best")} if changed else set()
    read = {run / path.relative_to(whole) if path.is_relative_to(whole) else path for path in read}
    tried(report, "run folder", lambda: load_driving(RunFolder.open(run), "best"), lambda _: path in read)


def _finished_run():
    """A tiny run that is trained once per process."""
    if not _whole:
        from agents import train
        from tests.attack.kills import TRAIN

        keep = tempfile.mkdtemp(prefix="attack-run-")
        with contextlib.redirect_stdout(io.StringIO()):
            assert train.main([*TRAIN, "--run-dir", f"{keep}/run"]) == 0
        _whole.append(Path(keep) / "run")
        import atexit

        atexit.register(shutil.rmtree, keep, ignore_errors=True)
    return _whole[0]


COUNTS = {_yaml: 60, _policy: 25, _command_line: 60, _settings: 25, _run_folder: 8}
"""How many of each kind in a round."""
