"""Records of results: what files keep, who is the best, and which verdict follows."""

import gzip
import json
from dataclasses import replace

import numpy as np
import pytest

from agents.results import Results, ResultsError, read_results
from agents.results.file import SCHEMA, write_results
from agents.results.page import Tables, page, summary_table
from agents.results.pictures import pictures
from agents.results.record import BASELINE, ENTRY, POLICY, SHIFT, SWEEP, TEST, VALIDATION, World
from agents.results.standings import FEEDBACK, Standings, Verdict
from agents.results.statistics import Interval
from agents.results.wording import change_text, in_short, verdict_text, with_interval
from tests.agents.results.made_up import CURVE, WORLDS, E, benchmark, controller, driven


def standing(*controllers) -> Standings:
    record = benchmark(*controllers)
    return Standings(record, record.worlds[0])


TEN = np.linspace(-0.02, 0.02, 10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("learned", "opponent", "feedback", "expected"),
    [
        (TEN, 0.5, 0.6, Verdict.PAYS),
        (TEN, 0.04, 0.6, Verdict.NARROWLY),
        (TEN, -0.1, 0.6, Verdict.BEATS_FEEDBACK),
        (TEN, 0.0, 0.0, Verdict.NO_DIFFERENCE),
        (TEN, -0.1, -0.05, Verdict.DOES_NOT),
        (20 * TEN, 0.04, 0.04, Verdict.NO_DIFFERENCE),  # the same mean as narrowly better, but the seeds differ
    ],
)
def test_the_verdict_follows_from_the_paired_bootstrap_over_seeds_and_episodes(learned, opponent, feedback, expected):
    found = standing(
        controller("learned", POLICY, *learned),
        controller("filter", BASELINE, opponent),
        controller(FEEDBACK, BASELINE, feedback, choose=0.3),
    )
    assert (found.policy, found.baseline, found.verdict) == ("learned", "filter", expected)
    text = verdict_text(found)
    assert ("Learning pays here" in text) == (expected == Verdict.PAYS)
    assert with_interval(found.mean("filter"), "{:.2f}".format) in text and "of 10 training seeds" in text
    assert "preliminary" not in text


def test_the_best_are_chosen_in_validation_and_never_privileged():
    found = standing(
        controller("good in the table", POLICY, 0.0, choose=0.5),
        controller("good in validation", POLICY, 0.2),
        controller("teacher", POLICY, -0.9, privileged=True),
        controller("open loop", BASELINE, 0.0, choose=0.5),
        controller("filter", BASELINE, 0.3),
        controller("true state", BASELINE, -0.9, privileged=True),
        controller("somebody's", ENTRY, -0.9),
    )
    assert (found.policy, found.baseline) == ("good in validation", "filter")
    table = Tables(found.record).table(found)
    assert "| teacher (privileged) |" in table and "| somebody's (entered) |" in table


def test_the_opponent_is_the_best_of_those_that_drove_in_the_world():
    found = standing(
        controller("learned", POLICY, 0.0),
        controller("smoother", BASELINE, 0.1, worlds=(VALIDATION,)),
        controller("filter", BASELINE, 0.3),
    )
    assert (found.baseline, found.verdict) == ("filter", Verdict.PAYS)


def test_without_a_learner_or_validation_there_is_no_verdict():
    assert standing(controller("filter", BASELINE, 0.3)).verdict == Verdict.UNKNOWN
    both = [controller("a", POLICY, 0.0, worlds=(TEST,)), controller("b", BASELINE, 0.3, worlds=(TEST,))]
    found = standing(*both)
    assert (found.policy, found.verdict) == (None, Verdict.UNKNOWN)
    assert verdict_text(found).startswith("No verdict:")
    assert "| [demo](#demo) | not compared | - |  | - |  |  | unknown |" in summary_table([Tables(found.record)])


@pytest.mark.parametrize(
    ("runs", "short", "few"),
    [
        (1, f"{Verdict.PAYS} (preliminary: 1 seed)", "A single training seed is"),
        (3, f"{Verdict.PAYS} (preliminary: 3 seeds)", "3 training seeds are"),
        (10, Verdict.PAYS, ""),
    ],
)
def test_few_training_seeds_are_called_preliminary(runs, short, few):
    found = standing(controller("a", POLICY, *TEN[:runs]), controller("filter", BASELINE, 0.5))
    text = verdict_text(found)
    assert in_short(found) == short
    assert text.startswith("**Preliminary: learning pays here.**" if few else "**Learning pays here.**")
    end = f"{few} no verdict about other seeds: that asks for 10." if few else "of 10 training seeds."
    assert text.endswith(end)


def test_other_worlds_show_what_they_make_of_every_controller():
    more, other = World("more", SHIFT, 9_000_000, E), World("other seeds", SHIFT, 1, E)
    worlds, everywhere = [*WORLDS, more, other], [world.name for world in (*WORLDS, more, other)]
    record = benchmark(
        controller("learned", POLICY, 0.0, 0.5, worlds=everywhere, noise=0.0),
        controller("filter", BASELINE, 1.0, worlds=everywhere, noise=0.0),
        worlds=worlds,
    )
    for one, factor in zip(record.controllers, (1.1, 2.0), strict=True):
        for run in one.runs:
            run.driven["more"] = driven(factor * run.driven[TEST].last)
    own, there, elsewhere = (Standings(record, record.world(name)) for name in (TEST, "more", "other seeds"))
    assert there.change("learned", own) == pytest.approx((0.1, 0.1, 0.1), abs=1e-6)
    assert elsewhere.change("learned", own) is None and change_text(own, own) == change_text(elsewhere, own) == ""
    text = change_text(there, own)
    assert text.endswith("that of learned by +10 [+10, +10] % and that of filter by +100 [+100, +100] %.")
    row = next(line for line in Tables(record).table(there).splitlines() if line.startswith("| filter"))
    assert row.endswith("| +100 [+100, +100] |")


def test_the_time_of_an_action_has_a_column_where_it_was_measured(tmp_path):
    record = benchmark(controller("learned", POLICY, 0.0, 0.5), controller("filter", BASELINE, 1.0))
    tables = Tables(record)
    assert "µs per action" not in tables.table(tables.worlds[0])
    for run, microseconds in zip(record.controllers[0].runs, (4.0, 5.0), strict=True):
        run.driven[TEST] = replace(run.driven[TEST], action_us=microseconds)
    write_results(tmp_path / "results.json", Results([record]))
    (record,) = read_results(tmp_path / "results.json").benchmarks
    tables = Tables(record)
    head, _, learned, other, *_ = tables.table(tables.worlds[0]).splitlines()
    column = [cell.strip() for cell in head.split("|")].index("µs per action")
    assert [row.split("|")[column].strip() for row in (learned, other)] == ["4.5", ""]


def test_what_it_takes_is_told_where_a_smoother_drives():
    learned = controller("learned", POLICY, 0.0)
    learned.runs[0].driven[TEST] = replace(learned.runs[0].driven[TEST], action_us=4.4)
    others = [
        controller("plain_ppo_demo", POLICY, 1.0),
        controller("smoother", BASELINE, -0.2),
        controller("mpc", BASELINE, -0.1),
        controller("filter", BASELINE, 0.5),
        controller("teacher", BASELINE, -1.0, privileged=True),
    ]
    text = page(Results([benchmark(learned, *others)]), {}, {})
    (row,) = [line for line in text.splitlines() if line.startswith("| [demo](#demo) | 2") and "filter:" in line]
    cells = [cell.strip() for cell in row.split("|")[2:-1]]
    assert cells[0].endswith(" / 4.4") and cells[1:2] == ["1.0"] and cells[4].startswith("filter: 2.")
    assert float(cells[2]) < float(cells[3]) < float(cells[0].split()[0]) < float(cells[5]) and cells[7] == ""
    assert "## What it takes" not in page(Results([benchmark(learned, others[2])]), {}, {})


def complete() -> Results:
    worlds = [
        replace(WORLDS[0], floors=np.where(np.arange(E) % 2, 0.01, np.nan)),
        WORLDS[1],
        World("more", SHIFT, 9_000_000, E, {"load": {"magnitude": [1.0, 1.5]}}, "More load than in training"),
        *(
            World(f"load {v:g}", SWEEP, 9_000_000, E, {"load": {"magnitude": [v, v]}}, "", "load [N]", v, (0.0, 1.0))
            for v in (0.0, 0.5)
        ),
    ]
    everywhere = [world.name for world in worlds]
    some = [
        controller("ppo_demo", POLICY, *TEN[:3], worlds=everywhere),
        controller("filter", BASELINE, 0.5, worlds=everywhere),
    ]
    record = replace(benchmark(*some, worlds=worlds), levels={"floor": 0.1}, impossible={"feedback": "No pose."})
    films = {"demo": {"demo.gif": "A film."}}
    return Results([record], ["python -m agents.results x"], ["here"], ["there"], {"runs/a": "broken"}, films)


@pytest.mark.parametrize("name", ["results.json", "results.json.gz"])
def test_a_file_holds_all_of_the_results_with_four_digits_and_reads_the_same_again(name, tmp_path):
    results, path = complete(), tmp_path / name
    write_results(path, results)
    found = read_results(path)
    write_results(tmp_path / f"again_{name}", found)
    assert (tmp_path / f"again_{name}").read_bytes() == path.read_bytes()
    (ours,), (read,) = results.benchmarks, found.benchmarks
    assert replace(found, benchmarks=[]) == replace(results, benchmarks=[])
    for one in ours.controllers:
        other = read.controller(one.name)
        assert (other.kind, other.training_seeds, other.training) == (one.kind, one.training_seeds, one.training)
        for world in ours.worlds:
            for what in ("last", "final", "held"):
                expected = one.errors(world.name, what)
                np.testing.assert_allclose(other.errors(world.name, what), expected, rtol=5.1e-4)
    np.testing.assert_allclose(read.worlds[0].floors, ours.worlds[0].floors)
    assert (read.levels, read.impossible, read.settings) == (ours.levels, ours.impossible, ours.settings)
    assert [replace(world, floors=None) for world in read.worlds] == [replace(w, floors=None) for w in ours.worlds]
    np.testing.assert_array_equal(read.controllers[0].runs[0].curve, CURVE)


def test_a_page_and_pictures_come_from_results_alone():
    results = complete()
    text = page(results, {"a.png": "A picture."}, results.films)
    assert "### More load than in training\n" in text and "![A film.](images/demo.gif)" in text
    assert "| floor | 0.010 | 0.010 |" in text and "Episodes without a known floor: 200." in text
    assert "Not possible here: feedback. No pose." in text and "Left out: `runs/a`: broken" in text
    names = {f"results_{name}.png" for name in ("learning_steps", "learning_time", "distribution", "load")}
    found = pictures(results)
    assert found.keys() == names
    assert all(content.startswith(b"\x89PNG") and caption for content, caption in found.values())


REMOVED = object()


def change(values, *keys, to):
    for key in keys[:-1]:
        values = values[key]
    if to is REMOVED:
        del values[keys[-1]]
    else:
        values[keys[-1]] = to


RUN = ("benchmarks", 0, "controllers", 0, "runs", 0)


@pytest.mark.parametrize(
    ("keys", "to", "message"),
    [
        (("schema",), SCHEMA + 1, "Another version of this package may read it"),
        (("format",), "mine", "format and schema"),
        (("benchmarks", 0, "worlds", 0, "role"), "exam", "role = 'exam': expected one of"),
        (("benchmarks", 0, "worlds", 1, "name"), "test", "different names"),
        (("benchmarks", 0, "controllers", 1, "name"), "ppo_demo", "different names"),
        (("benchmarks", 0, "controllers", 0, "kind"), "winner", "kind = 'winner'"),
        ((*RUN, "training_seed"), 2, "each with another seed"),
        ((*RUN, "driven", "test", "last_10_mm"), [1.0, 2.0], "expected"),
        ((*RUN, "driven", "test", "final_mm", 3), None, "finite errors"),
        ((*RUN, "driven", "test", "held"), "2" * E, "not found"),
        ((*RUN, "driven", "elsewhere"), {"last_10_mm": [1.0], "ended_early": 0}, "world 'elsewhere'"),
        ((*RUN, "curve"), {"steps": [1]}, "KeyError"),
        (("commands",), REMOVED, "KeyError"),
        (("benchmarks",), 3, "TypeError"),
    ],
)
def test_a_file_whose_parts_do_not_fit_is_one_line_that_names_it(keys, to, message, tmp_path):
    path = tmp_path / "own.json"
    write_results(path, complete())
    values = json.loads(path.read_text())
    change(values, *keys, to=to)
    path.write_text(json.dumps(values))
    with pytest.raises(ResultsError, match=message) as raised:
        read_results(path)
    assert "own.json" in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize("content", [b"", b"{}", b"[]", b"nonsense", gzip.compress(b"{}", mtime=0), None])
def test_what_is_no_results_file_is_refused(content, tmp_path):
    path = tmp_path / "some.json.gz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ResultsError, match=r"a file that rj results wrote"):
        read_results(path)


def test_intervals_are_written_beside_their_figure():
    assert with_interval(Interval(1.5, 1.25, 1.75), "{:.2f}".format) == "1.50 [1.25, 1.75]"
