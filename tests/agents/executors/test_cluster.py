"""Work on a two-node Ray cluster of this machine: as on local processes to the bit, whatever is killed."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import pytest

from agents import campaign, evaluate, tune
from agents.executors import folders, options
from agents.executors import local as processes
from agents.executors.cluster import RayExecutor
from agents.executors.driver import Unit, work_through
from agents.executors.progress import Progress
from agents.search import __main__ as search
from rollingjoint.errors import ConfigError
from tests.agents.executors import units
from tests.agents.forked import CONTEXT
from tests.conftest import ROOT, sources_first

NO_RAY = 'Ray is not installed: pip install "rollingjoint[cluster]"'
pytestmark = [pytest.mark.slow, pytest.mark.skipif(find_spec("ray") is None, reason=NO_RAY)]

TRAIN = """
algorithm: ppo
total_timesteps: {steps}
env: {{n_envs: 2, settings: {{episode_steps: 10}}}}
parameters: {{n_steps: 10, batch_size: 20, n_epochs: 1}}
policy: {{hidden: [8]}}
evaluation: {{every: 200, episodes: 2}}
checkpoint_every: 100
"""
SEARCH = """
space: {knots: 3}
objectives:
  - {kind: lateral_stiffness, tensions: [[5, 5]]}
limits:
  - {kind: tip_rotation, cases: 3, low: 0.1}
methods:
  random: {batch: 5}
  cma_es: {population: 5}
budget: 120
seeds: [1, 2]
"""
CHUNKS = SEARCH.replace("population: 5", "population: 220").replace("budget: 120", "budget: 660\nchunk: 100")
SETTINGS = {  # read when Ray is imported, which only this module has done
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # all ports on 127.0.0.1
    "RAY_AUTH_MODE": "token",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_agent_register_timeout_ms": "300000",  # a machine that has other work takes its time
    "RAY_worker_niceness": "0",
}
PATIENCE = 1200.0  # seconds, for a machine that has other work
NODE = {"num_cpus": 1, "object_store_memory": 80_000_000, "memory": 3 * 2**30}


class TwoNodes:
    """The cluster: its head, and a node that can be killed. A token keeps others out."""

    def __init__(self):
        from ray.cluster_utils import Cluster

        self.cluster = Cluster(initialize_head=True, head_node_args=NODE | {"include_dashboard": False})
        self.address = self.cluster.address
        self.second = None

    def complete(self):
        """Have the second node join unless it is there; under load Ray gives up on it after half a minute."""
        for _ in range(3):
            if self.second is None:
                with suppress(Exception):
                    self.second = self.cluster.add_node(**NODE)
        assert self.second is not None

    def kill_the_second(self):
        """All its processes are killed."""
        self.cluster.remove_node(self.second, allow_graceful=False)
        self.second = None


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    token = tmp_path_factory.mktemp("token") / "token"
    token.write_text("of this test " * 4)
    token.chmod(0o600)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in SETTINGS.items():
            patch.setenv(name, value)
        patch.setenv("RAY_AUTH_TOKEN_PATH", str(token))
        patch.setenv("PYTHONPATH", sources_first()["PYTHONPATH"])
        made = TwoNodes()
        yield made
        made.cluster.shutdown()


@pytest.fixture
def nodes(cluster):
    cluster.complete()
    return cluster


@pytest.fixture
def executor(nodes):
    with options.executor_of(nodes.address) as made:
        yield made


def run(module, *words):
    """A command in a process of its own, as users start it; the process."""
    command = [sys.executable, "-m", module, *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT)


def ended(process):
    """Exit code and output."""
    said, _ = process.communicate(timeout=PATIENCE)
    return process.returncode, said


def wait_until(holds, seconds=PATIENCE):
    until = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.02)


def process_in(folder):
    """The process that holds the lock of a folder, or None."""
    locks, end = Path("/proc/locks").read_text(), rf"\S+:{(folder / 'lock').stat().st_ino} "
    return next((int(found[1]) for found in re.finditer(rf" FLOCK .* (\d+) {end}", locks)), None)


def campaign_file(folder, steps, seeds):
    (folder / "near.yaml").write_text(TRAIN.format(steps=steps))
    (folder / "list.yaml").write_text(f"runs: [{{config: near.yaml, seeds: {list(seeds)}}}]\n")
    return folder / "list.yaml"


def trained(out):
    """What training found, by run: networks and evaluations."""
    found = {}
    for path in sorted(out.glob("near/seed_*/")):
        with zipfile.ZipFile(path / "policy.zip") as archive:
            found[path.name] = archive.read("policy.pth"), (path / "evaluations.csv").read_text()
    return found


def searched(out):
    """The journals without their times, by run."""
    lines = {path.parent: path.read_text().splitlines() for path in sorted(out.glob("*/*/evaluations.jsonl"))}
    return {
        str(path.relative_to(out)): [json.loads(line) | {"seconds": 0} for line in some] for path, some in lines.items()
    }


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    """A campaign of three seeds and searches of two methods with two seeds, whole and in chunks, on local processes."""
    folder = tmp_path_factory.mktemp("local")
    path = campaign_file(folder, 1500, (1, 2, 3))
    (folder / "search.yaml").write_text(SEARCH)
    (folder / "chunks.yaml").write_text(CHUNKS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processes, "get_context", lambda method: CONTEXT)  # they need not import everything
        assert campaign.main([str(path), "--out", str(folder / "campaign"), "--jobs", "2"]) == 0
        for name in ("search", "chunks"):
            assert search.main([str(folder / f"{name}.yaml"), "--out", str(folder / name), "--jobs", "2"]) == 0
    return folder


def test_units_end_as_on_local_processes(executor, tmp_path):
    some = [Unit(f"unit {i}", units.double, (i,)) for i in range(4)]
    some += [Unit("bad", units.fail, (tmp_path,)), Unit("threads", units.threads)]
    with Progress(len(some), "unit") as progress:
        found = {one.unit.name: one.value or one.failure for one in work_through(executor, some, progress, [])}
    assert [found[f"unit {i}"] for i in (1, 2, 3)] == [2, 4, 6]
    assert found["bad"] == "ValueError('two\\nlines')" and (tmp_path / "calls").read_text() == "x"
    assert set(found["threads"].values()) == {"1"}
    assert executor.slots == 2


def test_a_cluster_that_does_not_answer_is_one_line(nodes):
    with pytest.raises(ConfigError, match="Connection refused"):
        RayExecutor("127.0.0.1:1")


def test_every_port_is_on_the_loopback_interface(nodes):
    listening = subprocess.run(["ss", "-ltnpH"], capture_output=True, text=True).stdout.splitlines()
    ours = [line.split()[3] for line in listening if any(name in line for name in ("raylet", "gcs_server", "ray::"))]
    assert len(ours) >= 3 and all("127.0.0.1" in address for address in ours)


def test_a_campaign_outlives_a_worker_and_a_node_and_ends_as_on_local_processes(nodes, local, tmp_path):
    out = tmp_path / "out"
    process = run("agents.campaign", local / "list.yaml", "--out", out, "--cluster", nodes.address)
    wait_until(lambda: len(list(out.glob("near/seed_[12]/checkpoints/[0-9]*"))) > 3)
    os.kill(process_in(out / "near/seed_1"), signal.SIGKILL)
    nodes.kill_the_second()
    code, said = ended(process)
    assert code == 0, said
    assert "its worker or machine is gone" in said
    assert trained(out) == trained(local / "campaign")
    for path in out.glob("near/seed_*"):  # whatever was done twice is less than a checkpoint interval and its rollout
        done = [
            int(line.split()[0]) for line in path.with_suffix(".log").read_text().splitlines() if " steps: " in line
        ]
        assert len(done) <= len(set(done)) + 1


def test_a_search_outlives_a_worker_and_searches_nothing_twice(nodes, local, tmp_path):
    out, hit = tmp_path / "out", []
    process = run("agents.search", local / "search.yaml", "--out", out, "--cluster", nodes.address)

    def kill_in_the_middle():
        assert process.poll() is None, "it is over"
        for journal in out.glob("*/*/evaluations.jsonl"):
            if 1 < journal.read_bytes().count(b"\n") < 12 and (number := process_in(journal.parent)):
                os.kill(number, signal.SIGKILL)
                hit.append((journal, journal.read_bytes()))
        return hit

    wait_until(kill_in_the_middle)
    code, said = ended(process)
    assert code == 0, said
    assert "its worker or machine is gone" in said
    assert searched(out) == searched(local / "search")
    for journal, before in hit:  # with the times of its batches
        assert journal.read_bytes().startswith(before[: before.rindex(b"\n") + 1])


def test_chunks_of_a_search_are_scored_as_on_local_processes(nodes, local, tmp_path):
    out = tmp_path / "out"
    assert search.main([str(local / "chunks.yaml"), "--out", str(out), "--cluster", nodes.address]) == 0
    assert searched(out) == searched(local / "chunks")


def test_a_search_outlives_a_node_and_ends_as_on_local_processes(nodes, local, tmp_path):
    out = tmp_path / "out"
    process = run("agents.search", local / "search.yaml", "--out", out, "--cluster", nodes.address)
    wait_until(lambda: list(out.glob("*/*/evaluations.jsonl")))
    nodes.kill_the_second()
    code, said = ended(process)
    assert code == 0, said
    assert searched(out) == searched(local / "search")


def test_a_killed_driver_is_started_again_and_a_stopped_one_says_how_to_go_on(nodes, local, tmp_path):
    out = tmp_path / "out"
    words = "agents.campaign", local / "list.yaml", "--out", out, "--cluster", nodes.address
    process = run(*words)
    wait_until(lambda: list(out.glob("near/seed_1/checkpoints/[0-9]*")))
    process.kill()
    process.communicate()
    process = run(*words)
    wait_until(lambda: list(out.glob("near/seed_3/checkpoints/[0-9]*")))
    process.send_signal(signal.SIGINT)
    code, said = ended(process)
    assert code == 130 and "stopped by SIGINT; to go on: rj campaign" in said
    code, said = ended(run(*words))
    assert code == 0, said
    assert trained(out) == trained(local / "campaign")


def test_folders_travel_where_storage_is_not_shared(nodes, local, tmp_path, monkeypatch):
    write = folders.write_text
    monkeypatch.setattr(folders, "write_text", lambda path, text: write(path.with_name("no mark"), text))
    out = tmp_path / "out"
    words = [str(local / "list.yaml"), "--out", str(out), "--cluster", nodes.address]
    assert campaign.main(words) == 0
    assert trained(out) == trained(local / "campaign")
    log = (out / "near/seed_1.log").read_text()
    assert str(out) not in log and "rollingjoint-" in log


def test_an_evaluation_is_that_of_this_process(nodes, local, tmp_path, no_pictures):
    for where, words in {"here": [], "there": ["--cluster", nodes.address]}.items():
        run_folder = str(local / "campaign/near/seed_1")
        assert evaluate.main([run_folder, "--episodes", "6", "--out", str(tmp_path / where), *words]) == 0
    here, there = (json.loads((tmp_path / where / "report.json").read_text()) for where in ("here", "there"))
    assert here["final_errors_mm"] == there["final_errors_mm"] and here["scores"] == there["scores"]


def test_a_study_is_that_of_this_process(nodes, local, tmp_path, no_pictures):
    study = f"config: {local}/near.yaml\nset: {{total_timesteps: 80, evaluation.every: 40}}\ntrials: 2\n"
    study += "space: {parameters.gamma: {low: 0.5, high: 0.99}}\nepisodes: 2\nstartup: 8\n"
    (tmp_path / "study.yaml").write_text(study)
    for where, words in {"here": [], "there": ["--cluster", nodes.address]}.items():
        folder = str(tmp_path / where)
        assert tune.main(["--config", str(tmp_path / "study.yaml"), "--study", folder, *words]) == 0
    here, there = ((tmp_path / where / "best.yaml").read_text().split("\n", 1)[1] for where in ("here", "there"))
    assert here == there
