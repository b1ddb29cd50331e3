"""A Ray cluster of nodes on this machine that can be killed, and small work for it: for tests and benchmarks."""

import json
import re
import subprocess
import sys
import time
import zipfile
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from tests.conftest import ROOT, sources_first

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
SETTINGS = {  # read when Ray is imported, which only this module has done
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # all ports on 127.0.0.1
    "RAY_AUTH_MODE": "token",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_agent_register_timeout_ms": "300000",  # a machine that has other work takes its time
    "RAY_worker_niceness": "0",
}
PATIENCE = 1200.0  # seconds, for a machine that has other work
NODE = {"num_cpus": 1, "object_store_memory": 80_000_000, "memory": 3 * 2**30}


class Nodes:
    """A cluster: its head, and nodes that can be killed."""

    def __init__(self):
        from ray.cluster_utils import Cluster

        self.cluster = Cluster(initialize_head=True, head_node_args=NODE | {"include_dashboard": False})
        self.address = self.cluster.address
        self.others = []

    def complete(self, count=2):
        """Have nodes join until there are so many with the head; under load Ray gives up on one after half a minute."""
        for _ in range(count + 1):
            if len(self.others) < count - 1:
                with suppress(Exception):
                    self.others.append(self.cluster.add_node(**NODE))
        assert len(self.others) == count - 1

    def kill(self):
        """All processes of the node that joined first are killed, the head's never."""
        self.cluster.remove_node(self.others.pop(0), allow_graceful=False)


@contextmanager
def nodes_of_this_machine(folder):
    """A cluster with its head alone; a token in the folder keeps others out."""
    token = folder / "token"
    token.write_text("of this test " * 4)
    token.chmod(0o600)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in SETTINGS.items():
            patch.setenv(name, value)
        patch.setenv("RAY_AUTH_TOKEN_PATH", str(token))
        patch.setenv("PYTHONPATH", sources_first()["PYTHONPATH"])
        nodes = Nodes()
        try:
            yield nodes
        finally:
            nodes.cluster.shutdown()


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
