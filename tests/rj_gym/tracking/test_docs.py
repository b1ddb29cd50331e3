"""docs/environment.md and docs/arm_environment.md say what the code does: examples run, tables are the code's."""

import dataclasses
import re
from pathlib import Path

import pytest
import yaml

import rj_gym
from rj_gym.tracking.options import ARM_OPTIONS, OPTIONS
from tests.pages import bounds, examples, rows

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGE, ARM_PAGE = ((DOCS / name).read_text() for name in ("environment.md", "arm_environment.md"))
EXAMPLES = examples(PAGE)
SETTINGS = {
    name: page
    for page, names in {
        PAGE: (
            "TrackingConfig",
            "LoadConfig",
            "TargetConfig",
            "RewardConfig",
            "RandomizationConfig",
            "FrictionConfig",
            "SensingConfig",
            "ActuationConfig",
        ),
        ARM_PAGE: (
            "FlexibleArmConfig",
            "GravityConfig",
            "PayloadConfig",
            "ArmTargetConfig",
            "ArmRewardConfig",
            "ArmRandomizationConfig",
        ),
    }.items()
    for name in names
}
NESTED = {"load", "target", "reward", "randomization", "gravity", "sensing", "actuation", "terms"}
WORLDS = ["Instrument", "InstrumentShift", "SlowCamera", "LatePose", "ArmInstrument"]
TASKS = {"planar": (PAGE, "RollingJoint", OPTIONS), "arm": (ARM_PAGE, "FlexibleArm", ARM_OPTIONS)}
tasks = pytest.mark.parametrize(("page", "stem", "options"), TASKS.values(), ids=TASKS.keys())


@pytest.mark.parametrize(("program", "output"), EXAMPLES)
def test_example_prints_what_the_page_says(program, output, capsys):
    exec(program, {})
    assert capsys.readouterr().out == output


def test_every_python_block_has_its_output():
    assert PAGE.count("```python") == len(EXAMPLES) == 9


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_table_has_every_key_and_its_default(name):
    default = getattr(rj_gym, name)()
    table = {key: yaml.safe_load(value) for key, value, *_ in rows(SETTINGS[name], f"### {name}")[1:]}
    fields = {f.name: getattr(default, f.name) for f in dataclasses.fields(default) if f.name not in NESTED}
    assert table == {key: list(value) if isinstance(value, tuple) else value for key, value in fields.items()}


def test_the_table_of_worlds_has_every_one_with_its_differences_from_the_tracking_tasks():
    found = {name: [yaml.safe_load(cell) for cell in cells] for name, *cells in rows(PAGE, "## Worlds without the tip")}
    assert [name for name in found if name != "world"] == [f"rj_gym/{stem}-v0" for stem in WORLDS]
    for stem in WORLDS:
        config = getattr(rj_gym, f"{stem}Config")()
        pose, play, sheath = found[f"rj_gym/{stem}-v0"][:3]
        assert pose.split(",")[0] == config.sensing.pose
        assert tuple(play) == config.actuation.play_mm and tuple(sheath) == config.actuation.sheath_friction


@pytest.mark.parametrize("stem", WORLDS)
def test_version_1_of_a_world_differs_by_the_settings_of_its_table(stem):
    table = dict(row[:2] for row in rows(PAGE, "### Version 1: the motors of a rig")[1:])
    changes: dict = {}
    for name, value in table.items():
        *section, key = name.split(".")
        (changes.setdefault(section[0], {}) if section else changes)[key] = yaml.safe_load(value)
    first, second = (getattr(rj_gym, f"{stem}{version}Config")() for version in ("", "V1"))
    assert dataclasses.asdict(first.updated(changes)) == dataclasses.asdict(second)


@pytest.mark.parametrize("stem", WORLDS)
def test_docstrings_of_worlds_table_what_the_tracking_tasks_do_not_observe(stem):
    kind, table = getattr(rj_gym, f"{stem}Env"), {}
    for each in (*reversed(kind.__mro__), rj_gym.InstrumentEnv, rj_gym.SlowCameraEnv):
        table |= bounds(each.__doc__ or "")
    for entry in kind(observe_history=[2]).task.entries():
        name = re.sub(
            r"(link) \d", r"\1 k", re.sub(r"(tendon) \d", r"\1 j", entry.name.replace(", lag 2", " at lag l"))
        )
        assert table[name] == (f"{entry.low:g}", f"{entry.high:g}"), entry.name


@tasks
def test_options_table_is_complete(page, stem, options):
    assert [key for key, *_ in rows(page, "## Fixing an episode")[1:]] == list(options)


def test_info_table_is_complete():
    env = rj_gym.RollingJointGoalEnv()
    _, start = env.reset(seed=0)
    info = env.step([0.0, 0.0])[-1]
    named = {name for key, *_ in rows(PAGE, "## Info")[1:] for name in re.findall(r"\w+", key)}
    assert named == start.keys() | info.keys()


def test_info_table_of_friction_is_complete():
    plain, rubbed = (env.reset(seed=0)[1] for env in (rj_gym.RollingJointEnv(), rj_gym.RollingJointEnv(friction={})))
    named = dict(rows(PAGE, "\n## Friction\n")[1:])
    assert named.keys() - {"sampled"} == rubbed.keys() - plain.keys()
    drawn = set(re.findall(r"`(\w+)`", named["sampled"]))
    assert drawn == rubbed["sampled"].keys() - plain["sampled"].keys()


def test_info_of_the_arm_is_that_of_the_planar_task_and_what_its_table_adds():
    planar, arm = (env.reset(seed=0)[1] for env in (rj_gym.RollingJointEnv(), rj_gym.FlexibleArmEnv(orientation=True)))
    added = rows(ARM_PAGE, "## Info")[1:]
    assert arm.keys() - planar.keys() == {key for key, *_ in added} - {"sampled"} and planar.keys() <= arm.keys()
    only_arm, _, only_planar = dict(added)["sampled"].partition("; no ")
    drawn, planar_drawn = arm["sampled"].keys(), planar["sampled"].keys()
    names = [set(re.findall(r"`(\w+)", words)) - {"orientation"} for words in (only_arm, only_planar)]
    assert names == [drawn - planar_drawn, planar_drawn - drawn]


@tasks
def test_reward_table_is_complete(page, stem, options):
    env = getattr(rj_gym, f"{stem}Env")(**({"orientation": True} if stem == "FlexibleArm" else {}))
    env.reset(seed=0)
    terms = env.step(env.action_space.sample())[-1]["reward_terms"]
    assert [key for key, *_ in rows(page, "## Reward")[1:]] == list(terms)


@tasks
def test_class_docstring_tables_every_kind_of_entry_with_its_bounds(page, stem, options):
    kind = getattr(rj_gym, f"{stem}Env")
    table = bounds(kind.__doc__)
    switches = dict.fromkeys(type(kind().config)._SWITCHES, True)
    env = kind(**switches)
    for entry in env.task.entries():
        name = re.sub(r"(link) \d", r"\1 k", re.sub(r"(tendon) \d", r"\1 j", entry.name))
        assert table[name] == (f"{entry.low:g}", f"{entry.high:g}"), entry.name


def test_the_configuration_with_friction_is_the_default_task_with_default_friction():
    settings = yaml.safe_load((DOCS.parent / "configs/env/friction.yaml").read_text())
    assert rj_gym.TrackingConfig.from_dict(settings) == rj_gym.TrackingConfig(friction={})


def test_the_configuration_of_the_arm_is_the_documented_task():
    settings = yaml.safe_load((DOCS.parent / "configs/env/flexible_arm.yaml").read_text())
    assert rj_gym.FlexibleArmConfig.from_dict(settings) == rj_gym.FlexibleArmConfig()
