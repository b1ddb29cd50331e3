"""Policies by name, from a policy file or from a run folder; from pickles only if they are trusted."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from agents.policies.errors import PolicyError
from agents.policies.file import SUFFIX, read_bytes, unpack
from agents.policies.shipped import ShippedPolicy
from agents.runs.consent import Consent, allowing
from agents.runs.folder import PolicyFiles
from rj_gym import IDS
from rollingjoint.checks import suggestion
from rollingjoint.errors import MissingPackage

FOLDER = Path(__file__).parent
IN_A_RUN = PolicyFiles.within(Path()).network.name
PICKLE = "An SB3 zip holds pickles, and loading one can run any code that its author put there"


def load_policy(name_or_path: str | Path, trust_pickle: bool = False, version: int | None = None) -> ShippedPolicy:
    """The shipped policy of that name, or the policy in the file at that path.

    Args:
        name_or_path: one of list_policies(), a policy file that rj export-policy wrote, or policy.safetensors or
            policy.zip in a run folder.
        version: of the environment of a shipped policy, 1 of rj_gym/Instrument-v1; None: the newest that ships.
        trust_pickle: whether an SB3 zip may be loaded. That runs any code that its author put there, and needs torch.
    Raises:
        PolicyError: no such policy, a file that is damaged, edited or none of ours, or a zip without `trust_pickle`.
        RunFolderError: a run folder that cannot be read.
    """
    allowed = f"a policy file or one of {', '.join(list_policies())}"
    if not isinstance(name_or_path, str | os.PathLike):
        raise PolicyError("policy", name_or_path, allowed)
    path, ships = Path(name_or_path), str(name_or_path) in list_policies()
    if version is not None and not ships and path.is_file():
        raise PolicyError("version", version, "None for a file, which has one policy")
    if path.suffix == ".zip":
        return _load_pickle(path, trust_pickle)
    if ships:
        path = _file_of(str(name_or_path), version)
    elif not path.is_file():
        hint = suggestion(str(name_or_path), list_policies())
        raise PolicyError("policy", str(name_or_path), allowed, hint)
    elif path.name == IN_A_RUN:
        from agents.policies.export import policy_in_run

        return policy_in_run(path)
    return ShippedPolicy.from_bytes(read_bytes(path), str(path))


def list_policies() -> list[str]:
    """Names of the shipped policies, for load_policy."""
    return sorted({name for name, _ in _shipped()})


def shipped_policies(every: bool = False) -> list[ShippedPolicy]:
    """All shipped policies of tracking tasks with one mechanism, of every version of their environments.

    Args:
        every: whether those of other tasks belong to them, which most commands cannot play; without torch those of many
            mechanisms are left out.
    """
    policies = []
    for (name, version), path in sorted(_shipped().items()):
        if every or _env_id(path) in IDS:
            with suppress(MissingPackage):
                policies.append(load_policy(name, version=version))
    return policies


def _env_id(path: Path) -> str:
    """The environment of a policy file, which is not made for that."""
    content, _ = unpack(read_bytes(path), str(path))
    return str(content["environment"]["id"])


def _shipped() -> dict[tuple[str, int], Path]:
    """Files of the shipped policies by name and version: NAME.safetensors for version 0, NAME-v1.safetensors for 1."""
    parts = {path: path.stem.rpartition("-v") for path in FOLDER.glob(f"*{SUFFIX}")}
    return {(name, int(number)) if name else (path.stem, 0): path for path, (name, _, number) in parts.items()}


def _file_of(name: str, version: int | None) -> Path:
    """The file of a shipped policy; raises PolicyError for a version that does not ship."""
    versions = {number: path for (each, number), path in _shipped().items() if each == name}
    number = max(versions) if version is None else version
    if number not in versions:
        allowed = f"one of {', '.join(map(str, sorted(versions)))}"
        raise PolicyError(f"version of the policy {name!r}", version, allowed, "Others are trained with rj train.")
    return versions[number]


def _load_pickle(path: Path, trusted: bool) -> ShippedPolicy:
    if not trusted:
        hint = f"{PICKLE}: pass trust_pickle=True only if you trust it, or load {IN_A_RUN} beside it."
        raise PolicyError("policy", str(path), f"a {SUFFIX} file", hint)
    from agents.policies.export import policy_in_run

    with allowing(Consent(pickles=True)):
        return policy_in_run(path)
