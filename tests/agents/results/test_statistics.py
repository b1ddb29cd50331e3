"""The two-level bootstrap: against closed forms and brute force, and how often its intervals cover the truth."""

import numpy as np
import pytest
from scipy.stats import trim_mean

from agents.results.statistics import Bootstrap, Interval
from rollingjoint.errors import InvalidInput


def errors(runs, episodes, seed=0):
    return np.random.default_rng(seed).gamma(1.0, 1.0, (runs, episodes))


def test_statistics_are_means_over_the_runs_of_those_of_numpy_and_scipy():
    values = errors(3, 101)
    found = Bootstrap(101, resamples=10).summary(values)
    assert found.mean.value == pytest.approx(values.mean())
    assert found.iqm.value == pytest.approx(np.mean([trim_mean(run, 0.25) for run in values]))
    assert found.median.value == pytest.approx(np.median(values, axis=1).mean())
    assert found.p95.value == pytest.approx(np.percentile(values, 95, axis=1).mean())


def test_every_resample_is_what_brute_force_makes_of_the_same_draws():
    """Two controllers, all statistics, resample by resample: run shares and episode counts as index lists."""
    own, other = errors(4, 23), errors(2, 23, seed=1)
    bootstrap = Bootstrap(23, resamples=50, level=0.8)
    shares = [
        np.round(bootstrap._run_shares(len(some), k) * len(some)).astype(int) for k, some in enumerate((own, other))
    ]
    rows = {name: [] for name in ("mean", "iqm", "median", "p95", "difference", "ratio", "improvement")}
    for r in range(50):
        episodes = np.repeat(np.arange(23), bootstrap._counts[:, r])
        ours, theirs = (
            np.repeat(some, share[r], axis=0)[:, episodes] for some, share in zip((own, other), shares, strict=True)
        )
        rows["mean"].append(ours.mean())
        rows["iqm"].append(np.mean([trim_mean(run, 0.25) for run in ours]))
        rows["median"].append(np.median(ours, axis=1).mean())
        rows["p95"].append(np.percentile(ours, 95, axis=1).mean())
        rows["difference"].append(ours.mean() - theirs.mean())
        rows["ratio"].append(ours.mean() / theirs.mean() - 1)
        rows["improvement"].append(np.mean(ours[:, None] < theirs[None]))
    assert all(len(np.unique(values)) > 10 for values in rows.values())
    summary, comparison = bootstrap.summary(own), bootstrap.compare(own, other)
    for name, values in rows.items():
        found = getattr(summary, name, None) or getattr(comparison, name)
        assert (found.low, found.high) == pytest.approx(np.percentile(values, [10, 90]), rel=1e-5), name


def test_the_interval_of_one_run_is_that_of_the_normal_approximation():
    values = np.random.default_rng(0).normal(5.0, 2.0, 1000)
    found = Bootstrap(1000).mean(values)
    half = 1.96 * values.std() / np.sqrt(1000)
    assert (found.low, found.high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.05 * half)


def test_runs_that_are_equal_add_nothing_and_runs_that_differ_widen_the_interval():
    one = errors(1, 200)
    bootstrap = Bootstrap(200, resamples=2000)
    alone, copies = bootstrap.mean(one), bootstrap.mean(np.repeat(one, 5, axis=0))
    assert copies == pytest.approx(alone)
    wide = bootstrap.mean(one + np.linspace(-1, 1, 5)[:, None])
    runs, episodes = np.linspace(-1, 1, 5).std() / np.sqrt(5), one.std() / np.sqrt(200)
    assert wide.high - wide.low == pytest.approx(2 * 1.96 * np.hypot(runs, episodes), rel=0.08)


def test_differences_are_paired_over_the_episodes():
    own = errors(1, 300)
    bootstrap = Bootstrap(300, resamples=2000)
    shifted = bootstrap.compare(own, own + 0.1)
    assert tuple(shifted.difference) == pytest.approx((-0.1, -0.1, -0.1), abs=1e-6)
    assert not bootstrap.mean(own).is_separate_from(bootstrap.mean(own + 0.1))
    assert shifted.difference.sign == -1 and tuple(shifted.improvement) == (1.0, 1.0, 1.0)
    assert (shifted.runs_better, shifted.runs) == (1, 1)
    strangers = bootstrap.compare(own, errors(1, 300, seed=7) + 0.1)
    assert strangers.difference.high - strangers.difference.low > 0.2


def test_training_seeds_of_two_controllers_are_drawn_independently():
    """Seed 3 of one has nothing to do with seed 3 of another, whatever order their means are in."""
    own = errors(1, 200) + np.linspace(-1, 1, 6)[:, None]
    found = Bootstrap(200, resamples=2000).compare(own, own + 0.1)
    spread = np.linspace(-1, 1, 6).std() / np.sqrt(6)
    assert found.difference.high - found.difference.low == pytest.approx(2 * 1.96 * np.sqrt(2) * spread, rel=0.08)


def test_a_change_between_two_worlds_is_of_the_same_runs_and_episodes():
    own = errors(4, 200) + np.linspace(0, 3, 4)[:, None]
    found = Bootstrap(200, resamples=2000).change(1.2 * own, own)
    assert tuple(found) == pytest.approx((0.2, 0.2, 0.2), abs=1e-5)
    assert Bootstrap(200, resamples=2000).change(errors(4, 200, seed=7), own).low < -0.5
    with pytest.raises(InvalidInput, match="before"):
        Bootstrap(200).change(own, own[:, :100])


def test_equal_errors_count_half_and_a_perfect_opponent_has_no_ratio():
    zeros = np.zeros(20)
    found = Bootstrap(20, resamples=100).compare(zeros, zeros)
    assert tuple(found.improvement) == (0.5, 0.5, 0.5) and found.difference.sign == 0
    assert all(np.isnan(found.ratio))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("runs", "spread", "low", "high"), [(3, 0.3, 0.68, 0.82), (10, 0.3, 0.86, 0.95), (10, 0.03, 0.92, 0.99)]
)
def test_intervals_cover_the_true_mean_as_often_as_the_module_says(runs, spread, low, high):
    rng, trials, covered = np.random.default_rng(5), 300, 0
    bootstrap = Bootstrap(200, resamples=600)
    for _ in range(trials):
        hard = 0.5 * rng.exponential(size=200)
        found = bootstrap.mean(0.5 + spread * rng.normal(size=(runs, 1)) + hard + 0.3 * rng.normal(size=(runs, 200)))
        covered += found.low <= 1.0 <= found.high
    assert low <= covered / trials <= high


def test_the_same_seed_gives_the_same_interval_and_another_one_a_near_one():
    values = errors(5, 100)
    first, again, other = (Bootstrap(100, resamples=3000, seed=seed).summary(values) for seed in (0, 0, 1))
    assert first == again != other
    assert other.iqm == pytest.approx(first.iqm, rel=0.05)


@pytest.mark.parametrize(
    "values", [np.zeros((2, 4)), np.zeros((0, 5)), np.full(5, np.nan), [[1.0], [1.0, 2.0]], np.zeros((1, 1, 5))]
)
def test_values_that_do_not_fit_are_refused(values):
    with pytest.raises(InvalidInput, match="finite numbers of shape"):
        Bootstrap(5, resamples=3).summary(values)


def test_intervals_say_whether_they_are_separate_and_on_which_side_of_zero():
    assert Interval(1.5, 1.0, 2.0).is_separate_from(Interval(3.0, 2.5, 4.0))
    assert not Interval(1.5, 1.0, 2.0).is_separate_from(Interval(1.9, 1.9, 3.0))
    assert [Interval(0.0, *ends).sign for ends in ((-2, -1), (-1, 1), (1, 2))] == [-1, 0, 1]
