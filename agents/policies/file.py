"""The container of a shipped policy: one safetensors file; no part of it is ever executed.

Arrays are its tensors; everything else is one JSON text in its metadata, together with a SHA-256 over both. One file,
because two can be mixed up, and weights without their description are useless. The hash detects damage and careless
edits; it is not a signature. docs/policies.md lists the keys.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors.numpy
from numpy.typing import NDArray

from agents.policies.errors import PolicyError
from agents.runs.checked_json import parse_json

SUFFIX = ".safetensors"
LARGEST_FILE = 16 * 2**20

Tensors = Mapping[str, NDArray[Any]]


def pack(content: Mapping[str, Any], tensors: Tensors) -> bytes:
    """The bytes of a policy file: the same for the same plain values and arrays."""
    sealed = {"format": _format_of(content), "sha256": content_hash(content, tensors), **content}
    return safetensors.numpy.save(dict(tensors), {"policy": _text(sealed)})


def unpack(data: bytes, source: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The plain values and the arrays, read-only, in the bytes of a policy file.

    Args:
        source: name of the file in messages.
    Raises:
        PolicyError: no policy file, one of another format, or one that was damaged or edited.
    """
    try:
        tensors = safetensors.numpy.load(data)
        header = parse_json(data[8 : 8 + int.from_bytes(data[:8], "little")], "header")
        content = dict(parse_json(header["__metadata__"]["policy"], "metadata"))
        version, recorded = content.pop("format"), content.pop("sha256")
        expected, actual = _format_of(content), content_hash(content, tensors)
    except Exception as error:  # any error of a parser of foreign bytes
        raise PolicyError("policy file", source, "a file that rj export-policy wrote", _reason(error)) from error
    if version != expected:
        raise PolicyError(f"{source}: format", version, str(expected), "Another version of this package may read it.")
    if recorded != actual:
        raise PolicyError(f"{source}: sha256", recorded, actual, "The file was damaged or edited: get it anew.")
    return content, tensors


def read_bytes(path: Path, largest: int | None = None) -> bytes:
    """The bytes of a file of at most `largest` (None: LARGEST_FILE); PolicyError for a larger or unreadable one."""
    largest = largest or LARGEST_FILE
    try:
        with path.open("rb") as stream:
            data = stream.read(largest + 1)
    except OSError as error:
        raise PolicyError("policy file", str(path), "a readable file", str(error)) from None
    if len(data) > largest:
        raise PolicyError("policy file", str(path), f"at most {largest} bytes")
    return data


def content_hash(content: Mapping[str, Any], tensors: Tensors) -> str:
    """SHA-256 over the plain values and, in the order of their names, the arrays with name, type and shape."""
    names = sorted(tensors)
    shapes = [[name, str(tensors[name].dtype), tensors[name].shape] for name in names]
    digest = hashlib.sha256(_text([content, shapes]).encode())
    for name in names:
        digest.update(tensors[name].tobytes())
    return digest.hexdigest()


def _format_of(content: Mapping[str, Any]) -> int:
    """The version of the format: 2 with the kind of the network, which came with recurrent networks; else 1."""
    network = content.get("network")
    return 2 if isinstance(network, Mapping) and "kind" in network else 1


def _text(values: Any) -> str:
    return json.dumps(values, allow_nan=False, separators=(",", ":"))


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"[:200]
