"""agents.results: the results file, the page and its pictures, rebuilt from run folders or from the file alone."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.stats import trim_mean

from agents.controllers import baselines
from agents.controllers.tuned import tuned_controllers
from agents.evaluate import evaluate_controllers
from agents.executors.folders import FILES, files_of
from agents.executors.local import InlineExecutor
from agents.executors.policies import PolicyUnit, with_policy
from agents.policies.export import export_run
from agents.policies.trained import load_trained
from agents.results import Results, films, read_results, scores, worlds
from agents.results import __main__ as results
from agents.results import pictures as results_pictures
from agents.results.environment import changed
from agents.results.file import write_results
from agents.results.merging import merged
from agents.results.page import Tables
from agents.results.page import page as whole_page
from agents.results.record import POLICY, SHIFT, SWEEP, TEST, VALIDATION
from agents.results.runs import find_benchmarks
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from tests.agents.results.tiny_runs import SEEDS, train_all

pytestmark = pytest.mark.slow  # eight trainings and a page; test_record.py has the page of results alone

EPISODES, FIRST = 12, 20_000
SIZES = ["--episodes", "12", "--seed", "20000", "--validation", "6", "--per-point", "4"]


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    """Finished runs, one that is not finished, one whose policy is damaged, one of which nothing but files is left."""
    folder = tmp_path_factory.mktemp("runs")
    train_all(folder)
    return folder


@pytest.fixture(scope="module")
def out(runs, tmp_path_factory) -> Path:
    """Where the page of these runs is."""
    folder = tmp_path_factory.mktemp("out")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(worlds, "POINTS", (0.0, 1.25))  # which takes less time than all of them
        assert results.main([str(runs), "--out", str(folder), *SIZES, "--jobs", "1"]) == 0
    return folder


@pytest.fixture(scope="module")
def page(out) -> str:
    return (out / "results.md").read_text()


@pytest.fixture(scope="module")
def records(out):
    """Benchmarks of the results file, by title."""
    return {record.title: record for record in read_results(out / "results.json.gz").benchmarks}


def table(page: str, heading: str, number: int = 0) -> dict[str, list[str]]:
    """Rows of the n-th table below a heading, by their first cell."""
    section = page.split(f"## {heading}\n", 1)[1].split("\n## ")[0]
    block = re.findall(r"(?:^\|.*\n)+", section, re.MULTILINE)[number]
    return {
        row[0]: row[1:]
        for row in ([cell.strip() for cell in line.strip("|\n").split("|")] for line in block.splitlines())
    }


def mm(value: float) -> str:
    return "< 0.001" if abs(value) < 0.001 else f"{value:.3f}" if abs(value) < 1 else f"{value:.2f}"


def test_every_task_has_a_row_for_every_configuration_baseline_and_the_floor(page):
    rows = {*baselines(), "floor", "controller", ":--"}
    for number in (0, 1):
        assert table(page, "Near", number).keys() == rows | {"ppo_near", "sac_near"}
        blind = rows - baselines().keys() | {"do nothing", "privileged teacher (privileged)"}
        blind |= tuned_controllers("rj_gym/Instrument-v0").keys() | {"apg_drift"}
        unknown = {"floor"} if number else set()  # with friction in the chain
        assert table(page, "Drift", number).keys() == blind - unknown
        assert table(page, "Reach", number).keys() == rows | {"ppo_reach"}
    assert list(table(page, "In short"))[2:] == ["[near](#near)", "[reach](#reach)", "[drift](#drift)"]


@pytest.mark.parametrize("loads", ["of training", "heavier"])
def test_the_figures_are_those_of_evaluate_controllers_on_the_same_seeds(loads, runs, page):
    for name in ("ppo_near", "sac_near"):
        scores, known = [], None
        for seed in SEEDS[name]:
            run = RunFolder.open(runs / name / f"seed_{seed}")
            heavier = {"load": {"magnitude": [1.0, 1.5]}} if loads == "heavier" else {}
            policies = {"policy": load_trained(run), **baselines()}
            known = evaluate_controllers(changed(run.config().env, heavier), policies, range(FIRST, FIRST + EPISODES))
            scores.append(known.scores["policy"])
        found = table(page, "Near", 0 if loads == "of training" else 1)
        assert found[name][0].startswith(f"{mm(np.mean([score.last_10_mm for score in scores]))} [")
        assert found[name][4] == f"{100 * np.mean([score.within_1_mm for score in scores]):.1f}"
        assert float(found[name][6]) == pytest.approx(
            np.mean([score.regret_mm for score in scores]), rel=5e-3, abs=1e-3
        )
        for baseline in baselines():
            score, last = known.scores[baseline], known.episodes[baseline].last_errors.mean(axis=1)
            figures = score.last_10_mm, trim_mean(last, 0.25), np.median(last), np.percentile(last, 95)
            shown = [float(cell.split(" [")[0]) for cell in found[baseline][:4]]
            assert shown == pytest.approx(figures, rel=5e-3, abs=1e-3), baseline
            assert found[baseline][4:6] == [f"{100 * score.within_1_mm:.1f}", f"{100 * score.held_1_mm:.1f}"]
            assert float(found[baseline][6]) == pytest.approx(score.regret_mm, rel=5e-3, abs=2e-3)
        assert found["floor"][0] == mm(np.mean(known.floors))


@pytest.mark.parametrize("name", ["ppo_near", "sac_near"])
def test_a_policy_in_a_worker_does_what_it_does_here(name, runs):
    run = RunFolder(runs / name / "seed_1")
    controllers = {"policy": load_trained(run), "feedback": baselines()["jacobian feedback"]}
    env, seeds = run.config().env, range(FIRST, FIRST + 3)
    here, there = (
        evaluate_controllers(env, controllers, seeds, with_floor=False, executor=executor)
        for executor in (None, InlineExecutor())
    )
    assert here.to_dict() == there.to_dict()


def test_a_policy_travels_where_its_run_folder_is_not_seen(runs, tmp_path):
    run = RunFolder(runs / "ppo_near/seed_1")
    files = files_of(run.path, FILES)
    gone = RunFolder(tmp_path / "gone")
    found = PolicyUnit("policy", _load, (), gone).received(with_policy(_load, (), gone, {}))
    assert found.travels
    assert with_policy(_load, (), gone, files) == _load(run)


def _load(run: RunFolder) -> list[float]:
    return [float(one.sum()) for one in load_trained(run).network.tensors().values()]


def test_the_summary_shows_the_best_of_the_validation_episodes(records, page, runs):
    near = records["near"]
    means = {}
    for name in ("ppo_near", "sac_near"):
        driven = []
        for seed in SEEDS[name]:
            run = RunFolder.open(runs / name / f"seed_{seed}")
            report = evaluate_controllers(
                run.config().env, {"p": load_trained(run)}, range(3_000_000, 3_000_006), False
            )
            driven.append(report.scores["p"].last_10_mm)
        means[name] = np.mean(driven)
    assert near.best("policy") == min(means, key=means.get)
    for record in (near, records["drift"]):  # beside the learning curves
        feedback = {"jacobian feedback"} & set(record.names())
        assert record.levels.keys() == feedback | {record.best("baseline"), "floor"}
    _, *row = table(page, "In short")["[near](#near)"]  # the verdict first
    assert row[0] == near.best("policy") and row[2] == near.best("baseline")
    assert row[1] == table(page, "Near")[row[0]][0] and row[3] == table(page, "Near")[row[2]][0]


def test_steps_seeds_and_single_runs_are_said(page):
    near, drift = table(page, "Near"), table(page, "Drift")
    assert near["ppo_near"][8::2] == ["80", "2"]
    assert drift["apg_drift"][8::2] == ["80", "1 (one run)"]
    flat = " ".join(page.split())
    assert "One run, not a mean over seeds: ppo_reach, apg_drift." in flat
    assert "Training seeds: 1, 2 (ppo_near, sac_near); 4 (ppo_reach); 3 (apg_drift)." in flat
    assert (
        "training 1 to 5, evaluations during it 1000000 to 1000001, choosing the best 6 episodes (seeds 3000000 to"
        in flat
    )
    assert "tables 12 episodes (seeds 20000 to 20011)" in flat
    assert "12 steps of at most 1 mm" in flat and "drifts (Ornstein-Uhlenbeck, correlation time 15 steps)" in flat
    assert "2 training seeds are no verdict" in flat and "A single training seed is no verdict" in flat


def test_the_page_says_how_to_rebuild_it(page, runs, out):
    commands = re.search(r"```bash\n(.*?)```", page, re.DOTALL)[1].splitlines()
    assert commands[0] == "python -m agents.campaign list.yaml"
    assert commands[1] == f"rj results {runs} {' '.join(SIZES)} --out {out}"


def test_the_file_alone_gives_the_same_page_and_pictures(out, page, tmp_path):
    assert results.main(["--from", str(out / "results.json.gz"), "--out", str(tmp_path)]) == 0
    assert (tmp_path / "results.md").read_text() == page
    assert (tmp_path / "results.json.gz").read_bytes() == (out / "results.json.gz").read_bytes()
    for path in (out / "images").iterdir():
        assert (tmp_path / "images" / path.name).read_bytes() == path.read_bytes(), path.name


def test_a_page_without_the_animations_does_not_name_them(out, page, tmp_path, monkeypatch):
    monkeypatch.setattr(results_pictures, "pictures", lambda results: {})
    file = shutil.copy(out / "results.json.gz", tmp_path)
    assert results.main(["--from", str(file), "--out", str(tmp_path)]) == 0
    assert ".gif" in page and ".gif" not in (tmp_path / "results.md").read_text()


def test_a_page_of_several_files_has_their_animations_and_tells_the_merging(out, page, tmp_path, monkeypatch):
    monkeypatch.setattr(results_pictures, "pictures", lambda results: {})
    whole, parts, other = read_results(out / "results.json.gz"), [], "of other episodes"
    for name, filmed in {"one": ["near"], "two": ["near", "reach", "drift"]}.items():
        records = [replace(one, title=f"{name} {one.title}") for one in whole.benchmarks]
        films = {f"{name} {title}": whole.films[title] for title in filmed}
        if name == "two":
            films["two near"] = dict.fromkeys(films["two near"], other)
        parts.append(tmp_path / name / "results.json.gz")
        write_results(parts[-1], Results(records, commands=[name], films=films))
        shutil.copytree(out / "images", parts[-1].parent / "images", ignore=shutil.ignore_patterns("*.png"))
    (tmp_path / "two/images/results_near.gif").write_bytes(other.encode())
    words = ["--from", *map(str, parts), "--out", str(tmp_path / "both")]
    assert results.main(words) == 0
    text = (tmp_path / "both/results.md").read_text()
    assert re.findall(r"\]\(images/(\S+)\)", text) == [f"results_{name}.gif" for name in ("near", "reach", "drift")]
    assert other not in " ".join(text.split())
    for path in (out / "images").glob("*.gif"):
        assert (tmp_path / "both/images" / path.name).read_bytes() == path.read_bytes()
    commands = re.search(r"```bash\n(.*?)```", text, re.DOTALL)[1].splitlines()
    assert commands == ["one", "two", f"rj results {' '.join(words)}"]


def test_runs_alone_complete_results_that_have_their_opponents(runs, out, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(worlds, "POINTS", (0.0, 1.25))
    assert results.main([str(runs), "--runs-only", "--out", str(tmp_path), *SIZES, "--jobs", "1"]) == 0
    assert "merge it by --from" in capsys.readouterr().out and [one.name for one in tmp_path.iterdir()] == [
        "results.json.gz"
    ]
    alone, whole = (read_results(folder / "results.json.gz") for folder in (tmp_path, out))
    assert {one.kind for record in alone.benchmarks for one in record.controllers} == {POLICY}
    assert "--runs-only" in alone.commands[-1]
    first = [
        replace(record, controllers=[replace(one, runs=one.runs[:1]) for one in record.controllers])
        for record in whole.benchmarks
    ]
    for record, known in zip(merged([Results(first), alone]).benchmarks, whole.benchmarks, strict=True):
        assert [one.name for one in record.controllers] == [one.name for one in known.controllers]
        assert [world.floors is None for world in record.worlds] == [world.floors is None for world in known.worlds]
        for one, other in zip(record.controllers, known.controllers, strict=True):
            assert [run.training_seed for run in one.runs] == [run.training_seed for run in other.runs]
            for run, same in zip(one.runs, other.runs, strict=True):
                assert all(np.array_equal(run.driven[name].last, same.driven[name].last) for name in same.driven)


def test_a_file_cannot_name_an_animation_elsewhere(out, tmp_path):
    found = Results([], films={"near": {"../secret.gif": "a caption"}})
    (tmp_path / "secret.gif").write_bytes(b"GIF")
    (tmp_path / "images").mkdir()
    films.bring_films({tmp_path / "results.json.gz": found}, found, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_command_of_a_page_leaves_out_what_is_the_default(runs, monkeypatch):
    said = []
    monkeypatch.setattr(results, "_command", lambda arguments: said.append(results._commands(arguments)) or 0)
    assert results.main([str(runs), "--shipped"]) == 0
    assert said == [["python -m agents.campaign list.yaml", f"rj results {runs} --shipped"]]


def test_a_world_without_poses_is_shown_with_capstan_friction_and_what_that_makes_of_filters(page, records):
    (shift,) = [world for world in records["drift"].of_role(SHIFT) if "capstan" in world.name]
    section = page.split(f"### {shift.heading}\n", 1)[1].split("\n#")[0]
    assert "No filter here has a state for that" in " ".join(section.split())
    shown = {line.split(" | ")[0].strip("| "): line.split(" | ")[-1].strip("| ") for line in section.splitlines()}
    for name in ("bank of filters", "apg_drift"):
        errors = (records["drift"].controller(name).errors(world).mean() for world in (shift.name, TEST))
        assert shown[name].startswith(f"{100 * (next(errors) / next(errors) - 1):+.0f} [")
    assert "From the task's own episodes to these the mean changes: that of apg_drift by" in " ".join(section.split())


def test_worlds_are_the_table_the_choice_heavier_loads_and_the_points_of_curves(records):
    near = records["near"]
    assert [(world.name, world.role, world.seeds) for world in near.worlds[:3]] == [
        ("test", TEST, range(FIRST, FIRST + EPISODES)),
        ("validation", VALIDATION, range(3_000_000, 3_000_006)),
        ("Heavier loads than in training, 1 to 1.5 N", SHIFT, range(FIRST, FIRST + EPISODES)),
    ]
    points = near.of_role(SWEEP)
    assert [world.value for world in points] == [0, 1.25]
    assert all(world.changes == {"load": {"magnitude": [world.value, world.value]}} for world in points)
    assert {world.episodes for world in points} == {4} and points[0].trained == (0.0, 1.0)
    at_rest = near.controller("jacobian feedback").errors("load 0")[0]
    env = EnvConfig(settings={"episode_steps": 12, "load": {"magnitude": [0.0, 0.0]}})
    known = evaluate_controllers(env, {"feedback": baselines()["jacobian feedback"]}, range(FIRST, FIRST + 4))
    np.testing.assert_allclose(at_rest, known.episodes["feedback"].last_errors.mean(axis=1), rtol=6e-4)
    np.testing.assert_allclose(near.world("load 0").floors, known.floors, rtol=6e-4, atol=1e-9)


def test_run_folders_that_are_broken_unfinished_or_double_are_left_out_and_named(page):
    flat = " ".join(page.split())
    assert {Path(path).parent.name for path in re.findall(r"Left out: `(\S+)`: ", flat)} == {
        "unfinished",
        "damaged",
        "empty",
        "second",
    }
    assert "--resume" in flat and "valid YAML" in flat and "which its hash tells" in flat


def test_pictures_are_of_sensible_size_and_all_on_the_page(page, out):
    named = re.findall(r"\]\(images/(\S+)\)", page)
    assert sorted(named) == sorted(path.name for path in (out / "images").iterdir())
    assert {f"results_{name}.gif" for name in ("near", "drift", "reach")} < set(named)
    frames = {}
    for name in named:
        with Image.open(out / "images" / name) as picture:
            assert picture.format == {".png": "PNG", ".gif": "GIF"}[Path(name).suffix]
            assert 400 <= picture.width <= 1500 and 250 <= picture.height <= 1500, name
            assert len(np.unique(np.asarray(picture.convert("L")))) > 20, name
            frames[name] = getattr(picture, "n_frames", 1)
    assert frames["results_near.gif"] == frames["results_reach.gif"] == 13
    assert (out / "images/results_near.gif").stat().st_size < 1_500_000


@pytest.mark.slow
def test_the_page_is_the_same_again_with_two_processes(runs, page, out, tmp_path, monkeypatch):
    monkeypatch.setattr(films, "three_episodes", lambda *anything: {})
    monkeypatch.setattr(worlds, "POINTS", (0.0, 1.25))
    assert results.main([str(runs), *SIZES, "--jobs", "2", "--out", str(tmp_path)]) == 0

    def without_films(text: str) -> str:
        return re.sub(r"!\[[^\]]*\]\(\S+\.gif\)\n\n[^\n]+\n([^\n]+\n)?\n", "", re.sub(r"--out \S+", "", text))

    def without_times(text: str) -> str:
        """The text without the column of processor times, which is another one every time."""
        lines, place = [], 0
        for line in text.splitlines():
            cells = line.split(" | ")
            place = cells.index("µs per action") if "µs per action" in cells else place if line.startswith("|") else 0
            lines.append(" | ".join(cells[:place] + cells[place + 1 :]) if place else line)
        return re.sub(r" / [\d.]+", "", "\n".join(lines))

    again = (tmp_path / "results.md").read_text()
    assert without_times(without_films(again)) == without_times(without_films(page))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--seed", "1000001"], "seeds that training has not used"),
        (["--seed", "2"], "seeds that training has not used"),
        (["--episodes", "0"], "an integer from 1"),
        (["--validation", "0"], "an integer from 1"),
        (["--per-point", "-1"], "an integer from 0"),
    ],
)
def test_seeds_of_training_and_wrong_numbers_are_refused(arguments, complaint, runs, tmp_path, capsys):
    assert results.main([str(runs), "--out", str(tmp_path), "--jobs", "1", *arguments]) == 2
    assert complaint in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_without_a_finished_run_is_an_error(tmp_path, capsys):
    assert results.main([str(tmp_path), "--out", str(tmp_path)]) == 2
    assert "at least one finished run" in capsys.readouterr().err


def test_rewards_do_not_make_another_task_but_loads_do(runs):
    tasks, _ = find_benchmarks(runs)
    assert [task.title for task in tasks] == ["near", "reach", "drift"]
    assert [(recipe.name, recipe.seeds) for recipe in tasks[0].recipes] == [("ppo_near", [1, 2]), ("sac_near", [1, 2])]


def test_shipped_policies_are_scored_for_tasks_without_runs(runs, records, monkeypatch):
    policy = export_run(RunFolder.open(runs / "ppo_near/seed_1"), "best", "near")
    monkeypatch.setattr(scores, "list_policies", lambda: ["near"])
    monkeypatch.setattr(scores, "shipped_policies", lambda: [policy])
    monkeypatch.setattr(scores, "load_policy", lambda name, version=None: policy)
    tasks, _ = find_benchmarks(runs)
    assert scores.shipped_for_others(tasks) == {}
    assert list(scores.shipped_for_others(tasks[1:])) == ["near"]
    assert list(scores.shipped_for_others([replace(tasks[1], title="near")])) == ["near (shipped)"]
    plan = worlds.ScoringPlan(range(FIRST, FIRST + 4), range(3_000_000, 3_000_002), 5)
    with scores.driving(1) as drive:
        record = scores.score_shipped(policy, "near", plan, drive)
    expected = records["near"].controller("ppo_near").errors(TEST)[:1, :4]
    np.testing.assert_allclose(record.controller("ppo_near").errors(TEST), expected, rtol=1e-3)
    assert not record.of_role(SWEEP) and len(record.of_role(SHIFT)) == 1
    table_row = next(row for row in Tables(record).section()[2].splitlines() if row.startswith("| ppo_near"))
    assert table_row.endswith("|  | 1 (one run) |")  # how long it was trained is not known
    text = whole_page(Results([record]), {}, {})
    assert "Shipped policies, one training seed each, trained earlier: ppo_near." in text
    (caption,) = (caption for _, caption in films.three_of_shipped(policy, record).values())
    assert caption.startswith("ppo_near, training seed 1: of the episodes of the table the best (seed ")


def test_runs_or_results_files_are_needed(capsys):
    for arguments in ([], ["somewhere", "--from", "results.json.gz"]):
        with pytest.raises(SystemExit):
            results.main(arguments)
        assert "give a folder with run folders, or --from" in capsys.readouterr().err
