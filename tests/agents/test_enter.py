"""agents.enter, and docs/enter.md: its commands and programs run, with few episodes."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from agents import enter
from agents.controllers import FunctionController, OpenLoop, untuned_controllers
from agents.controllers.controller import load_controller
from agents.evaluation.rollout import run_episodes
from agents.results import __main__ as results
from agents.results import read_results
from agents.results.file import FILE, write_results
from agents.runs.environment import EnvConfig
from agents.shipped import list_policies, load_policy
from rollingjoint.errors import ConfigError

TEXT = Path("docs/enter.md").read_text(encoding="utf-8")
FEW = {"test": range(9_000_000, 9_000_012), "validation": range(3_000_000, 3_000_008)}


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def workshop(tmp_path, monkeypatch):
    """A folder with the controllers of the page, and few episodes."""
    own, trained, *_ = blocks("python")
    (tmp_path / "my_controller.py").write_text(f"{own}\n\n{trained}")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(enter, "SEEDS", FEW)
    return tmp_path


def test_it_compares_with_the_file_that_agents_results_writes():
    assert enter.PUBLISHED == results.OUT / FILE


@pytest.mark.slow
def test_every_command_and_program_of_the_page_runs(workshop, capsys):
    for command in "".join(blocks("bash")).splitlines():
        rj, name, *arguments = shlex.split(command)
        assert rj == "rj"
        assert {"enter": enter, "results": results}[name].main(arguments) == 0
    printed = capsys.readouterr().out
    assert "3000000 to 3000007" in printed and "9000000 to 9000011" in printed
    page = (workshop / "my_page/results.md").read_text()
    assert "| Careful (entered) |" in page and "(images/results_distribution.png)" in page
    *_, seeds, reading = blocks("python")
    for program, expected in zip((seeds, reading), blocks("text"), strict=True):
        exec(program, {})
        assert capsys.readouterr().out == expected.replace("(1, 1000)", "(1, 12)")


@pytest.mark.slow
def test_a_row_stands_beside_the_shipped_policy_and_the_opponents_in_the_same_episodes(workshop, capsys):
    assert enter.main(["my_controller.py:Careful", "--seeds", "test", "--out", "mine.json"]) == 0
    _, head, _, *rows, entered = capsys.readouterr().out.splitlines()
    assert {re.split(r"  +", row)[0] for row in rows} == {"Careful <--", "fixed_target", *untuned_controllers()}
    assert "Careful minus it [mm]" in head and entered == "Entered in mine.json"
    (record,) = read_results("mine.json").benchmarks
    assert record.names() == ["Careful"] and record.env_id == "rj_gym/RollingJoint-v0"
    own = load_controller("my_controller.py:Careful")
    expected = run_episodes(EnvConfig(), own, FEW["test"]).last_errors.mean(axis=1)
    np.testing.assert_allclose(record.controllers[0].errors("test")[0], expected, rtol=6e-4)
    (row,) = [row for row in rows if row.startswith("open loop")]
    gap = expected.mean() - run_episodes(EnvConfig(), OpenLoop(), FEW["test"]).last_errors.mean()
    assert f"{gap:+.3f} [" in row
    means = [float(re.split(r"  +", row)[1].split(" [")[0].replace("< ", "")) for row in rows]
    assert means == sorted(means)


def test_a_learned_controller_is_entered_once_per_training_seed(workshop, capsys):
    for seed in ("1", "2"):
        command = [
            "my_controller.py:trained",
            "--name",
            "mine",
            "--training-seed",
            seed,
            "--alone",
            "--out",
            "all.json",
        ]
        assert enter.main(command) == 0
    (record,) = read_results("all.json").benchmarks
    assert record.controller("mine").training_seeds == [1, 2]
    assert len(read_results("all.json").commands) == 2
    assert "open loop" not in capsys.readouterr().out


def test_figures_of_a_results_file_are_taken_where_it_has_the_episodes(workshop, capsys, monkeypatch):
    assert enter.main(["my_controller.py:trained", "--alone", "--seeds", "test", "--out", "theirs.json"]) == 0
    capsys.readouterr()
    monkeypatch.setattr("agents.results.entry.shipped", None)  # nothing is scored again
    command = ["my_controller.py:Careful", "--seeds", "test", "--beside", "theirs.json"]
    assert enter.main(command) == 0
    _, _, _, *rows = capsys.readouterr().out.splitlines()
    assert {re.split(r"  +", row)[0] for row in rows} == {"Careful <--", "trained"}
    assert enter.main([*command, "--set", "load.magnitude=[0,2]"]) == 2
    assert "results of rj_gym/RollingJoint-v0 in the test episodes" in capsys.readouterr().err


def test_other_settings_are_another_benchmark_with_a_title_of_its_own(workshop, capsys):
    for more in ([], ["--set", "load.magnitude=[0,2]"]):
        assert enter.main(["my_controller.py:Careful", "--alone", "--out", "mine.json", *more]) == 0
    titles = [record.title for record in read_results("mine.json").benchmarks]
    assert titles == ["RollingJoint-v0", "RollingJoint-v0 load.magnitude=[0,2]"]
    assert results.main(["--from", "mine.json", "--out", "page"]) == 2
    assert "at least one task with test episodes" in capsys.readouterr().err and not Path("page").exists()


def test_functions_and_controllers_and_what_makes_them_can_be_entered(tmp_path):
    path = tmp_path / "some.py"
    path.write_text(
        "import numpy as np\nfrom agents.controllers import DoNothing\nfrom beside import SIZE\n"
        "ready = DoNothing()\n"
        "def zeros(): return lambda observation: np.zeros((len(observation), SIZE))\n"
        "def seven(): return 7\n"
        "broken = 1 / len([]) if SIZE < 0 else None\n"
    )
    (tmp_path / "beside.py").write_text("SIZE = 2\n")
    expected = run_episodes(EnvConfig(), load_controller("agents.controllers:DoNothing"), range(3)).errors
    for name in ("ready", "zeros", "DoNothing"):
        found = load_controller(f"{path}:{name}")
        assert isinstance(found, FunctionController) == (name == "zeros")
        np.testing.assert_array_equal(run_episodes(EnvConfig(), found, range(3)).errors, expected)
    for wrong in (
        f"{path}:nothing",
        f"{path}:seven",
        f"{path}:SIZE",
        "nowhere.py:x",
        "nowhere:x",
        "x",
        ":",
        f"{path}:",
    ):
        with pytest.raises(ConfigError, match=r"FILE\.py:NAME or MODULE:NAME"):
            load_controller(wrong)


def test_a_function_with_a_memory_is_reset_when_episodes_begin():
    class Memory:
        """Counts."""

        resets = 0

        def reset(self):
            self.resets += 1

        def __call__(self, observation):
            return np.zeros((len(observation), 2))

    memory = Memory()
    run_episodes(EnvConfig(settings={"episode_steps": 2}), FunctionController(memory), range(4), batch=2)
    assert memory.resets == 2


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["my_controller.py:Careful", "--env", "rj_gym/Nothing-v0"], "expected one of"),
        (["my_controller.py:Careful", "--env", "rj_gym/CurvatureDesign-v0"], "a tracking environment of rj_gym"),
        (["my_controller.py:Careful", "--set", "load.magnitud=3"], "magnitud"),
        (["my_controller.py:Careful", "--training-seed", "-1"], "--training-seed"),
        (["my_controller.py:Careful", "--beside", "nowhere.json"], "a file that rj results wrote"),
        (["my_controller.py:Careful", "--alone", "--beside", "theirs.json"], "--alone"),
        (["nowhere.py:Careful"], "FILE.py:NAME"),
    ],
)
def test_what_cannot_be_entered_is_one_line(arguments, complaint, workshop, capsys):
    assert enter.main(arguments) == 2
    error = capsys.readouterr().err
    assert complaint in error and error.count("\n") == 1


def test_every_key_of_a_results_file_is_on_the_page(workshop):
    assert enter.main(["my_controller.py:Careful", "--alone", "--seeds", "test", "--out", "mine.json"]) == 0
    found = read_results("mine.json")
    write_results(workshop / "again.json", found)
    names = set(re.findall(r'^ *"(\w+)": ', (workshop / "again.json").read_text(), re.MULTILINE))
    settings = re.search(r'"settings": \{.*?\n   \}', (workshop / "again.json").read_text(), re.DOTALL)[0]
    own = names - set(re.findall(r'"(\w+)": ', settings)) | {"settings"}
    assert [name for name in sorted(own - {"test"}) if f"`{name}`" not in TEXT] == []


@pytest.mark.slow
def test_entering_and_reading_results_need_no_learning_library(run_python):
    program = """
import sys, agents.enter, agents.results.entry, agents.results.page
print(sorted({"torch", "matplotlib", "stable_baselines3"} & sys.modules.keys()))
"""
    assert run_python("-c", program) == "[]\n"


def test_the_page_names_a_policy_that_is_shipped():
    assert set(re.findall(r'load_policy\("(\w+)"\)', TEXT)) <= set(list_policies())
    assert load_policy("fixed_target").environment.id == "rj_gym/RollingJoint-v0"
