"""agents.results: the page and its pictures, rebuilt from run folders alone."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from agents import train
from agents.baselines import baselines
from agents.evaluate import evaluate_controllers
from agents.evaluation.policy import Policy
from agents.evaluation.rollout import Episodes
from agents.evaluation.score import Score
from agents.results import __main__ as results
from agents.results import pictures as results_pictures
from agents.results.description import description
from agents.results.page import BEATS_FEEDBACK, DOES_NOT, NO_DIFFERENCE, PAYS, score_table, verdict, verdict_text
from agents.results.runs import Benchmark, Recipe, Run, find_benchmarks, heavier
from agents.results.scores import Comparison, Scores, driving, score
from agents.runs.config import TrainConfig
from agents.runs.environment import EnvConfig
from agents.runs.files import hash_file
from agents.runs.folder import RunFolder
from rj_gym.arm.config import FlexibleArmConfig
from rj_gym.planar.config import TrackingConfig

COMMON = ["total_timesteps=80", "env.n_envs=2", "env.settings.episode_steps=12", "policy.hidden=[8]",
          "evaluation.every=40", "evaluation.episodes=2", "normalise.reward=false"]  # fmt: skip
RECIPES = {
    "ppo_near": ["parameters={n_steps: 20, batch_size: 40, n_epochs: 1}"],
    "sac_near": [
        "algorithm=sac",
        "parameters={learning_starts: 20, batch_size: 8}",
        "env.settings.reward.effort=0",
        "env.id=rj_gym/RollingJointGoal-v0",
    ],
    "ppo_drift": ["parameters={n_steps: 20, batch_size: 40, n_epochs: 1}", "env.settings.load.process=ou"],
    "ppo_reach": [
        "parameters={n_steps: 20, batch_size: 40, n_epochs: 1}",
        "env={id: rj_gym/FlexibleArm-v0, n_envs: 2, settings: {mechanism: small_arm, episode_steps: 12}}",
    ],
}
SEEDS = {"ppo_near": (1, 2), "sac_near": (1, 2), "ppo_drift": (3,), "ppo_reach": (4,)}
EPISODES, FIRST = 12, 20_000


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    """Finished runs, one that is not finished, one whose policy is damaged, one of which nothing but files is left."""
    folder = tmp_path_factory.mktemp("runs")
    for name, overrides in RECIPES.items():
        for seed in SEEDS[name]:
            words = [word for text in [*COMMON, *overrides, f"seed={seed}"] for word in ("--set", text)]
            out = str(folder / name / f"seed_{seed}")
            assert train.main(["--config", "configs/train/demo.yaml", "--run-dir", out, *words]) == 0
    for broken in ("unfinished", "damaged", "empty"):
        shutil.copytree(folder / "ppo_near/seed_1", folder / broken / "seed_9")
    shutil.rmtree(folder / "unfinished/seed_9/checkpoints")
    (folder / "damaged/seed_9/best/policy.zip").write_bytes(b"PK")
    (folder / "empty/seed_9/config.yaml").write_text("algorithm: [")
    hash_file(folder / "empty/seed_9/config.yaml").unlink()
    shutil.copytree(folder / "ppo_near/seed_1", folder / "second/seed_1")
    (folder / "command.txt").write_text("python -m agents.campaign list.yaml\n")
    return folder


@pytest.fixture(scope="module")
def out(runs, tmp_path_factory) -> Path:
    """Where the page of these runs is."""
    folder = tmp_path_factory.mktemp("out")
    arguments = ["--episodes", str(EPISODES), "--seed", str(FIRST), "--jobs", "1"]
    assert results.main([str(runs), "--out", str(folder), *arguments]) == 0
    return folder


@pytest.fixture(scope="module")
def page(out) -> str:
    return (out / "results.md").read_text()


def table(page: str, heading: str, number: int = 0) -> dict[str, list[str]]:
    """Rows of the n-th table below a heading, by their first cell."""
    section = page.split(f"## {heading}\n", 1)[1].split("\n## ")[0]
    block = re.findall(r"(?:^\|.*\n)+", section, re.MULTILINE)[number]
    return {
        row[0]: row[1:]
        for row in ([cell.strip() for cell in line.strip("|\n").split("|")] for line in block.splitlines())
    }


def cell(values: list[float], form: str) -> str:
    texts = [form.format(value) for value in (np.mean(values), min(values), max(values))]
    return f"{texts[0]} ({texts[1]} to {texts[2]})" if len(values) > 1 else texts[0]


def mm(value: float) -> str:
    return "< 0.001" if abs(value) < 0.001 else f"{value:.3f}" if abs(value) < 1 else f"{value:.2f}"


def test_every_task_has_a_row_for_every_configuration_baseline_and_the_floor(page):
    rows = {*baselines(), "floor", "controller", ":--"}
    for number in (0, 1):
        assert table(page, "Near", number).keys() == rows | {"ppo_near", "sac_near"}
        assert table(page, "Drift", number).keys() == rows | {"ppo_drift"}
        assert table(page, "Reach", number).keys() == rows | {"ppo_reach"}
    assert list(table(page, "In short"))[2:] == ["[near](#near)", "[drift](#drift)", "[reach](#reach)"]


@pytest.mark.parametrize("loads", ["of training", "heavier"])
def test_the_figures_are_those_of_evaluate_controllers_on_the_same_seeds(loads, runs, page):
    for name in ("ppo_near", "sac_near"):
        scores, known = [], None
        for seed in SEEDS[name]:
            run = RunFolder.open(runs / name / f"seed_{seed}")
            env = run.config().env if loads == "of training" else heavier(run.config().env)
            policies = {"policy": Policy.load(run), **baselines()}
            report = evaluate_controllers(env, policies, range(FIRST, FIRST + EPISODES))
            scores.append(report.scores["policy"])
            known = report
        found = table(page, "Near", 0 if loads == "of training" else 1)
        means = [score.mean_mm for score in scores]
        assert found[name][0] == f"{mm(np.mean(means))} ({mm(min(means))} to {mm(max(means))})"
        within = [100 * score.within_1_mm for score in scores]
        assert found[name][3 if loads == "of training" else 2] == cell(within, "{:.1f}")
        for baseline in baselines():
            score = known.scores[baseline]
            assert found[baseline][:2] == [mm(score.mean_mm), mm(score.median_mm)]
            assert found[baseline][5 if loads == "of training" else 3] == mm(score.regret_mm)
        assert found["floor"][0] == mm(np.mean(known.floors))


def test_the_heavier_loads_lie_between_the_largest_of_training_and_half_as_much_again():
    env = heavier(EnvConfig(settings={"load": {"link": "tip", "magnitude": [0.2, 0.8]}}))
    assert env.arguments()["config"].load.magnitude == (0.8, pytest.approx(1.2))
    assert env.arguments()["config"].load.link == "tip"


def test_steps_seeds_and_single_runs_are_said(page):
    near, drift = table(page, "Near"), table(page, "Drift")
    assert near["ppo_near"][6::2] == ["80", "2"]
    assert drift["ppo_drift"][6::2] == ["80", "1 (one run)"]
    flat = " ".join(page.split())
    assert "One run, not a mean over seeds: ppo_drift, ppo_reach." in flat
    assert "Training seeds: 1, 2 (ppo_near, sac_near); 3 (ppo_drift); 4 (ppo_reach)." in flat
    assert "training 1 to 5, evaluations during it 1000000 to 1000001; here 20000 to 20011" in flat
    assert "12 steps of at most 1 mm" in flat and "drifts (Ornstein-Uhlenbeck, correlation time 15 steps)" in flat


def test_the_page_says_how_to_rebuild_it(page, runs, out):
    commands = re.search(r"```bash\n(.*?)```", page, re.DOTALL)[1].splitlines()
    assert commands[0] == "python -m agents.campaign list.yaml"
    assert commands[1] == f"python -m agents.results {runs} --episodes 12 --seed 20000 --out {out}"


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
    frames = {}
    for name in named:
        with Image.open(out / "images" / name) as picture:
            assert picture.format == {".png": "PNG", ".gif": "GIF"}[Path(name).suffix]
            assert 400 <= picture.width <= 1500 and 250 <= picture.height <= 1500, name
            assert len(np.unique(np.asarray(picture.convert("L")))) > 20, name
            frames[name] = getattr(picture, "n_frames", 1)
    assert (
        "results_near.gif" in named and "results_drift.gif" not in named
    )  # one for every mechanism and kind of target
    assert frames["results_near.gif"] == frames["results_reach.gif"] == 13
    assert (out / "images/results_near.gif").stat().st_size < 1_500_000


def test_every_baseline_has_a_colour():
    assert results_pictures.STYLES.keys() >= baselines().keys()


def test_policies_and_baselines_are_compared_in_the_same_episodes(runs):
    task = find_benchmarks(runs)[0][1]
    with driving(1) as drive:
        scores = score(task, range(FIRST, FIRST + 5), drive)
    policies = {"ppo_drift": Policy.load(RunFolder.open(runs / "ppo_drift/seed_3")), **baselines()}
    report = evaluate_controllers(task.env, policies, range(FIRST, FIRST + 5))
    for name, episodes in report.episodes.items():
        assert np.array_equal(scores.errors(name)[0], episodes.final_errors), name
    assert np.array_equal(scores.floors, report.floors)
    assert np.allclose(scores.loads, np.linalg.norm(report.episodes["open loop"].loads[:, -1], axis=1))


@pytest.mark.slow
def test_the_page_is_the_same_again_with_two_processes(runs, page, tmp_path, monkeypatch):
    monkeypatch.setattr(results_pictures, "three_episodes", lambda *anything: {})
    monkeypatch.setattr(results_pictures, "to_film", lambda scored: [])
    arguments = ["--episodes", str(EPISODES), "--seed", str(FIRST), "--jobs", "2", "--out", str(tmp_path)]
    assert results.main([str(runs), *arguments]) == 0

    def without_films(text: str) -> str:
        return re.sub(r"!\[[^\]]*\]\(\S+\.gif\)\n\n[^\n]+\n([^\n]+\n)?\n", "", re.sub(r"--out \S+", "", text))

    assert without_films((tmp_path / "results.md").read_text()) == without_films(page)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--seed", "1000001"], "seeds that training has not used"),
        (["--seed", "2"], "seeds that training has not used"),
        (["--episodes", "0"], "an integer from 1"),
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
    assert [task.title for task in tasks] == ["near", "drift", "reach"]
    assert [(recipe.name, recipe.seeds) for recipe in tasks[0].recipes] == [("ppo_near", [1, 2]), ("sac_near", [1, 2])]


def test_a_task_is_described_by_its_settings():
    planar = description(TrackingConfig(load={"link": "tip", "process": "step"}, start="random"))
    assert "five_link (5 links, 2 tendons, 100 mm): the tip goes to a fixed target in 50 steps" in planar
    assert "pulls at the tip and jumps to another one every 15 steps" in planar and "The load is not" in planar
    arm = description(
        FlexibleArmConfig(
            mechanism="small_arm",
            observe_load=True,
            orientation=True,
            gravity={"tilt": [0.0, 0.5]},
            load={"magnitude": [0.1, 0.4], "process": "ou"},
            target={"process": "path"},
            randomization={"position_noise_mm": 1.0, "weight_spread": 0.1},
        )
    )
    assert "small_arm (4 beads, 4 tendons, 80 mm): the tip follows a path through 3 points" in arm
    assert (
        "hangs from a base that is tilted by up to 29°; a payload of 0.1 to 0.4 N hangs from its tip and drifts" in arm
    )
    assert "Tilt and payload are observed." in arm and "turn into that of the target, too." in arm
    assert "noisy (standard deviations 1 mm and 0 rad)" in arm and "off: every weight by up to 10 %." in arm


def test_the_goal_environment_s_policies_belong_to_the_same_task():
    goal = EnvConfig("rj_gym/FlexibleArmGoal-v0", settings={"mechanism": "small_arm"})
    runs = [Run(RunFolder(Path()), TrainConfig(env=env), 0.0, np.zeros((3, 1))) for env in (goal, EnvConfig())]
    arm, planar = (Benchmark("some", [Recipe("one", [run])]) for run in runs)
    assert arm.env == EnvConfig("rj_gym/FlexibleArm-v0", settings={"mechanism": "small_arm"})
    assert planar.complexity == (0, 0) and arm.complexity == (2, 1)


def episodes(errors: np.ndarray) -> Episodes:
    count = len(errors)
    series = np.repeat(errors[:, None], 11, axis=1)
    return Episodes(np.arange(count), series, np.zeros(count), np.zeros(count, bool))


@pytest.mark.parametrize(
    ("gain", "feedback", "expected"),
    [(0.1, 0.3, PAYS), (-0.1, 0.3, BEATS_FEEDBACK), (0.0, 0.0, NO_DIFFERENCE), (-0.1, -0.05, DOES_NOT)],
)
def test_the_verdict_follows_from_paired_differences(gain, feedback, expected):
    random = np.random.default_rng(0)
    own = random.uniform(1, 5, 400)
    noise = random.normal(0, 0.02, (2, 400))
    policies = {"learned": [episodes(own), episodes(own + 0.001)]}
    others = {"predictive": episodes(own + gain + noise[0]), "jacobian feedback": episodes(own + feedback + noise[1])}
    scores = Scores(policies, others, np.zeros(400))
    assert verdict(scores) == expected
    text = verdict_text(scores)
    assert f"{abs(scores.compare('learned', scores.best_baseline).gain_mm):.2g} mm" in text
    assert "of 2 seeds" in text and ("pays here" in text) == (expected == PAYS)


def test_a_benchmark_with_friction_is_described_and_its_floor_is_unknown():
    env = EnvConfig(settings={"friction": {"mu": [0.02, 0.1], "shared": False}})
    text = description(env.arguments()["config"])
    assert "hidden coefficient between 0.02 and 0.1, its own for every tendon." in text
    benchmark = Benchmark(
        "some", [Recipe("one", [Run(RunFolder(Path()), TrainConfig(env=env), 0.0, np.zeros((3, 1)))])]
    )
    errors = episodes(np.array([1.0, 2.0]))
    scores = Scores({"one": [errors]}, {"do nothing": errors}, np.full(2, np.nan))
    *_, last = score_table(benchmark, scores).strip().splitlines()
    assert last.startswith("| floor | unknown |")


def test_a_comparison_is_paired_over_episodes_and_counts_seeds():
    own, other = np.array([[1.0, 2.0, 3.0], [1.2, 2.2, 3.2]]), np.array([1.2, 2.1, 3.3])
    found = Comparison.of(own, other)
    gains = np.array([0.1, 0.0, 0.2])  # other minus the mean of both runs
    assert found.gain_mm == pytest.approx(gains.mean())
    assert found.standard_error_mm == pytest.approx(gains.std(ddof=1) / np.sqrt(3))
    assert found.share == pytest.approx(0.1 / 2.2)
    assert (found.seeds_better, found.seeds) == (1, 2)
    assert Score.of(episodes(other)).mean_mm == pytest.approx(2.2)
