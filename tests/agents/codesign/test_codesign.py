"""Co-design: gradients of whole rollouts, training, rivals, the command and what it leaves."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from agents.codesign.__main__ import main
from agents.codesign.config import PairConfig, load_codesign
from agents.codesign.generalist import trained_generalist
from agents.codesign.hold import TipHold
from agents.codesign.lumen import LumenPush
from agents.codesign.pair import PairSettings, Splits, trained
from agents.codesign.policy import FlatPolicy
from agents.codesign.report import spearman
from agents.codesign.rivals import best_design, random_designs
from agents.codesign.study import Study
from agents.codesign.task import Slope
from agents.search.methods import make
from agents.search.optimiser import Setup
from rollingjoint.design import DesignSpace, LateralStiffness, Limit, Problem, Term
from rollingjoint.errors import ConfigError
from rollingjoint.io.mechanism_file import load_mechanism

torch.set_num_threads(1)

ROOT = Path(__file__).resolve().parents[3]
INSTRUMENT = ROOT / "configs/mechanism/lumen_instrument.yaml"
SHIPPED = sorted((ROOT / "configs/codesign").glob("*.yaml"))
STIFF = LateralStiffness(tensions=((5.0, 5.0, 5.0, 5.0),), force=0.05)
SMALL = f"""
task: {{kind: lumen, family: hard, mu: 0.3, low: 2.0, steps: 8, feed_mm: 5.0, hidden: []}}
space: {{mechanism: {INSTRUMENT}, convexity: [-0.1, 0.12], hole_radius: [-1.0, 0.6], symmetric: true}}
limits:
  - {{kind: lateral_stiffness, tensions: [[5, 5, 5, 5]], force: 0.05, low: reference}}
objectives:
  - {{kind: lateral_stiffness, tensions: [[5, 5, 5, 5]], force: 0.05}}
  - {{kind: lateral_stiffness, tensions: [[5, 5, 5, 5]], force: 0.05, opposite: true}}
pairs: {{updates: 3, batch: 3, check_every: 2}}
episodes: [4, 3, 4]
rival_budget: 6
rival_starts: 3
random: 4
random_updates: 1
search:
  retrained: {{methods: {{random: {{batch: 2}}}}, budget: 4, updates: 1}}
  generalist: {{methods: {{random: {{}}}}, budget: 6, updates: 3}}
seeds: [1, 2]
"""


def space():
    ranges = {"convexity": (-0.1, 0.12), "hole_radius": (-1.0, 0.6), "symmetric": True}
    return DesignSpace.of(load_mechanism(INSTRUMENT), **ranges)


def stiff_problem(designs):
    return Problem(designs, (), (Limit(STIFF, low=0.00347),))


def slopes(task, episodes):
    """Slopes of the loss along a random change of design and of policy, by the gradient and by differences."""
    rng = np.random.default_rng(1)
    x = np.asarray(task.space.reference())
    theta = task.policy.initial(0) + 0.1 * rng.normal(size=task.policy.size)
    ways = rng.normal(size=len(x)), rng.normal(size=len(theta))
    slope = task.slope(x, theta, episodes)
    losses = [
        [task.slope(x + h * a, theta + h * b, episodes, by_design=False).loss for h in (1e-5, -1e-5)]
        for a, b in ((ways[0], 0.0 * ways[1]), (0.0 * ways[0], ways[1]))
    ]
    by_gradient = [slope.design @ ways[0], slope.policy @ ways[1]]
    return by_gradient, [(above - below) / 2e-5 for above, below in losses]


@pytest.mark.slow
@pytest.mark.parametrize(("goal", "mu", "exact"), [("force", 0.0, 1e-6), ("force", 0.15, 1e-2), ("reach", 0.0, 1e-6)])
def test_gradient_in_the_lumen_is_that_of_whole_rollouts(goal, mu, exact):
    task = LumenPush(goal=goal, mu=mu, steps=8, feed_mm=5.0, force_limit=0.3).on(space())
    by_gradient, by_differences = slopes(task, task.episodes(range(3)))
    assert min(map(abs, by_gradient)) > 1e-3
    assert by_gradient == pytest.approx(by_differences, rel=exact)


@pytest.mark.parametrize("goal", ["precision", "force"])
def test_gradient_at_the_tip_is_that_of_whole_rollouts(goal):
    task = TipHold(goal=goal, steps=6, low=1.0).on(DesignSpace.of("two_segment", hole_radius=(-1, 1)))
    by_gradient, by_differences = slopes(task, task.episodes(range(3)))
    assert by_gradient == pytest.approx(by_differences, rel=1e-5)


def test_episodes_depend_on_their_seeds_alone_and_not_on_the_batch():
    hold = TipHold().on(DesignSpace.of("two_segment"))
    alone, together = hold.episodes([7]), hold.episodes([6, 7])
    assert np.array_equal(alone.targets[0], together.targets[1]) and np.array_equal(alone.forces[0], together.forces[1])
    lumen = LumenPush().on(space())
    chosen = lumen.chosen(lumen.episodes([6, 7]), np.array([1]))
    assert np.array_equal(chosen.line, lumen.episodes([7]).line)


def test_a_force_is_carried_up_to_the_level_before_the_first_error_above_the_tolerance():
    settings = TipHold(goal="force", force=(0.0, 1.0), steps=8, tolerance_mm=100.0)
    task = settings.on(DesignSpace.of("two_segment"))
    x, theta, episodes = np.asarray(task.space.reference()), task.policy.initial(0), task.episodes(range(2))
    assert task.scores(x, theta, episodes).values == pytest.approx([1.0, 1.0])
    small = TipHold(goal="force", force=(0.0, 1.0), steps=8, tolerance_mm=1e-3).on(task.space)
    assert np.array_equal(small.scores(x, theta, episodes).values, [0.0, 0.0])


def test_the_reach_is_the_depth_before_the_force_exceeds_the_limit():
    settings = LumenPush(family="hard", goal="reach", steps=10, feed_mm=6.0, force_limit=100.0)
    designs = space()
    task = settings.on(designs)
    x, theta, episodes = np.asarray(designs.reference()), task.policy.initial(0), task.episodes(range(4))
    deep = task.scores(x, theta, episodes)
    assert np.array_equal(deep.values, deep.extra["depth [mm]"]) and deep.ok.all()
    peaks = deep.extra["peak wall force [N]"]
    below = replace(settings, force_limit=float(peaks.min() * (1.0 - 1e-9))).on(designs).scores(x, theta, episodes)
    assert (below.values < deep.values).all() and np.array_equal(below.extra["peak wall force [N]"], peaks)
    force = replace(settings, goal="force").on(designs).scores(x, theta, episodes)
    assert np.array_equal(force.values, peaks)
    assert np.array_equal(force.extra["reach below the limit [mm]"], deep.values)
    assert task.settings.maximise and not LumenPush().maximise


def test_a_policy_begins_with_actions_of_zero_and_is_a_network():
    policy = FlatPolicy(3, 2, (4,))
    theta = policy.initial(1)
    assert len(theta) == policy.size == 4 * 4 + 5 * 2
    seen = torch.ones(5, 3, dtype=torch.float64)
    assert not policy(torch.tensor(theta), seen).any()
    assert policy(torch.tensor(theta + 0.5), seen).abs().max() < 1.0
    assert not np.array_equal(theta, policy.initial(2))


@pytest.mark.slow
def test_training_improves_the_pair_and_keeps_the_limits():
    designs = space()
    problem, task = stiff_problem(designs), LumenPush(family="hard", mu=0.3, low=2.0, hidden=(), steps=10).on(designs)
    splits = Splits(task.episodes(range(4)), 4, task.episodes(range(10, 13)), None)
    settings = PairSettings(updates=6, batch=4, check_every=3)
    start = np.asarray(designs.reference()), task.policy.initial(0)
    before = task.scores(*start, splits.validation).values.mean()
    alone = trained(task, problem, start, settings, splits, 1, by_design=False)
    both = trained(task, problem, start, settings, splits, 1)
    assert both.validation < before and alone.validation < before
    assert np.array_equal(alone.x, start[0]) and not np.array_equal(both.x, start[0])
    assert problem.evaluate(both.x[None]).feasible.all()


def test_a_generalist_learns_policies_that_change_with_the_design():
    class Task:
        """The best policy of a design is an affine function of it."""

        space, best = space(), np.random.default_rng(0).normal(size=(3, 18))

        def chosen(self, episodes, rows):
            return episodes

        def slope(self, x, parameters, episodes, by_design):
            lack = parameters - 1.0 - self.best @ x
            return Slope(float(lack @ lack), 0.0 * x, 2.0 * lack)

    task, rng = Task(), np.random.default_rng(1)
    designs, settings = rng.uniform(-1.0, 1.0, (400, 18)), PairSettings(policy_rate=0.3)
    generalist = trained_generalist(task, designs, np.zeros(3), settings, Splits(None, 4, None, None), 1)
    for x in rng.uniform(-1.0, 1.0, (5, 18)):
        assert generalist(x) == pytest.approx(1.0 + task.best @ x, abs=0.1)


def test_rivals_are_the_best_of_their_objective_and_random_designs_keep_the_limits():
    designs = space()
    limits = stiff_problem(designs)
    stiffest = Problem(designs, (Term(STIFF, scale=0.00347),), limits.limits)
    x, cost = best_design(stiffest, make("gradient", Setup(designs.dimensions, (), 1), {"starts": 4}), 24)
    assert stiffest.evaluate(x[None]).values[0, 0] > 1.5 * 0.00347 and np.isfinite(cost)
    drawn = random_designs(limits, 6, 3)
    assert limits.evaluate(drawn).feasible.all() and len(np.unique(drawn[:, 0])) == 6
    unreachable = Problem(designs, (), (Limit(STIFF, low=1.0),))
    nothing, infinite = best_design(unreachable, make("random", Setup(designs.dimensions, (), 1), {}), 4)
    assert np.array_equal(nothing, designs.reference()) and infinite == np.inf


def test_rank_correlation_is_that_of_scipy():
    from scipy.stats import spearmanr

    one, other = np.random.default_rng(2).integers(0, 5, (2, 30)).astype(float)
    assert spearman(one, other) == pytest.approx(spearmanr(one, other).statistic)
    assert np.isnan(spearman(np.ones(4), np.arange(4.0)))


@pytest.mark.slow
@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_shipped_files_can_be_built(file, tmp_path):
    study = Study(tmp_path, load_codesign(file))
    assert study.rivals and len(list(study.units())) > 10


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"task": {"kind": "lumens"}}, "task.kind"),
        ({"task": {"kind": "lumen", "low": 4.0}}, "task.start_tension"),
        ({"task": {"kind": "hold", "force": 3}}, "task.force"),
        ({"episodes": [1, 2]}, "three numbers"),
        ({"seeds": [1, 1]}, "every seed once"),
        ({"pairs": {"update": 3}}, "pairs: unknown key"),
        ({"search": {"blind": {}}}, "search: unknown key"),
        ({"search": {"generalist": {"updates": 0}}}, "search.updates"),
        ({"objectives": [{"weight": 1}]}, "kind"),
    ],
)
def test_wrong_settings_are_one_line(change, message):
    with pytest.raises(ConfigError, match=message):
        PairConfig(**(yaml.safe_load(SMALL) | change))


def test_a_search_of_earlier_files_retrains_policies():
    methods = {"methods": {"random": {}}, "budget": 3}
    former, now = (
        PairConfig(**(yaml.safe_load(SMALL) | {"search": each})) for each in (methods, {"retrained": methods})
    )
    assert former.search_settings() == now.search_settings() and now.search_settings()["retrained"].budget == 3


def test_a_pair_needs_no_objectives_and_no_limits(tmp_path):
    space = {"mechanism": "two_segment", "hole_radius": [-2, 2]}
    study = Study(tmp_path, PairConfig(task={"kind": "hold", "goal": "precision"}, space=space))
    assert not study.rivals
    assert study.problem.evaluate(np.full((1, study.problem.dimensions), 0.5)).feasible.all()


def test_lumens_want_planar_designs_of_one_height():
    with pytest.raises(ConfigError, match="in the plane"):
        LumenPush().on(DesignSpace.of("pitch_yaw"))
    with pytest.raises(ConfigError, match="the same for all designs"):
        LumenPush().on(DesignSpace.of("two_segment", height=(-1, 1)))


@pytest.mark.slow
def test_the_command_writes_a_report_and_goes_on_where_it_stopped(tmp_path, capsys):
    file, out = tmp_path / "small.yaml", tmp_path / "out"
    file.write_text(SMALL)
    assert main([str(file), "--out", str(out)]) == 0
    assert "Co-design" in capsys.readouterr().out
    first = json.loads((out / "report.json").read_text())
    assert {"joint", "reference", "lateral_stiffness, opposite", "search random, retrained"} <= first["means"].keys()
    assert "search random, generalist" in first["means"]
    assert load_mechanism(out / "winner.yaml").n_links == 9
    assert {"designs.png", "morph.gif", "report.md"} <= {path.name for path in out.iterdir()}
    unit = out / "units/joint/seed_2.json"
    before = json.loads(unit.read_text())
    unit.unlink()
    assert main([str(file), "--out", str(out)]) == 0
    after = json.loads(unit.read_text())
    assert {k: v for k, v in before.items() if k != "seconds"} == {k: v for k, v in after.items() if k != "seconds"}
    file.write_text(SMALL.replace("batch: 3", "batch: 2"))
    capsys.readouterr()
    assert main([str(file), "--out", str(out)]) == 2
    assert "the co-design that the file describes now" in capsys.readouterr().err
