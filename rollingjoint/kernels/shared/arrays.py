"""Arrays and codes that both families share: status codes and the tendon law."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from rollingjoint._numba.layout import Floats

# Status codes, the values of solution.Status
CONVERGED, AT_LIMIT, INDETERMINATE, UNSTABLE, NOT_CONVERGED, INVALID_INPUT = range(6)


class TendonLaw(NamedTuple):
    """tension = clip(stiffness (length - command), low, high); low = high prescribes the tension."""

    command: Annotated[Floats, "m"]
    stiffness: Annotated[Floats, "m"]
    low: Annotated[Floats, "m"]
    high: Annotated[Floats, "m"]
