"""docs/design_environment.md says what the code does: its examples run, its tables are the code's."""

import dataclasses
import re
from pathlib import Path

import pytest
import yaml

torch = pytest.importorskip("torch")
import rj_gym  # noqa: E402
from rj_gym.design.options import OPTIONS  # noqa: E402
from rollingjoint.design import MARGINS, DesignSpace  # noqa: E402
from tests.pages import bounds, examples, rows  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "design_environment.md").read_text()
CODESIGN = (ROOT / "docs" / "codesign.md").read_text()
EXAMPLES = examples(PAGE)


@pytest.mark.parametrize(("program", "output"), EXAMPLES + examples(CODESIGN))
def test_example_prints_what_the_page_says(program, output, capsys):
    exec(program, {})
    assert capsys.readouterr().out == output


def test_every_python_block_has_its_output():
    assert PAGE.count("```python") == len(EXAMPLES) == 3


@pytest.mark.parametrize("name", ["DesignConfig", "DesignRewardConfig", "CoDesignConfig", "CoDesignRewardConfig"])
def test_settings_table_has_every_key_and_its_default(name):
    default, page = getattr(rj_gym, name)(), CODESIGN if name.startswith("Co") else PAGE
    table = {key: yaml.safe_load(value) for key, value, *_ in rows(page, f"### {name}")[1:]}
    fields = {f.name: getattr(default, f.name) for f in dataclasses.fields(default)}
    plain = {key: value for key, value in fields.items() if key not in ("space", "reward")}
    assert table == yaml.safe_load(yaml.safe_dump(plain).replace("!!python/tuple", ""))


def test_the_default_space_is_the_one_that_the_page_names():
    assert rj_gym.DesignConfig().space == DesignSpace(symmetric=False)


def test_options_info_and_reward_tables_are_complete():
    env = rj_gym.CurvatureDesignEnv(space={"knots": 3})
    _, start = env.reset(seed=0)
    info = env.step([0.0] * 6)[-1]
    assert [key for key, *_ in rows(PAGE, "## Fixing an episode")[1:]] == list(OPTIONS)
    assert {
        name for key, *_ in rows(PAGE, "## Info")[1:] for name in re.findall(r"\w+", key)
    } == start.keys() | info.keys()
    assert re.findall(r"\w+", rows(PAGE, "## Info")[-1][1].split(":", 1)[1]) == list(start["sampled"])
    assert [key for key, *_ in rows(PAGE, "## Reward")[1:]] == list(info["reward_terms"])


def test_class_docstring_tables_every_kind_of_entry_with_its_bounds():
    table = bounds(rj_gym.CurvatureDesignEnv.__doc__)
    config = rj_gym.DesignConfig()
    names = [entry.name for entry in rj_gym.design_observation_entries(config)]
    assert names[: config.space.dimensions] == list(config.space.names)
    for entry in rj_gym.design_observation_entries(config)[config.space.dimensions :]:
        kind = re.sub(r"case \d", "case k", re.sub(r"link \d", "link i", entry.name))
        assert table[kind] == (f"{entry.low:g}", f"{entry.high:g}"), entry.name
    assert all(f"{name} margin" in names for name in MARGINS)


def test_configuration_file_holds_the_defaults():
    values = yaml.safe_load((ROOT / "configs" / "env" / "curvature_design.yaml").read_text())
    assert rj_gym.DesignConfig.from_dict(values) == rj_gym.DesignConfig()
