"""Saved states of vector environments: plain values and arrays, checked before they are entered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.generators import Generators
from rollingjoint.errors import InvalidInput

HINT = "Take it from get_state() of an environment with these settings and this many lanes."


def checked_parts(state: object, names: Sequence[str], where: str = "state") -> Mapping[str, Any]:
    """The parts of a state by name; raises InvalidInput unless it is a mapping with these keys and no others."""
    if not isinstance(state, Mapping) or set(state) != set(names):
        given = sorted(map(str, state)) if isinstance(state, Mapping) else type(state).__name__
        raise InvalidInput(where, given, f"a mapping with the keys {', '.join(sorted(names))}", HINT)
    return state


def checked_array(name: str, values: object, like: NDArray[Any]) -> NDArray[Any]:
    """The array, of the shape and type of `like`; raises InvalidInput for any other: kernels check neither."""
    if not isinstance(values, np.ndarray) or (values.shape, values.dtype) != (like.shape, like.dtype):
        given = (values.dtype.name, values.shape) if isinstance(values, np.ndarray) else type(values).__name__
        raise InvalidInput(f"state: {name}", given, f"an array {like.dtype.name} {like.shape}", HINT)
    return values


def check_whole(name: str, values: NDArray[Any], low: float, high: float) -> None:
    """Raise InvalidInput unless all values are whole numbers from low to high: kernels use them as indices."""
    good = (values >= low) & (values <= high) & (values == np.rint(values))
    if not good.all():
        raise InvalidInput(f"state: {name}", values[~good][0], f"whole numbers from {low:g} to {high:g}", HINT)


def generator_states(generators: Generators) -> list[dict[str, Any] | None]:
    """The states of the random generators, None for a lane that has none yet."""
    each = (generators[lane] for lane in range(len(generators)))
    return [None if rng is None else dict(rng.bit_generator.state) for rng in each]


def check_generator_states(states: object, lanes: int) -> None:
    """Raise InvalidInput unless these are states, or None, of as many generators, as NumPy's PCG64 can have them."""
    where, known = "state: generators", np.random.PCG64(0).state
    if not isinstance(states, Sequence) or len(states) != lanes:
        raise InvalidInput(where, states, f"a list of {lanes} states", HINT)
    limits = {"state": 2**128, "inc": 2**128, "uinteger": 2**32, "has_uint32": 2}
    for state in states:
        if state is None:
            continue
        checked_parts(checked_parts(state, tuple(known), where)["state"], ("state", "inc"), where)
        for name, value in {**state, **state["state"]}.items():
            if name in limits and not (type(value) is int and 0 <= value < limits[name]):
                raise InvalidInput(f"{where}: {name}", value, f"an integer from 0 to {limits[name] - 1}", HINT)
        if state["bit_generator"] != known["bit_generator"]:
            raise InvalidInput(where, state["bit_generator"], known["bit_generator"], HINT)


def set_generator_states(generators: Generators, states: Sequence[Mapping[str, Any] | None]) -> None:
    """Give generators states that were checked; lanes get one where they had none."""
    for lane, state in enumerate(states):
        rng = generators[lane]
        if state is None or rng is None:
            generators[lane] = rng = None if state is None else np.random.Generator(np.random.PCG64(0))
        if rng is not None and state is not None:
            rng.bit_generator.state = state
