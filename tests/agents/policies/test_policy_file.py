"""Policy files are read back to the last bit, and no foreign or damaged one gets past the loader."""

import numpy as np
import pytest
import safetensors.numpy
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agents.policies import file as policy_file
from agents.policies.file import pack, unpack
from agents.policies.loading import FOLDER
from agents.policies.network import PolicyError
from agents.policies.shipped import ShippedPolicy
from agents.shipped import load_policy
from rj_gym.tracking.planar import PlanarTask
from rollingjoint.errors import RollingJointError
from tests.agents.policies.made_up import ARM, ARM_GOAL, FILE, FLAT, GOAL, random_policy


@pytest.mark.parametrize(("env_id", "changes"), [(FLAT, {}), (GOAL, {}), (ARM, {}), (ARM_GOAL, {"orientation": True})])
def test_written_policy_is_read_back_to_the_last_bit(env_id, changes):
    policy = random_policy(env_id, observe_load=True, randomization={"stiffness_spread": 0.1}, **changes)
    again = ShippedPolicy.from_bytes(policy.to_bytes())
    assert again.to_bytes() == policy.to_bytes()
    assert again.sha256 == policy.sha256
    name = policy.mechanism.name
    assert again.settings.updated({"mechanism": name}) == policy.settings.updated({"mechanism": name})
    with again.make_env() as env:
        observation, _ = env.reset(seed=3)
        assert np.array_equal(again(observation), policy(observation))


def test_policy_file_stands_alone_without_the_mechanism_file(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text((FOLDER.parent.parent / "configs/mechanism/two_segment.yaml").read_text())
    policy = random_policy(mechanism=str(path))
    path.unlink()
    again = ShippedPolicy.from_bytes(policy.to_bytes())
    assert again.make_env().action_space.shape == (4,)
    again.begin(PlanarTask(policy.settings), 1)


def test_file_cannot_name_another_file_as_its_mechanism():
    content, tensors = unpack(FILE, "x")
    content["environment"]["settings"]["mechanism"] = "configs/mechanism/two_segment.yaml"
    with pytest.raises(PolicyError, match="mechanism"):
        ShippedPolicy.from_bytes(pack(content, tensors))


def resealed(change):
    """A policy file with a valid sum whose content went through `change`."""
    content, tensors = unpack(FILE, "x")
    change(content, tensors)
    return pack(content, tensors)


def set_tensor(name, values, kind=None):
    return lambda content, tensors: tensors.update({name: np.array(values, kind or tensors[name].dtype)})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_tensor("biases.0", np.full(5, np.nan)), "biases.0 = 'NaN or infinity'"),
        (set_tensor("weights.1", np.full((4, 5), np.inf)), "weights.1 = 'NaN or infinity'"),
        (set_tensor("mean", np.zeros(23)), r"mean = \(23,\)|layer 0"),
        (set_tensor("scale", np.zeros(24)), "above zero"),
        (set_tensor("low", np.ones(2)), "less than high"),
        (set_tensor("low", np.zeros(3)), r"low = \(3,\)"),
        (set_tensor("weights.1", np.zeros((4, 6))), "layer 1"),
        (set_tensor("weights.1", np.zeros(20)), "layer 1"),
        (set_tensor("weights.2", np.zeros((0, 4))), "layer 2|not empty"),
        (set_tensor("biases.1", np.zeros(4), np.float64), "biases.1 = 'float64': expected float32"),
        (set_tensor("extra", np.zeros(4), np.float32), "tensors"),
        (lambda content, tensors: tensors.pop("biases.2"), "tensors"),
        (lambda content, tensors: tensors.pop("mean"), "tensors"),
        (lambda content, tensors: content.pop("training"), "'training'"),
        (lambda content, tensors: content.update(more=1), "more"),
        (lambda content, tensors: content.update(name=3), "name = 3"),
        (lambda content, tensors: content["network"].update(activation="gelu"), "activation = 'gelu'"),
        (lambda content, tensors: content["network"].update(output="exp"), "output = 'exp'"),
        (lambda content, tensors: content["network"].update(inputs={"observation": 24}), "inputs"),
        (lambda content, tensors: content["network"].update(inputs=[1]), "AttributeError|inputs"),
        (lambda content, tensors: content["environment"].update(id="CartPole-v1"), "environment = 'CartPole-v1'"),
        (lambda content, tensors: content["environment"].update(id=GOAL), "inputs"),
        (lambda content, tensors: content["environment"]["entries"].reverse(), "observation entries"),
        (lambda content, tensors: content["environment"]["settings"].update(lod={}), "lod.*load"),
        (lambda content, tensors: content["environment"]["settings"].update(start_tension=10**400), "start_tension"),
        (lambda content, tensors: content["score"]["values"].pop("mean_mm"), "mean_mm"),
        (lambda content, tensors: content["score"].update(episodes=-1), "score.episodes"),
    ],
)
def test_file_whose_parts_do_not_fit_is_a_clear_error(change, message):
    with pytest.raises(PolicyError, match=message) as raised:
        ShippedPolicy.from_bytes(resealed(change), "own.safetensors")
    assert "own.safetensors" in str(raised.value)


def edited(data, old, new):
    assert data.count(old) == 1 and len(old) == len(new)
    return data.replace(old, new)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "a file that rj export-policy wrote"),
        (b"\xff" * 64, "a file that rj export-policy wrote"),
        ((2**62).to_bytes(8, "little") + b"{}", "a file that rj export-policy wrote"),
        ((99_999_999).to_bytes(8, "little") + b"{" * 1000, "a file that rj export-policy wrote"),
        (FILE[:-1], "a file that rj export-policy wrote"),
        (FILE + b"\0", "a file that rj export-policy wrote"),
        (safetensors.numpy.save({"a": np.zeros(1)}), "a file that rj export-policy wrote"),
        (safetensors.numpy.save({"a": np.zeros(1)}, {"policy": "[" * 100_000}), "more than 64 levels"),
        (safetensors.numpy.save({"a": np.zeros(1)}, {"policy": "[]"}), "a file that rj export-policy wrote"),
        (edited(FILE, b'\\"format\\":1', b'\\"format\\":2'), "format = 2: expected 1"),
        (edited(FILE, b'\\"steps\\":40', b'\\"steps\\":90'), "damaged or edited"),
        (FILE[:-1] + bytes([FILE[-1] ^ 1]), "damaged or edited"),
    ],
)
def test_file_that_is_none_of_ours_or_was_edited_is_a_clear_error(data, message):
    with pytest.raises(PolicyError, match=message):
        ShippedPolicy.from_bytes(data)


def accepted(data):
    """The policy in the file, or None if the loader refused it with an error of ours."""
    try:
        return ShippedPolicy.from_bytes(data)
    except RollingJointError:
        return None


@settings(max_examples=250, deadline=None)
@given(
    start=st.integers(0, len(FILE)),
    removed=st.integers(0, 20),
    put=st.binary(max_size=20),
    end=st.integers(0, len(FILE)) | st.just(len(FILE)),
)
@example(start=0, removed=0, put=b"", end=len(FILE))
def test_damaged_bytes_never_give_another_policy_or_a_foreign_error(start, removed, put, end):
    policy = accepted((FILE[:start] + put + FILE[start + removed :])[:end])
    assert policy is None or policy.to_bytes() == FILE


@settings(max_examples=200, deadline=None)
@given(place=st.integers(0, len(FILE) - 1), bit=st.integers(0, 7))
def test_flipped_bit_never_gives_another_policy(place, bit):
    damaged = bytearray(FILE)
    damaged[place] ^= 1 << bit
    policy = accepted(bytes(damaged))
    assert policy is None or policy.to_bytes() == FILE


STRANGE = st.sampled_from(
    [None, True, -1, 0, 1e300, -1e300, 10**400, 2**63, "", "x", "\0", [], [[]], {}, {"a": 1}, [None] * 3, [1e300] * 2]
)


def places(value):
    """Every container in nested plain values, with each of its keys."""
    for key in value if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], dict | list):
            yield from places(value[key])


@settings(max_examples=100, deadline=None)
@given(number=st.integers(0, 10**6), strange=STRANGE, delete=st.booleans())
def test_strange_value_anywhere_in_the_description_gives_no_foreign_error(number, strange, delete):
    content, tensors = unpack(FILE, "x")
    everywhere = list(places(content))
    container, key = everywhere[number % len(everywhere)]
    if delete:
        del container[key]
    else:
        container[key] = strange
    accepted(pack(content, tensors))


def test_file_beyond_the_largest_size_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "large.safetensors"
    path.write_bytes(FILE)
    monkeypatch.setattr(policy_file, "LARGEST_FILE", len(FILE) - 1)
    with pytest.raises(PolicyError, match="at most"):
        load_policy(path)


def test_zip_is_refused_with_the_reason_and_the_way(tmp_path):
    (tmp_path / "policy.zip").write_bytes(b"PK")
    with pytest.raises(PolicyError, match=r"holds pickles.*run any code.*trust_pickle=True") as raised:
        load_policy(tmp_path / "policy.zip")
    assert "a .safetensors file" in str(raised.value)
