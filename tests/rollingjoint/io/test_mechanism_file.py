"""Mechanism files: what they mean, that they round-trip, and what they say when they are wrong."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.hinge import Bead, HingeChain
from rollingjoint.chain.presets import PRESETS, preset
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.spatial_joints import PointHinge, RollingContact
from rollingjoint.chain.tendon import BeadTendon
from rollingjoint.errors import ConfigError, RollingJointError
from rollingjoint.friction import CapstanFriction
from rollingjoint.io.mechanism_file import dump_mechanism, load_mechanism, mechanism_from_dict, mechanism_to_dict

ROOT = Path(__file__).resolve().parents[3]
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


SMALL_ARM = """
name: small
model: exact
defaults:
  bead: {spacing: 20, stiffness: 500, gap: 8, weight: 0.1}
  tendon: {stiffness: 10}
beads: [{axis: x}, {axis: y}, {axis: x}, {axis: [1, 1, 0], weight: 0.3}]
tendons:
  - {holes: [[15, 0]]}
  - {holes: [[-7, 13], [-7, 13], [-8, 12]], end: 2}
  - {holes: [[-7, -13]], stiffness: 3}
"""


def changed(**sections: object) -> dict[str, object]:
    return {**yaml.safe_load(SMALL), **sections}


def write(folder: Path, text: str) -> Path:
    path = folder / "arm.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def assert_same(a: AnyChain, b: AnyChain) -> None:
    """The same surfaces or beads, holes, tendons and name to the last bit."""
    assert (a.name, a.n_links, a.n_tendons) == (b.name, b.n_links, b.n_tendons)
    if isinstance(a, HingeChain):
        assert (a.model, a.beads, a.tendons, a.friction) == (b.model, b.beads, b.tendons, b.friction)
        return
    for one, other in zip(a.links, b.links, strict=True):
        for x, y in ((one.parent, other.parent), (one.child, other.child)):
            assert (x.start, x.angle) == (y.start, y.angle)
            np.testing.assert_array_equal(x.profile.breaks, y.profile.breaks)
            np.testing.assert_array_equal(x.profile.coefficients, y.profile.coefficients)
    assert list(a.tendons) == list(b.tendons)
    assert (a.springs, a.friction) == (b.springs, b.friction)


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


@pytest.mark.parametrize("seed", range(5))
def test_dump_of_any_arm_loads_as_exactly_the_same_arm(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    beads = [
        Bead(20.0 + rng.random(), rng.normal(size=3), rng.uniform(400, 900), 7.0, rng.random(), 0.1 * rng.normal())
        for _ in range(20)
    ]
    tendons = [BeadTendon(rng.normal(size=(end + 1, 2)), end, rng.uniform(1, 9)) for end in (20, 7)]
    arm = HingeChain(beads, tendons, "linear", "of any numbers")
    assert_same(load_mechanism(write(tmp_path, dump_mechanism(arm))), arm)
    rubbed = [BeadTendon([(3.0, 4.0)], friction=CapstanFriction(0.25 * rng.random(), compliance=0.1)), *tendons]
    arm = HingeChain(beads, rubbed, friction=CapstanFriction(0.25 * rng.random(), 0.05, constant=rng.random()))
    assert_same(load_mechanism(write(tmp_path, dump_mechanism(arm))), arm)


@pytest.mark.parametrize("name", ["spline_example", "flexible_arm"])
def test_dict_of_a_mechanism_holds_plain_values_only(name: str) -> None:
    content = mechanism_to_dict(load_mechanism(ROOT / "configs" / "mechanism" / f"{name}.yaml"))
    assert yaml.safe_load(yaml.safe_dump(content)) == content


def test_preset_arm_and_its_file_are_the_same() -> None:
    assert_same(load_mechanism(ROOT / "configs" / "mechanism" / "flexible_arm.yaml"), preset("flexible_arm"))


def test_beads_make_an_arm_whose_own_keys_win_over_the_defaults() -> None:
    arm = mechanism_from_dict(yaml.safe_load(SMALL_ARM))
    last = Bead(20.0, (1, 1, 0), 500.0, gap=8.0, weight=0.3)
    expected = [Bead(20.0, axis, 500.0, gap=8.0, weight=0.1) for axis in "xyx"]
    assert isinstance(arm, HingeChain)
    assert (arm.model, arm.beads) == ("exact", (*expected, last))
    path = [(-7.0, 13.0), (-7.0, 13.0), (-8.0, 12.0)]
    assert arm.tendons == (BeadTendon([(15, 0)], -1, 10), BeadTendon(path, 2, 10), BeadTendon([(-7, -13)], -1, 3))


def test_rest_angles_limits_and_the_model_are_read() -> None:
    bead = {"axis": "y", "rest_angle": 0.1, "limits": [-0.2, 0.3]}
    content = {**yaml.safe_load(SMALL_ARM), "model": "linear", "beads": [bead] * 2}
    arm = mechanism_from_dict(content, name="unused")
    assert arm.model == "linear" and arm.name == "small"
    assert arm.neutral_angles.tolist() == [0.1, 0.1] and arm.joint_limits.tolist() == [[-0.2, 0.3]] * 2
    del content["model"], content["name"]
    default = mechanism_from_dict(content, name="from its file")
    assert (default.model, default.name) == ("exact", "from its file")


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("beads: [", "baeds: [", ["unknown key", "'baeds'", "Did you mean 'beads'?"]),
        ("model: exact", "modle: exact", ["unknown key", "'modle'", "Did you mean 'model'?"]),
        ("model: exact", "links: []", ["unknown key", "'links'", "beads"]),
        ("model: exact", "model: 5", ["model = 5", "text"]),
        ("  bead: {", "  baed: {", ["defaults", "'baed'", "Did you mean 'bead'?"]),
        ("{axis: y}", "{axsi: y}", ["beads[1]", "'axsi'", "Did you mean 'axis'?"]),
        ("{axis: y}", "{}", ["beads[1]", "the key 'axis'"]),
        ("{axis: y}", "3", ["beads[1] = 3", "keys and values"]),
        ("[1, 1, 0]", "[1, 1]", ["beads[3].axis = [1, 1]", "x, y, z or three numbers"]),
        ("[1, 1, 0]", "[1, one, 0]", ["beads[3].axis[1] = 'one'", "a finite number"]),
        ("[1, 1, 0]", "[0, 0, 0]", ["beads[3]: bead axis", "a direction"]),
        ("spacing: 20", "spacing: -20", ["beads[0]: bead spacing = -20.0", "positive"]),
        ("spacing: 20, ", "", ["beads[0]", "the key 'spacing'"]),
        ("weight: 0.1", "weight: light", ["beads[0].weight = 'light'", "a finite number"]),
        ("gap: 8", "limits: 0.3", ["beads[0].limits = 0.3", "two numbers"]),
        ("gap: 8", "limits: [0.1, 0.3]", ["beads[0]: bead limits", "0.0 between them"]),
        ("[[15, 0]]", "[15, 0]", ["tendons[0].holes[0] = 15", "two numbers"]),
        ("[[15, 0]]", "[]", ["tendons[0].holes = []", "at least one"]),
        ("{holes: [[15, 0]]}", "{end: 2}", ["tendons[0]", "the key 'holes'"]),
        ("[-8, 12]", "[-8, 12], [-8, 12]", ["number of tendon holes = 4", "3, links 0 to 2"]),
        ("end: 2", "end: 9", ["tendon end = 9", "1 to 4"]),
        ("end: 2", "end: tip", ["tendons[1].end = 'tip'", "an integer"]),
        ("stiffness: 3", "stiffness: 0", ["tendons[2]: tendon stiffness = 0.0", "positive"]),
        ("  tendon: {stiffness: 10}", "  tendon: {holes: [[1, 2]]}", ["defaults.tendon", "'holes'", "end, stiffness"]),
        ("model: exact", "friction: {mu: 0.1, rolling: 0.2}", ["friction rolling = 0.2", "0: hinges do not roll"]),
        ("model: exact", "friction: 0.1", ["friction = 0.1", "keys and values, with the keys mu"]),
        ("model: exact", "model: linear\nfriction: {mu: 0.1}", ["model with friction = 'linear'", "expected exact"]),
        ("stiffness: 3", "friction: {mu: 1}", ["tendons[2].friction: friction mu = 1.0", "0 to 0.25"]),
    ],
)
def test_wrong_entry_of_an_arm_names_file_place_and_what_is_expected(
    old: str, new: str, parts: list[str], tmp_path: Path
) -> None:
    assert old in SMALL_ARM
    with pytest.raises(ConfigError) as caught:
        load_mechanism(write(tmp_path, SMALL_ARM.replace(old, new)))
    message = str(caught.value)
    assert all(part in message for part in ["arm.yaml", *parts]), message


def test_kind_that_is_asked_for_is_given_and_the_other_is_refused(tmp_path: Path) -> None:
    assert isinstance(load_mechanism("flexible_arm", HingeChain), HingeChain)
    assert isinstance(load_mechanism(write(tmp_path, SMALL), RollingChain), RollingChain)
    with pytest.raises(ConfigError, match=r"'flexible_arm': expected a planar chain.*not an arm.*five_link, uniform"):
        load_mechanism("flexible_arm", RollingChain)
    with pytest.raises(ConfigError, match=r"arm.yaml.*expected an arm.*not a planar chain.*flexible_arm, small_arm"):
        load_mechanism(write(tmp_path, SMALL), HingeChain)


def test_own_key_wins_over_the_default() -> None:
    mechanism = mechanism_from_dict(changed(links=[{}, {"child": {"curvature": {"constant": -0.01}}}, {}]))
    assert [link.child.curvature(0.0) for link in mechanism.links] == [-0.04, -0.01, -0.04]
    assert mechanism.links[1].child.start == (0.0, 10.0)
    assert [(t.end, t.stiffness) for t in mechanism.tendons] == [(-1, 5.0), (1, 3.0)]


def test_friction_of_a_tendon_replaces_that_of_the_defaults_and_of_the_mechanism() -> None:
    tendons = [{"on_surface": -8}, {"on_surface": 8, "friction": {"mu": 0.2, "compliance": 0.01}}]
    shared = {"friction": {"mu": 0.05, "presliding": 0.1}}
    mechanism = mechanism_from_dict(changed(tendons=tendons, **shared))
    assert mechanism.friction == CapstanFriction(0.05, presliding=0.1)
    assert [tendon.friction for tendon in mechanism.tendons] == [None, CapstanFriction(0.2, compliance=0.01)]
    defaults = {**yaml.safe_load(SMALL)["defaults"], "tendon": shared}
    mechanism = mechanism_from_dict(changed(tendons=tendons, defaults=defaults))
    assert mechanism.friction is None
    assert [tendon.friction.mu for tendon in mechanism.tendons] == [0.05, 0.2]


def test_every_number_of_friction_survives_the_round_trip(tmp_path: Path) -> None:
    friction = CapstanFriction(1 / 7, 1 / 30, 0.1, 0.02 / 3, 0.3, 1 / 70)
    chain = preset("two_segment").replace(friction=friction)
    own = dataclasses.replace(chain.tendons[2], friction=dataclasses.replace(friction, mu=0.0, rolling=0.0))
    chain = chain.replace(tendons=[*chain.tendons[:2], own, chain.tendons[3]])
    assert_same(load_mechanism(write(tmp_path, dump_mechanism(chain))), chain)


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
        ("end: 1", "end: 1.5", ["tendons[1].end = 1.5", "an integer"]),
        ("end: 1", "end: 7", ["tendon end = 7", "1 to 2"]),
        ("stiffness: 3", "stiffness: -3", ["tendons[1]: tendon stiffness = -3.0", "positive"]),
        ("name: small", "friction: 0.1", ["arm.yaml: friction = 0.1", "mu, presliding"]),
        ("name: small", "friction: {presliding: 0.1}", ["friction", "the key 'mu'"]),
        ("name: small", "friction: {mu: 0.1, preslidng: 0.1}", ["friction", "Did you mean 'presliding'?"]),
        ("name: small", "friction: {mu: 0.3}", ["friction mu = 0.3", "0 to 0.25"]),
        ("stiffness: 3", "friction: {mu: low}", ["tendons[1].friction.mu = 'low'", "a finite number"]),
        ("stiffness: 3", "friction: {mu: 0.1, rolling: 1}", ["tendons[1]: rolling", "Give it to the mechanism"]),
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


def test_examples_of_the_documentation_are_those_of_these_tests() -> None:
    examples = re.findall(r"```yaml\n(.*?)```", DOCUMENT, flags=re.DOTALL)
    assert {text.strip() for text in examples} >= {SMALL.strip(), SMALL_ARM.strip()}


def test_friction_of_the_documentation_loads_and_its_ranges_and_defaults_are_true() -> None:
    section = DOCUMENT[DOCUMENT.index("## Friction") : DOCUMENT.index("## Springs")]
    [example] = re.findall(r"```yaml\n(.*?)```", section, flags=re.DOTALL)
    mechanism = mechanism_from_dict(changed(**yaml.safe_load(example)))
    assert (mechanism.friction, mechanism.tendons[1].friction) == (CapstanFriction(0.05), CapstanFriction(0.1, 0.05))
    rows = re.findall(r"^\| `(\w+)` \| .* \| ([\d.]+) to ([\d.π]+) \| (\S+) \|$", section, flags=re.MULTILINE)
    assert [name for name, *_ in rows] == [field.name for field in dataclasses.fields(CapstanFriction)]
    for name, low, high, default in rows:
        ends = float(low), np.pi if high == "π" else float(high)
        for value in ends:
            assert getattr(CapstanFriction(**{"mu": 0.1, name: value}), name) == value
        for value in (ends[0] - 1e-3, ends[1] + 1e-3):
            with pytest.raises(RollingJointError, match=name):
                CapstanFriction(**{"mu": 0.1, name: value})
        assert default == "required" or getattr(CapstanFriction(0.1), name) == float(default)


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
    assert len(rows) >= 6
    for old, new, message in rows:
        example = SMALL if old in SMALL else SMALL_ARM
        assert old in example
        write(tmp_path, example.replace(old, new))
        with pytest.raises(RollingJointError) as caught:
            load_mechanism("arm.yaml")
        assert str(caught.value) == message


SPATIAL = """
defaults:
  joint: {half_width: 3, stiffness: 2}
  parent: {start: [0, -4], limits: [-2, 2], curvature: {constant: 0.2}}
  child: {start: [0, 4], limits: [-2, 2], curvature: {constant: -0.2}}
joints:
  - {azimuth: 0}
  - {axis: [1, 0, 0.1], below: [0, 0, 4], above: [0, 0, -4], limits: [-0.5, 0.5]}
  - {azimuth: 1.5, child: {curvature: {constant: -0.1}}}
links: [{}, {weight: 0.1, centre: [0, 0, 1]}, {}, {}]
tendons:
  - {holes: [{parent: [2, 0, -3], child: [2, 0, 3]}]}
"""


def test_joints_in_space_are_of_the_kind_that_has_their_keys(tmp_path: Path) -> None:
    chain = load_mechanism(write(tmp_path, SPATIAL), SpatialChain)
    assert [type(joint) for joint in chain.joints] == [RollingContact, PointHinge, RollingContact]
    assert [joint.stiffness for joint in chain.joints] == [2.0] * 3
    assert chain.links[1].weight == 0.1
    again = load_mechanism(write(tmp_path, dump_mechanism(chain)))
    assert mechanism_to_dict(again) == mechanism_to_dict(chain)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("{azimuth: 0}", "{azimuth: 0, axis: [1, 0, 0]}", "joints"),
        ("{azimuth: 0}", "{}", "azimuth"),
        ("axis: [1, 0, 0.1]", "axis: [0, 0, 0]", "axis"),
        ("half_width: 3", "half_width: 0", "half_width"),
        ("child: [2, 0, 3]", "child: [2, 0]", "child"),
        ("{weight: 0.1,", "{weight: -1,", "weight"),
    ],
)
def test_wrong_joints_in_space_are_refused_in_one_line(old: str, new: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message) as refusal:
        load_mechanism(write(tmp_path, SPATIAL.replace(old, new)))
    assert len(str(refusal.value).splitlines()) == 1
