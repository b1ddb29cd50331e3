"""Reference counts are looked for where there are some.

Wherever a tuple is copied, numba takes out all of its members, down to the last, to find what counts references, and
leaves these instructions for LLVM to delete. Tuples of borrowed arrays have no counts, and kernels pass many of them.
"""

from __future__ import annotations

from typing import Any

from numba.core.runtime.context import NRTContext

_every_member = NRTContext.get_meminfos
_counted: dict[Any, bool] = {}


def _counts(models: Any, kind: Any, outer: tuple[Any, ...] = ()) -> bool:
    """Whether a value of this type has a reference count, or one of its members has."""
    model, inside = models[kind], (*outer, kind)
    return bool(model.has_nrt_meminfo()) or any(
        _counts(models, member, inside) for member in model.traverse_types() if member not in inside
    )


def _counted_members(self: Any, builder: Any, kind: Any, value: Any) -> Any:
    """The reference counts in a value: (type, count) pairs."""
    if kind not in _counted:
        _counted[kind] = _counts(self._context.data_model_manager, kind)
    return _every_member(self, builder, kind, value) if _counted[kind] else []


NRTContext.get_meminfos = _counted_members  # type: ignore[method-assign]
