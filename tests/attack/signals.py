"""Ctrl-C at any moment of every command, and SIGKILL of one whose workers have begun: an end within seconds, in one
line, with nothing left running.

Every command is a process of its own with a session of its own. What it has started is known by a variable in its
environment, which all of them inherit, whatever session they are in.
"""

import atexit
import contextlib
import os
import re
import secrets
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
LIMIT = 5.0  # s from the signal to the end, on a processor that nobody else uses
LINGER = 3.0  # s after the end of a command in which what it has started ends
ORPHANS = 8.0  # s that a unit may take to stop after its parent was killed
HANGS = 60.0  # s: not waited for any longer
MARK = "ROLLINGJOINT_ATTACK"
_FIRST = {
    "agents/__init__.py",
    "rollingjoint/__init__.py",
    "rollingjoint/interrupts.py",
}  # Python runs before all others
_SAID = re.compile(r"^(interrupted|stopped by SIGINT|rj warmup: interrupted)", re.MULTILINE)
_TINY = ("total_timesteps=400", "env.n_envs=2", "env.settings.episode_steps=10", "policy.hidden=[8]",
         "evaluation.every=200", "evaluation.episodes=2", "checkpoint_every=200",
         "parameters={n_steps: 10, batch_size: 20, n_epochs: 2}")  # fmt: skip
_STUDY = f"""config: {ROOT}/configs/train/demo.yaml
space: {{parameters.gamma: {{low: 0.5, high: 0.99}}}}
episodes: 4
startup: 2
trials: 20
"""


class Command(NamedTuple):
    """A command: its words with FOLDER for an empty folder and MADE for what _made() has made; its workers.

    Args:
        span: s in which the moments lie, on a processor that nobody else uses.
    """

    words: str
    span: float = 8.0
    workers: bool = False


COMMANDS = {
    "rj solve": Command("rj solve configs/mechanism/spline_example.yaml --tensions 3 2 2 --plot FOLDER/a.png", 3.0),
    "rj plot": Command("rj plot five_link --tensions 3 2 --out FOLDER/a.pdf", 3.0),
    "rj loop": Command("rj loop five_link --friction 0.1 --steps 5000 --cycles 5", 6.0),
    "rj export": Command("rj export five_link --out FOLDER/made --mjcf FOLDER/a.xml", 4.0),
    "rj identify": Command("rj identify examples/data/two_runs_raw.yaml"),
    "rj mechanisms": Command("rj mechanisms", 1.5),
    "rj check": Command("rj check configs/mechanism/spline_example.yaml", 1.5),
    "rj warmup": Command("rj warmup", 15.0),
    "train": Command("agents.train --config configs/train/demo.yaml --run-dir FOLDER/run", 12.0),
    "train, large": Command("agents.train --config configs/train/ppo_flexible_arm.yaml --run-dir FOLDER/run", 15.0),
    "tune": Command("agents.tune --config MADE/study.yaml --study FOLDER/study", 12.0),
    "tune, two jobs": Command("agents.tune --config MADE/study.yaml --study FOLDER/study --jobs 2", 15.0, True),
    "campaign": Command("agents.campaign MADE/list.yaml --out FOLDER/out --jobs 2", 15.0, True),
    "search": Command("agents.search configs/search/demo.yaml --out FOLDER/out --jobs 2", 12.0, True),
    "evaluate": Command("agents.evaluate MADE/out/near/seed_1 --episodes 400 --out FOLDER/out"),
    "evaluate, two jobs": Command(
        "agents.evaluate MADE/out/near/seed_1 --episodes 2000 --out FOLDER/out --jobs 2", 12.0, True
    ),
    "results": Command("agents.results MADE/out --episodes 100 --validation 40 --per-point 20 --out FOLDER/docs", 10.0),
    "results, two jobs": Command(
        "agents.results MADE/out --episodes 100 --validation 40 --per-point 20 --out FOLDER/docs --jobs 2", 15.0, True
    ),
    "export": Command("agents.export MADE/out/near/seed_1 --name made --out FOLDER --episodes 400"),
    "dataset": Command("agents.dataset fixed_target --steps 200000 --out FOLDER/data"),
    "enter": Command("agents.enter agents.controllers.controller:DoNothing --out FOLDER/mine.json"),
    "robots": Command("agents.robots --robots 10 --controller 'probing bank'", 10.0),
    "adapt": Command("agents.adapt --controller 'probing bank' --robots 2", 12.0),
    "view": Command("agents.view five_link --port 0", 8.0),
    "view, a page": Command("agents.view five_link --record FOLDER/a.html", 5.0),
    "opponents": Command("agents.tuning.controllers --world rj_gym/Instrument-v0 --output FOLDER/tuned.yaml", 10.0),
}
KILLED = [name for name, command in COMMANDS.items() if command.workers]
ROUND = [*COMMANDS, *(f"{name}, killed" for name in KILLED)]


def attack(rng, report):
    """One moment of one command; a round of all commands is len(ROUND) rounds of the attack."""
    name = ROUND[report.round % len(ROUND)]
    with tempfile.TemporaryDirectory(prefix="attack-") as folder:
        for _ in range(5):  # until it still runs at the moment
            if (_killed if name.endswith(", killed") else _interrupted)(rng, report, name, Path(folder)):
                return
            shutil.rmtree(folder)
            os.mkdir(folder)
    report.count(f"signals after the end: {name}")


def _interrupted(rng, report, name, folder):
    """Send SIGINT at a random moment; False if the command had ended."""
    started = Started(COMMANDS[name], folder)
    with started:
        _wait_for_moment(rng, started)
        before = len(started.errors())
        if not started.runs():
            if code := started.process.poll():
                report.fail(f"{name}: ended by itself with exit code {code}: {started.errors()[-300:]}")
            _shorten(name, started)
            return False
        started.interrupt(to_all=bool(rng.integers(2)))
        begin, crowd = time.monotonic(), crowding()
        started.wait(HANGS)
        seconds, code = time.monotonic() - begin, started.process.poll()
        left = started.orphans(LINGER * crowd)
        faults = _faults(started, code, seconds / crowd, left, before)
        if faults == ["Python's"]:
            report.count("signals before our first line or after the last")
            return False
        report.count("signals")
        report.count(f"signals: {name}")
        report.count(f"orphans: {name}", len(left))
        report.longest(f"seconds: {name}", seconds)
        report.longest(f"seconds, crowding taken out: {name}", seconds / crowd)
        for fault in faults:
            report.fail(
                f"{name}: SIGINT after {started.at:.2f} s: {fault}; {seconds:.1f} s, {crowd:.1f} at a processor"
            )
    return True


def _faults(started, code, seconds, left, before):
    """What is wrong with how it ended; ["Python's"] if the interpreter had not come to our code, or had left it."""
    output, errors = started.output(), started.errors()
    had_ended = code in (0, -signal.SIGINT) and not errors and seconds < 1.0
    files = set(re.findall(rf'File "{re.escape(str(ROOT))}/([^"]+)"', errors))
    begins = "init_import_site" in errors  # where Python looks for installed packages
    if had_ended or begins or ("Traceback" in errors and files <= _FIRST):
        return ["Python's"]
    faults = []
    if code is None or seconds > LIMIT:
        faults.append("does not end" if code is None else f"ended late, {seconds:.1f} s")
    if code not in (130, None):
        faults.append(f"exit code {code}")
    if left:
        faults.append(f"left running: {'; '.join(left)}")
    if "Traceback" in errors or "Exception ignored" in errors:
        faults.append(f"a traceback: {errors[-600:]}")
    lines = [line for line in errors[before:].splitlines() if line.strip()]
    if len(lines) > 1 or (code == 130 and len(_SAID.findall(output + errors)) != 1):
        faults.append(f"not one line: {lines}, {output[-200:]!r}")
    return faults


def _killed(rng, report, name, folder):
    """SIGKILL soon after the first worker has started; its workers end by themselves."""
    started = Started(COMMANDS[name.removesuffix(", killed")], folder)
    with started:
        if not started.wait_for_worker():
            return False
        time.sleep(rng.uniform(0.0, 4.0))
        if not started.runs():
            return False
        begin, crowd = time.monotonic(), crowding()
        started.process.kill()
        started.process.wait()
        left = started.orphans(ORPHANS * crowd)
        seconds = time.monotonic() - begin
        report.count("parents killed")
        report.count(f"orphans: {name}", len(left))
        report.longest(f"seconds: {name}", seconds)
        for each in left:
            report.fail(f"{name}: goes on {seconds:.1f} s later: {each}")
    return True


_spans = {}


def _wait_for_moment(rng, started):
    """Wait for a random moment: of the whole, or of the seconds after the first worker."""
    span = _spans.get(started.command, started.command.span) * crowding() ** 0.5
    if started.command.workers and rng.random() < 0.4:
        started.wait_for_worker()
        span = 3.0
    end = time.monotonic() + rng.uniform(0.0, span)
    while time.monotonic() < end and started.runs():
        time.sleep(min(0.05, max(0.0, end - time.monotonic())))
    started.at = time.monotonic() - started.begin


def _shorten(name, started):
    _spans[started.command] = min(_spans.get(started.command, started.command.span), started.at) * 0.8


class Started:
    """A command that runs, and what it has started; at the end of the context all of it is ended."""

    def __init__(self, command, folder):
        self.command, self.at, self._folder = command, 0.0, folder
        self._mark = secrets.token_hex(8)
        words = []
        for word in shlex.split(command.words):
            word = word.replace("FOLDER", str(folder))
            words.append(word.replace("MADE", str(_made())) if "MADE" in word else word)
        rj = ["-c", "import sys; sys.argv[0] = 'rj'; from rollingjoint.cli import main; sys.exit(main())"]
        words = [sys.executable, *(rj if words[0] == "rj" else ["-m", words[0]]), *words[1:]]
        environment = os.environ | {MARK: self._mark, "PYTHONPATH": str(ROOT)}
        if words[-1] == "warmup":
            environment |= {"ROLLINGJOINT_CACHE": str(folder / "cache")}
        self.begin = time.monotonic()
        with (folder / ".stdout").open("wb") as out, (folder / ".stderr").open("wb") as err:
            self.process = subprocess.Popen(
                words, cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                start_new_session=True, preexec_fn=_answer_to_interrupts,
            )  # fmt: skip

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        for pid in self._pids():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()

    def output(self):
        return (self._folder / ".stdout").read_text("utf-8", "replace")

    def errors(self):
        return (self._folder / ".stderr").read_text("utf-8", "replace")

    def runs(self):
        return self.process.poll() is None

    def interrupt(self, to_all):
        """SIGINT to it alone, or as a terminal sends it: to its process group."""
        os.kill(self.process.pid, signal.SIGINT) if not to_all else os.killpg(self.process.pid, signal.SIGINT)

    def wait(self, seconds):
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(seconds)

    def wait_for_worker(self):
        """Whether it has started a worker before it ended."""
        while self.runs():
            if any(os.getsid(pid) != self.process.pid for pid in self._pids()):
                return True
            time.sleep(0.02)
        return False

    def orphans(self, patience):
        """What still runs after some seconds."""
        end = time.monotonic() + patience
        while (pids := self._pids() - {self.process.pid}) and time.monotonic() < end:
            time.sleep(0.05)
        return [f"{pid} {_text(pid, 'cmdline')[-80:]}" for pid in pids]

    def _pids(self):
        """All its processes, zombies left out."""
        mark = f"{MARK}={self._mark}"
        pids = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
        return {pid for pid in pids if mark in _text(pid, "environ")}


def _text(pid, name):
    try:
        return Path(f"/proc/{pid}/{name}").read_text("utf-8", "replace").replace("\0", " ")
    except OSError:
        return ""


def _answer_to_interrupts():
    """In the child: a shell that works in the background has its children ignore SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def crowding():
    """How many processes want each processor, at least 1."""
    cpus = len(os.sched_getaffinity(0))
    running = sum(_text(path.name, "stat").rpartition(")")[2].split()[:1] == ["R"] for path in _processes())
    return max(1.0, os.getloadavg()[0] / cpus, running / cpus)


def _processes():
    return [path for path in Path("/proc").iterdir() if path.name.isdigit()]


@cache
def _made():
    """A folder with what commands are given, made once per process: two small runs, a list of runs, a study."""
    folder, owner = Path(tempfile.mkdtemp(prefix="attack-made-")), os.getpid()
    atexit.register(lambda: os.getpid() == owner and shutil.rmtree(folder, ignore_errors=True))
    (folder / "study.yaml").write_text(_STUDY)
    demo = ROOT / "configs/train/demo.yaml"
    (folder / "list.yaml").write_text(f"runs:\n  - {{config: {demo}, seeds: [1, 2, 3]}}\n")
    for seed in (1,):
        words = ["--config", str(demo), "--run-dir", str(folder / f"out/near/seed_{seed}"), "--set", f"seed={seed}"]
        for each in _TINY:
            words += ["--set", each]
        subprocess.run([sys.executable, "-m", "agents.train", *words], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return folder
