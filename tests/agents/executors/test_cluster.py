"""Work on a two-node Ray cluster of this machine: as on local processes to the bit, whatever is killed."""

import json
import os
import signal
import subprocess
from importlib.util import find_spec

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
from tests.agents.executors.nodes import (
    SEARCH,
    campaign_file,
    ended,
    nodes_of_this_machine,
    process_in,
    run,
    searched,
    trained,
    wait_until,
)
from tests.agents.forked import CONTEXT

NO_RAY = 'Ray is not installed: pip install "rollingjoint[cluster]"'
pytestmark = [pytest.mark.slow, pytest.mark.skipif(find_spec("ray") is None, reason=NO_RAY)]

CHUNKS = SEARCH.replace("population: 5", "population: 220").replace("budget: 120", "budget: 660\nchunk: 100")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with nodes_of_this_machine(tmp_path_factory.mktemp("token")) as nodes:
        yield nodes


@pytest.fixture
def nodes(cluster):
    cluster.complete()
    return cluster


@pytest.fixture
def executor(nodes):
    with options.executor_of(nodes.address) as made:
        yield made


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
    nodes.kill()
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
    nodes.kill()
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
