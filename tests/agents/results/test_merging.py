"""Several results as one."""

from dataclasses import replace

import pytest

from agents.results import Results, ResultsError
from agents.results.environment import environment_of, episodes_key
from agents.results.merging import merged
from agents.results.record import BASELINE, ENTRY, POLICY, TEST, ControllerRecord, World
from agents.runs.environment import EnvConfig
from tests.agents.results.made_up import SETTINGS, E, benchmark, controller


def with_seed(record: ControllerRecord, *seeds) -> ControllerRecord:
    runs = [replace(run, training_seed=seed) for run, seed in zip(record.runs, seeds, strict=True)]
    return replace(record, runs=runs)


def test_other_training_seeds_and_other_controllers_are_merged():
    learned, opponent = controller("ppo", POLICY, 0.0, 0.1, 0.2), controller("filter", BASELINE, 0.5)
    here = Results([benchmark(with_seed(learned, 1, 2, 5), opponent)], ["one"], ["a"])
    there = Results([benchmark(with_seed(learned, 3, 4, 6), opponent, controller("mine", ENTRY, 0.1))], ["two"], ["a"])
    both = merged([here, there])
    (record,) = both.benchmarks
    assert record.names() == ["ppo", "filter", "mine"]
    assert record.controller("ppo").training_seeds == [1, 2, 3, 4, 5, 6]
    assert (both.commands, both.scored_on) == (["one", "two"], ["a"])
    assert record.best(POLICY) == "ppo"


def test_benchmarks_are_the_same_whatever_is_the_learner_s_own_matter():
    """Rewards do not change the episodes; settings that an older file does not have are the defaults."""
    older = {key: value for key, value in SETTINGS.items() if key not in ("start_tension", "friction")}
    other = {**SETTINGS, "reward": {**SETTINGS["reward"], "effort": 0.5}}
    heavy = {**SETTINGS, "load": {**SETTINGS["load"], "magnitude": [0.0, 2.0]}}
    records = [
        benchmark(controller(name, BASELINE, 0.1), settings=s)
        for name, s in zip("abc", (SETTINGS, older, other), strict=True)
    ]
    (record,) = merged([Results([one]) for one in records]).benchmarks
    assert record.names() == ["a", "b", "c"]
    third = benchmark(controller("d", BASELINE, 0.1), settings=heavy, title="heavy")
    assert [one.title for one in merged([Results(records[:1]), Results([third])]).benchmarks] == ["demo", "heavy"]
    with pytest.raises(ResultsError, match="another title for every task"):
        merged([Results(records[:1]), Results([replace(third, title="demo")])])
    assert episodes_key(environment_of(records[0])) == episodes_key(EnvConfig("rj_gym/RollingJointGoal-v0"))


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (benchmark(controller("ppo", POLICY, 0.2)), "mean error in 'test' = .*as in the other file"),
        (benchmark(controller("ppo", BASELINE, 0.0)), "kind = 'baseline'"),
        (
            benchmark(worlds=[World(TEST, TEST, 1, E)]),
            r"world 'test' = 'range\(1, 401\), \{\}': expected test episodes range\(9000000, 9000400\)",
        ),
    ],
)
def test_results_that_contradict_each_other_are_not_merged(other, message):
    with pytest.raises(ResultsError, match=message):
        merged([Results([benchmark(controller("ppo", POLICY, 0.0))]), Results([other])])
