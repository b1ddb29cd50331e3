"""Scores and reports from errors that are known."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from agents.controllers import DoNothing, JacobianFeedback
from agents.evaluate import evaluate_controllers
from agents.evaluation import pictures
from agents.evaluation.floor import episode_floor
from agents.evaluation.pictures import animation, error_distribution, error_over_time
from agents.evaluation.report import EvaluationReport
from agents.evaluation.rollout import Episodes
from agents.evaluation.score import Score
from agents.runs.environment import EnvConfig


def episodes(final, before=0.5, rewards=0.0, terminated=False):
    """Episodes of 12 steps that are at `before` until the last one."""
    final = np.asarray(final, float)
    errors = np.full((len(final), 13), before)
    errors[:, -1] = final
    ended = np.full(len(final), terminated)
    return Episodes(np.arange(len(final)), errors, np.full(len(final), rewards), ended)


def test_a_score_is_what_its_names_say():
    score = Score.of(episodes([0.2, 0.4, 1.0, 3.0], rewards=-2.0, terminated=True))
    assert (score.mean_mm, score.median_mm) == (pytest.approx(1.15), pytest.approx(0.7))
    assert score.p95_mm == pytest.approx(2.7)
    assert (score.within_1_mm, score.held_1_mm) == (0.75, 0.75)
    assert (score.mean_reward, score.ended_early, score.regret_mm) == (-2.0, 4, None)
    assert score.last_10_mm == pytest.approx((9 * 0.5 + 1.15) / 10)


def test_held_asks_for_all_of_the_last_ten_steps():
    some = episodes([0.2, 0.2, 0.2])
    some.errors[0, -10] = 1.1
    some.errors[1, -11] = 1.1
    assert Score.of(some).held_1_mm == pytest.approx(2 / 3)


def test_the_last_steps_are_those_after_the_start_where_there_are_fewer_than_ten():
    few = Episodes(np.arange(1), np.array([[9.0, 2.0, 4.0]]), np.zeros(1), np.zeros(1, bool))
    assert Score.of(few).last_10_mm == 3.0


def test_regret_is_the_mean_of_error_minus_floor_where_there_is_a_floor():
    floors = np.array([0.1, 0.1, np.inf])
    assert Score.of(episodes([0.2, 0.4, 9.0]), floors).regret_mm == pytest.approx(0.2)
    assert Score.of(episodes([0.2]), np.array([np.inf])).regret_mm is None


def test_a_report_holds_every_error_and_every_floor_as_strict_json():
    report = EvaluationReport(
        {"one": episodes([0.2, 3.0]), "two": episodes([0.5, 0.6])}, 100.0, np.array([0.1, np.inf])
    )
    values = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert values["final_errors_mm"] == {"one": [0.2, 3.0], "two": [0.5, 0.6]}
    assert values["floors_mm"] == [0.1, None]
    assert values["seeds"] == [0, 1]
    assert values["scores"]["one"]["regret_mm"] == pytest.approx(0.1)


def test_the_table_ends_with_the_floor():
    report = EvaluationReport({"one": episodes([0.2, 3.0])}, 100.0, np.array([0.1, 0.2]), {"run": "somewhere"})
    rows = report.table()
    assert [row[0] for row in rows] == ["controller", "one", "floor"]
    assert rows[1][1:] == ["1.60 mm", "1.60 mm", "2.86 mm", "0.610 mm", "50.0 %", "50.0 %", "1.45 mm"]
    assert rows[2][1:6] == ["0.150 mm", "0.150 mm", "0.195 mm", "", "100.0 %"]
    assert len({len(row) for row in rows}) == 1
    assert rows[2] not in replace(report, floors=None).table()
    assert "| one | 1.60 mm |" in report.markdown({"one": "the first"}, {})
    assert "floor" not in replace(report, floors=None).markdown({}, {})


def test_controllers_are_scored_on_the_same_episodes_and_against_their_floors():
    env, seeds = EnvConfig(settings={"episode_steps": 25}), range(9000, 9006)
    report = evaluate_controllers(env, {"feedback": JacobianFeedback(), "nothing": DoNothing()}, seeds)
    np.testing.assert_array_equal(report.floors, episode_floor(env, seeds).errors)
    np.testing.assert_array_equal(report.episodes["feedback"].errors[:, 0], report.episodes["nothing"].errors[:, 0])
    assert (report.length_mm, report.seeds) == (100.0, list(seeds))
    assert 0 <= report.scores["feedback"].regret_mm < 0.1 < report.scores["nothing"].regret_mm
    assert evaluate_controllers(env, {"nothing": DoNothing()}, seeds, with_floor=False).floors is None


def test_no_controller_is_below_the_floor_of_any_step_of_a_moving_target():
    path = {"target": {"process": "path"}, "load": {"magnitude": [2.0, 2.0]}, "mechanism": "five_link"}
    env, seeds = EnvConfig(settings=path), range(9000, 9010)
    report = evaluate_controllers(env, {"feedback": JacobianFeedback()}, seeds, moments=6)
    errors, steps = report.episodes["feedback"].errors, [0, 10, 20, 30, 40, 50]
    assert list(report.floors_at) == steps
    floors = np.stack([report.floors_at[step] for step in steps], axis=1)
    assert np.all(errors[:, steps] >= floors - 1e-9)
    assert np.any(errors[:, 20:40].min(axis=1) < report.floors)  # that of the last step is none of theirs
    np.testing.assert_array_equal(floors[:, -1], report.floors)
    np.testing.assert_array_equal(floors[:, 2], episode_floor(env, seeds, [20]).errors[:, 0])


def test_every_floor_is_drawn_at_its_own_step(monkeypatch):
    monkeypatch.setattr(pictures, "png", lambda figure: figure)
    floors = {0: [0.3, np.inf], 4: [0.1, 0.1], 8: [np.inf, np.inf], 12: [1e-9, 1e-9]}
    floors = {step: np.array(some) for step, some in floors.items()}
    for axes in error_over_time({"one": episodes([0.2, 3.0]).errors}, floors).axes:
        (drawn,) = [line for line in axes.lines if line.get_label() == "floor"]
        assert drawn.get_linestyle() == "None" and drawn.get_marker() == "o"
        np.testing.assert_allclose(drawn.get_xydata(), [[0, 0.3], [4, 0.1], [12, 0.001]])


def test_with_friction_a_report_says_why_there_is_no_floor():
    env = EnvConfig(settings={"episode_steps": 5, "friction": {"mu": 0.1}})
    report = evaluate_controllers(env, {"nothing": DoNothing(), "feedback": JacobianFeedback()}, range(3))
    assert report.floors is None and report.scores["nothing"].regret_mm is None
    for text in (report.text(), report.markdown({}, {}), report.to_dict()["no_floor"]):
        assert "no floor is known that holds for every path" in text
    assert "floor" not in evaluate_controllers(env, {"nothing": DoNothing()}, [0], with_floor=False).text()


def test_pictures_are_drawn_with_and_without_floors():
    errors = {f"controller {k}": episodes(np.geomspace(1e-5, 10, 20)).errors for k in range(9)}
    assert error_over_time(errors, {12: np.geomspace(1e-6, 1, 20)}).startswith(b"\x89PNG")
    assert error_distribution(errors, None).startswith(b"\x89PNG")
    frames = [np.full((60, 72, 3), value, np.uint8) for value in (0, 100, 200)]
    names = {"one": frames, "two": frames[:2], "three": frames}
    for columns, size in ((None, (308, 117)), (2, (204, 238))):  # three pictures of 100 by 83 + 34, with 4 between
        made = Image.open(io.BytesIO(animation(names, 100, columns)))
        assert (made.format, made.size, made.n_frames) == ("GIF", size, 3)
