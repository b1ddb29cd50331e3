"""agents.campaign: many runs, some at a time; what is finished stays, what was interrupted goes on."""

import multiprocessing
import os
import signal
import threading
import time
import zipfile
from contextlib import contextmanager
from pathlib import Path

import pytest

from agents import train
from agents.campaign import main as campaign_main
from agents.executors import local
from agents.runs.config import TrainConfig, load_config
from agents.runs.environment import EnvConfig
from agents.training import campaign
from agents.training.campaign import load_campaign
from rollingjoint.chain.presets import small_arm
from rollingjoint.errors import ConfigError
from rollingjoint.io.mechanism_file import mechanism_to_dict
from tests.agents.executors import units
from tests.agents.forked import CONTEXT

TINY = """
algorithm: ppo
total_timesteps: {steps}
env: {{n_envs: 2, settings: {{episode_steps: 10}}}}
parameters: {{n_steps: 10, batch_size: 20, n_epochs: 1}}
policy: {{hidden: [8]}}
evaluation: {{every: 1000, episodes: 2}}
checkpoint_every: 100
"""


def wait_for_interrupt(folder: Path) -> None:
    """Stands in for training: says that it runs, then waits for a signal and "saves"."""
    units.wait_for_interrupt(folder.parent, folder.name)


def campaign_file(folder: Path, steps: int = 1000, **runs: list[int]) -> Path:
    for name in runs:
        (folder / f"{name}.yaml").write_text(TINY.format(steps=steps))
    path = folder / "list.yaml"
    path.write_text(
        "runs:\n" + "".join(f"  - {{config: {name}.yaml, seeds: {seeds}}}\n" for name, seeds in runs.items())
    )
    return path


def run(path: Path, out: Path, jobs: int = 2) -> int:
    return campaign_main([str(path), "--out", str(out), "--jobs", str(jobs)])


def weights(folder: Path) -> bytes:
    with zipfile.ZipFile(folder / "policy.zip") as archive:
        return archive.read("policy.pth")


@pytest.fixture(autouse=True)
def forked(monkeypatch):
    monkeypatch.setattr(local, "get_context", lambda method: CONTEXT)


@contextmanager
def meanwhile(act):
    """Calls `act` in a thread until it says that it is done."""

    def poll():
        while not ended and not act():
            time.sleep(0.02)

    ended: list[bool] = []
    thread = threading.Thread(target=poll)
    thread.start()
    try:
        yield
    finally:
        ended.append(True)
        thread.join()


@pytest.mark.slow
def test_a_run_whose_process_is_killed_goes_on_in_another_and_ends_as_if_alone(tmp_path, monkeypatch, capfd):
    path, out = campaign_file(tmp_path, near=[1, 2]), tmp_path / "out"

    def kill_one():
        if all(any((out / f"near/seed_{seed}/checkpoints").glob("[0-9]*")) for seed in (1, 2)):
            multiprocessing.active_children()[0].kill()
            return True

    with meanwhile(kill_one):
        assert run(path, out) == 0
    said = capfd.readouterr().out
    assert "0 runs are finished, 0 begun, 2 new" in said
    assert said.count("its process was ended by SIGKILL: ") == 1
    assert "2 of 2  near seed " in said
    assert sum(path.read_text().count("--resume") for path in out.glob("near/*/command.txt")) == 1
    before = weights(out / "near/seed_1"), weights(out / "near/seed_2")
    assert before[0] != before[1]
    with monkeypatch.context() as patch:
        patch.setattr(local, "get_context", None)
        assert run(path, out) == 0
    assert (weights(out / "near/seed_1"), weights(out / "near/seed_2")) == before
    alone = ["--config", str(tmp_path / "near.yaml"), "--set", "seed=1", "--run-dir", str(tmp_path / "alone")]
    assert train.main(alone) == 0
    assert weights(tmp_path / "alone") == before[0]
    alone[3:] = ["seed=2", "--run-dir", str(tmp_path / "other")]
    assert train.main(alone) == 0
    assert weights(tmp_path / "other") == before[1]
    assert sorted(path.name for path in out.iterdir()) == ["command.txt", "near"]


@pytest.mark.slow
def test_a_failing_run_is_reported_in_one_line_and_the_others_go_on(tmp_path, capfd):
    path, out = campaign_file(tmp_path, steps=100, bad=[1], good=[7], changed=[1]), tmp_path / "out"
    (out / "bad/seed_1").mkdir(parents=True)
    (out / "bad/seed_1/letters.txt").write_text("of somebody")
    assert train.main(["--config", str(tmp_path / "changed.yaml"), "--run-dir", str(out / "changed/seed_1")]) == 0
    assert run(path, out, jobs=1) == 2
    said = capfd.readouterr()
    failed = [line for line in said.err.splitlines() if line.startswith("failed: ")]
    assert [line.split(":")[1] for line in failed] == [" changed seed 1", " bad seed 1"]
    assert "what" in failed[0] and "another --out" in failed[0]  # trained with seed 0, not 1
    assert "What is there is no run; it stays as it is." in failed[1]
    assert "2 of 3 runs failed" in said.err
    assert campaign.RunFolder(out / "good/seed_7").is_finished
    written = load_config(out / "good/seed_7/config.yaml")
    assert (written.seed, written.torch_threads) == (7, 1)


def test_a_signal_lets_every_run_save_begins_no_other_and_says_how_to_go_on(tmp_path, monkeypatch, capfd):
    path, out = campaign_file(tmp_path, near=[1, 2, 3]), tmp_path / "out"

    def interrupt_once_both_run():
        if len(list(out.rglob("*.runs"))) == 2:
            os.kill(os.getpid(), signal.SIGINT)
            return True

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(campaign, "train_in", wait_for_interrupt)
    with meanwhile(interrupt_once_both_run):
        assert run(path, out) == 130
    assert len(list(out.rglob("*.saved"))) == 2
    said = capfd.readouterr()
    assert f"stopped by SIGINT; to go on: rj campaign {path} --out {out} --jobs 2" in said.out
    assert "failed" not in said.err
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("runs: []", "a list with at least one entry"),
        ("run: []", "Did you mean 'runs'?"),
        ("runs: [{config: near.yaml}]", "the key 'seeds'"),
        ("runs: [{config: near.yaml, seeds: [1.5]}]", "an integer from 0"),
        ("runs: [{config: near.yaml, seeds: [1, 1]}]", "every seed once"),
        ("runs: [{config: near.yaml, seeds: [1]}, {config: other/near.yaml, seeds: [1]}]", "every seed once"),
        ("runs: [{config: near.yaml, seeds: [1], set: [algorithm=ppo]}]", "`set` and `name` together"),
        ("runs: [{config: near.yaml, seeds: [1], name: ../up, set: [algorithm=ppo]}]", "the name of a folder"),
        ("runs: [{config: near.yaml, seeds: [1], name: up, set: [algorithms=ppo]}]", "Did you mean 'algorithm'?"),
        ("runs: [{config: far.yaml, seeds: [1]}]", "readable YAML text"),
        ("runs: [{config: wrong.yaml, seeds: [1]}]", "Did you mean 'algorithm'?"),
    ],
)
def test_a_wrong_campaign_file_is_refused_before_anything_is_trained(text, complaint, tmp_path, capsys):
    path = campaign_file(tmp_path, near=[1])
    (tmp_path / "other").mkdir()
    (tmp_path / "other/near.yaml").write_text(TINY.format(steps=10))
    (tmp_path / "wrong.yaml").write_text("algorithms: ppo")
    path.write_text(text)
    assert run(path, tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert complaint in said and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_configuration_means_the_same_wherever_its_mechanism_is_written(tmp_path):
    text = Path("configs/mechanism/two_segment.yaml").read_text()
    assert "name: two_segment" in text
    (tmp_path / "arm.yaml").write_text(text.replace("name: two_segment", "name: mine"))
    (tmp_path / "train.yaml").write_text("env: {settings: {mechanism: arm.yaml}}")
    from_file = load_config(tmp_path / "train.yaml")
    by_name = load_config(tmp_path / "train.yaml", ["env.settings.mechanism=two_segment"])
    assert from_file != by_name
    assert from_file.content() == by_name.content()
    assert load_config(tmp_path / "train.yaml", ["env.settings.mechanism=five_link"]).content() != by_name.content()
    assert load_config(tmp_path / "train.yaml", ["env.settings.start_tension=3.5"]).content() != from_file.content()


def test_the_content_of_an_arm_s_configuration_has_every_setting_and_bead():
    env = EnvConfig("rj_gym/FlexibleArm-v0", settings={"mechanism": "small_arm"})
    settings = TrainConfig(env=env).content()["env"]["settings"]
    assert settings["gravity"]["tilt"] == (0.0, 0.5) and settings["load"]["process"] == "constant"
    assert settings["mechanism"] == mechanism_to_dict(small_arm()) | {"name": ""}
    other = EnvConfig("rj_gym/FlexibleArm-v0", settings={"mechanism": small_arm(5)})
    assert TrainConfig(env=other).content() != TrainConfig(env=env).content()


@pytest.mark.parametrize("path", sorted(Path("configs/campaign").glob("*.yaml")), ids=lambda path: path.stem)
def test_the_ready_campaigns_name_configurations_that_are_there(path):
    try:
        members = load_campaign(path)
    except ConfigError as error:
        pytest.fail(str(error))
    least = 1 if path.stem == "plain_ppo" else 5  # that one gives scale, and no verdict
    assert len({member.seed for member in members}) >= least


def test_a_configuration_is_trained_with_changes_under_a_name_for_them(tmp_path):
    path = campaign_file(tmp_path, near=[1])
    changed = "{config: near.yaml, name: far, set: ['policy.hidden=[4]', total_timesteps=7], seeds: [1]}"
    path.write_text(f"runs: [{{config: near.yaml, seeds: [1]}}, {changed}]")
    near, far = load_campaign(path)
    assert [str(member) for member in (near, far)] == ["near seed 1", "far seed 1"]
    config = far.create(tmp_path / "out").config()
    assert (config.policy.hidden, config.total_timesteps, config.seed) == ((4,), 7, 1)
    assert (tmp_path / "out/far/seed_1/config.yaml").is_file() and far.begun(tmp_path / "out") is True
