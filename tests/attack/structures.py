"""Descriptions with any value anywhere, drawn and made small by Hypothesis."""

import copy

import hypothesis
from hypothesis import strategies as st

from rollingjoint import PRESETS, CapstanFriction, RollingJointError, preset
from rollingjoint.io.mechanism_file import mechanism_from_dict, mechanism_to_dict

_NUMBERS = st.one_of(st.integers(), st.floats(), st.sampled_from([0, 1, -1, 1e300, 5e-324, 2**63, 10**400]))
_PLAIN = st.one_of(st.none(), st.booleans(), _NUMBERS, st.text(max_size=8), st.dates())
ANYTHING = st.recursive(
    _PLAIN,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=6), inner, max_size=3)),
    max_leaves=8,
)
_WHOLE = [
    mechanism_to_dict(preset(name).replace(friction=CapstanFriction(0.1)) if name == "five_link" else preset(name))
    for name in PRESETS
]


@st.composite
def descriptions(draw):
    """The content of a mechanism file with one value somewhere replaced, removed or added."""
    content = copy.deepcopy(draw(st.sampled_from(_WHOLE)))
    at = content
    while True:
        keys = sorted(at) if isinstance(at, dict) else range(len(at))
        key = draw(st.sampled_from(list(keys)))
        if isinstance(at[key], (dict, list)) and at[key] and draw(st.integers(0, 3)):
            at = at[key]
            continue
        match draw(st.integers(0, 3)):
            case 0 if isinstance(at, dict):
                del at[key]
            case 1 if isinstance(at, dict):
                at[draw(st.text(max_size=5))] = draw(ANYTHING)
            case _:
                at[key] = draw(ANYTHING)
        return content


def built_or_refused(content):
    """The mechanism, or its refusal in one line."""
    try:
        mechanism_from_dict(content)
    except RollingJointError as error:
        assert len(str(error).splitlines()) == 1, f"a message of several lines: {error}"


def attack(rng, report, examples=40):
    """Some descriptions; the smallest that is neither built nor refused is printed."""

    @hypothesis.seed(int(rng.integers(2**32)))
    @hypothesis.settings(max_examples=examples, deadline=5000, database=None, print_blob=False,
                         suppress_health_check=list(hypothesis.HealthCheck))  # fmt: skip
    @hypothesis.given(descriptions())
    def each(content):
        report.count("inputs")
        report.count("inputs: descriptions")
        built_or_refused(content)

    each()
