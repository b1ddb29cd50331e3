"""Mechanism files: what they mean, that they round-trip, and what they say when they are wrong."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from rollingjoint.errors import ConfigError, RollingJointError
from rollingjoint.mechanism_file import dump_mechanism, load_mechanism, mechanism_from_dict, mechanism_to_dict
from rollingjoint.presets import PRESETS, preset
from rollingjoint.rolling_chain import RollingChain

ROOT = Path(__file__).parents[1]
TABLES = ["piecewise_constant", "piecewise_polynomial", "spline", "samples"]
CONFIGS = sorted((ROOT / "configs" / "mechanism").glob("*.yaml"))
DOCUMENT = (ROOT / "docs" / "mechanism-files.md").read_text(encoding="utf-8")

SMALL = """
name: small
defaults:
  parent: {start: [0, -10], limits: [-12, 12], curvature: {constant: 0.04}}
  child: {start: [0, 10], limits: [-12, 12], curvature: {constant: -0.04}}
links: [{}, {}, {}]
tendons:
  - {on_surface: -8}
  - {on_surface: 8, end: 1, stiffness: 3}
"""


def changed(**sections: object) -> dict[str, object]:
    return {**yaml.safe_load(SMALL), **sections}


def write(folder: Path, text: str) -> Path:
    path = folder / "arm.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def assert_same(a: RollingChain, b: RollingChain) -> None:
    """The same surfaces, holes, tendons and name to the last bit."""
    assert (a.name, a.n_links, a.n_tendons) == (b.name, b.n_links, b.n_tendons)
    for one, other in zip(a.links, b.links, strict=True):
        for x, y in ((one.parent, other.parent), (one.child, other.child)):
            assert (x.start, x.angle) == (y.start, y.angle)
            np.testing.assert_array_equal(x.profile.breaks, y.profile.breaks)
            np.testing.assert_array_equal(x.profile.coefficients, y.profile.coefficients)
    assert list(a.tendons) == list(b.tendons)


@pytest.mark.parametrize("name", ["five_link", "two_segment"])
def test_preset_and_its_file_have_equal_poses_lengths_and_stiffness(name: str) -> None:
    file, built = load_mechanism(ROOT / "configs" / "mechanism" / f"{name}.yaml"), preset(name)
    assert file.name == built.name
    low, high = built.joint_limits.T
    for share in (0.1, 0.45, 0.9):
        phi = built.joint_angles(low + share * (high - low))
        np.testing.assert_allclose(file.poses(phi), built.poses(phi), rtol=0, atol=1e-11)
        np.testing.assert_allclose(file.tendon_lengths(phi), built.tendon_lengths(phi), rtol=0, atol=1e-11)
    np.testing.assert_array_equal(file.stiffnesses, built.stiffnesses)


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_dump_of_a_config_loads_as_exactly_the_same_mechanism(path: Path, tmp_path: Path) -> None:
    mechanism = load_mechanism(path)
    assert_same(load_mechanism(write(tmp_path, dump_mechanism(mechanism))), mechanism)


@pytest.mark.parametrize("name", PRESETS)
def test_dump_of_a_preset_loads_as_exactly_the_same_mechanism(name: str, tmp_path: Path) -> None:
    assert_same(load_mechanism(write(tmp_path, dump_mechanism(preset(name)))), preset(name))


def test_dict_of_a_mechanism_holds_plain_values_only() -> None:
    content = mechanism_to_dict(load_mechanism(ROOT / "configs" / "mechanism" / "spline_example.yaml"))
    assert yaml.safe_load(yaml.safe_dump(content)) == content


def test_own_key_wins_over_the_default() -> None:
    mechanism = mechanism_from_dict(changed(links=[{}, {"child": {"curvature": {"constant": -0.01}}}, {}]))
    assert [link.child.curvature(0.0) for link in mechanism.links] == [-0.04, -0.01, -0.04]
    assert mechanism.links[1].child.start == (0.0, 10.0)
    assert [(t.end, t.stiffness) for t in mechanism.tendons] == [(-1, 5.0), (1, 3.0)]


def test_polynomial_is_in_powers_of_s_and_pieces_in_powers_from_their_break() -> None:
    polynomial = {"curvature": {"polynomial": [-0.05, 0.001]}}
    piecewise = {"curvature": {"piecewise_polynomial": {"breaks": [-10, 0, 10], "coefficients": [[-0.05, 0.001]] * 2}}}
    links = mechanism_from_dict(changed(links=[{"child": polynomial}, {"child": piecewise}, {}])).links
    assert links[0].child.curvature(-7.0) == pytest.approx(-0.057)
    assert links[1].child.curvature(-7.0) == pytest.approx(-0.047)
    assert links[1].child.curvature(7.0) == pytest.approx(-0.043)


def test_spline_and_samples_pass_through_their_points() -> None:
    s, u = [-12, -3, 4, 12], [-0.02, -0.05, -0.03, -0.04]
    for kind in ("spline", "samples"):
        child = (
            mechanism_from_dict(changed(links=[{"child": {"curvature": {kind: {"s": s, "u": u}}}}, {}])).links[0].child
        )
        np.testing.assert_allclose(child.curvature(s), u, rtol=0, atol=1e-15)
        assert child.limits == (-12.0, 12.0)


def test_number_in_e_notation_without_a_point_is_read_as_a_number(tmp_path: Path) -> None:
    text = SMALL.replace("constant: -0.04", "constant: -4e-2")
    assert load_mechanism(write(tmp_path, text)).links[0].child.curvature(0.0) == -0.04


def test_nameless_mechanism_is_named_after_its_file(tmp_path: Path) -> None:
    assert load_mechanism(write(tmp_path, SMALL.replace("name: small", ""))).name == "arm"


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("name: small", "nmae: small", ["arm.yaml", "'nmae'", "Did you mean 'name'?"]),
        ("  child:", "  chidl:", ["defaults", "'chidl'", "Did you mean 'child'?"]),
        ("constant: -0.04", "constnat: -0.04", ["child.curvature", "Did you mean 'constant'?"]),
        ("stiffness: 3", "stifness: 3", ["tendons[1]", "Did you mean 'stiffness'?"]),
        (
            "start: [0, 10]",
            "begin: [0, 10]",
            ["defaults.child", "'begin'", "curvature, start, angle, limits"],
        ),
    ],
)
def test_unknown_key_names_file_place_and_nearest_key(old: str, new: str, parts: list[str], tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load_mechanism(write(tmp_path, SMALL.replace(old, new)))
    assert all(part in str(caught.value) for part in [*parts, "arm.yaml", "unknown key"])


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("links: [{}, {}, {}]", "", ["the key 'links'"]),
        ("links: [{}, {}, {}]", "links: 3", ["links = 3", "a list"]),
        ("links: [{}, {}, {}]", "links: [{}]", ["number of links", "2 or more"]),
        ("links: [{}, {}, {}]", "links: [{}, {parent: 5}]", ["links[1].parent = 5", "keys and values"]),
        ("start: [0, 10], ", "", ["links[0].child", "the key 'start'"]),
        ("start: [0, 10]", "start: 10", ["links[0].child.start = 10", "two numbers"]),
        ("start: [0, 10]", "start: [0, ten]", ["links[0].child.start[1] = 'ten'", "a finite number"]),
        (
            "limits: [-12, 12], curvature: {constant: -0.04}",
            "curvature: {constant: -0.04}",
            ["'limits'", "Add limits"],
        ),
        (
            "limits: [-12, 12], curvature: {constant: -0.04}",
            "limits: [2, 9], curvature: {constant: -0.04}",
            ["s = 0"],
        ),
        ("{constant: -0.04}", "{constant: .nan}", ["links[0].child.curvature.constant", "a finite number"]),
        ("{constant: -0.04}", "{constant: true}", ["curvature.constant = True", "a finite number"]),
        ("{constant: -0.04}", "{constant: -0.04, polynomial: [1]}", ["exactly one of constant, polynomial"]),
        ("{constant: -0.04}", "{spline: {s: [-9, 9]}}", ["curvature.spline", "the key 'u'"]),
        (
            "{constant: -0.04}",
            "{samples: {s: [9, -9], u: [1, 2]}}",
            ["links[0].child: arc lengths s", "increasing"],
        ),
        ("{constant: 0.04}", "{constant: -0.05}", ["arm.yaml", "joint 0"]),
        ("on_surface: -8", "on_surface: -80", ["arm.yaml", "-80"]),
        ("on_surface: -8", "holes: []", ["tendons[0].holes = []", "at least one"]),
        ("on_surface: -8", "holes: [{parent: [1, 2]}]", ["tendons[0].holes[0]", "the key 'child'"]),
        ("on_surface: -8", "end: -1", ["tendons[0]", "either 'on_surface' or 'holes'"]),
        ("end: 1", "end: 1.5", ["tendons[1].end = 1.5", "a whole number"]),
        ("end: 1", "end: 7", ["tendon end = 7", "1 to 2"]),
        ("stiffness: 3", "stiffness: -3", ["tendons[1]: tendon stiffness = -3.0", "positive"]),
        ("name: small", "name: 5", ["name = 5", "text"]),
        ("name: small", "name: [", ["line", "valid YAML"]),
        ("name: small", "name: small\nname: twice", ["line 3", "key 'name' given twice"]),
        ("name: small", "name: !!python/object/apply:os.getcwd []", ["line 2", "valid YAML"]),
    ],
)
def test_wrong_entry_names_file_place_and_what_is_expected(
    old: str, new: str, parts: list[str], tmp_path: Path
) -> None:
    assert old in SMALL
    with pytest.raises(ConfigError) as caught:
        load_mechanism(write(tmp_path, SMALL.replace(old, new)))
    message = str(caught.value)
    assert "arm.yaml" in message
    assert all(part in message for part in parts), message


def test_limits_beside_a_spline_are_refused() -> None:
    child = {"limits": [-9, 9], "curvature": {"spline": {"s": [-9, 0, 9], "u": [-0.03, -0.05, -0.03]}}}
    with pytest.raises(ConfigError, match=r"links\[0\].child.limits.*first and last of spline.s"):
        mechanism_from_dict(changed(links=[{"child": child}, {}]))


def test_empty_file_and_binary_file_and_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="the key 'links'"):
        load_mechanism(write(tmp_path, ""))
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ConfigError, match="readable YAML"):
        load_mechanism(tmp_path / "binary.yaml")
    with pytest.raises(ConfigError, match="a preset"):
        load_mechanism(tmp_path)


def test_misspelt_preset_gets_the_nearest_name() -> None:
    with pytest.raises(ConfigError, match=r"five_lnik.*Did you mean 'five_link'\?"):
        load_mechanism("five_lnik")


def test_first_example_of_the_documentation_loads() -> None:
    examples = re.findall(r"```yaml\n(.*?)```", DOCUMENT, flags=re.DOTALL)
    whole = [yaml.safe_load(text) for text in examples if "links:" in text]
    assert whole
    for content in whole:
        assert mechanism_from_dict(content).n_links >= 2


def test_curvature_examples_of_the_documentation_load() -> None:
    table = DOCUMENT[DOCUMENT.index("| curvature |") : DOCUMENT.index("## Tendons")]
    kinds = re.findall(r"^\| `(\w+): (.+?)` \|", table, flags=re.MULTILINE)
    assert [kind for kind, _ in kinds] == ["constant", "polynomial", *TABLES]
    for kind, value in kinds:
        child = {"curvature": {kind: yaml.safe_load(value)}}
        assert mechanism_from_dict(changed(links=[{"child": child}, {}])).links[0].child.curvature(0.0) < 0


def test_error_messages_of_the_documentation_are_those_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = re.findall(r"^\| `(.+?)` → `(.+?)` \| `(.+?)` \|", DOCUMENT, flags=re.MULTILINE)
    assert len(rows) >= 3
    for old, new, message in rows:
        assert old in SMALL
        write(tmp_path, SMALL.replace(old, new))
        with pytest.raises(RollingJointError) as caught:
            load_mechanism("arm.yaml")
        assert str(caught.value) == message
