"""The exceptions: each names the value, the allowed values and the remedy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class RollingJointError(Exception):
    """Base of everything this project raises on purpose."""


class InvalidInput(RollingJointError, ValueError):
    """An argument that cannot be used.

    Args:
        what: name of the argument, as the caller knows it.
        value: the offending value.
        allowed: the allowed values, in words.
        hint: the remedy (optional).
    """

    def __init__(self, what: str, value: object, allowed: str, hint: str = "") -> None:
        self.what, self.value, self.allowed, self.hint = what, value, allowed, hint
        super().__init__(what, value, allowed, hint)

    def __str__(self) -> str:
        text = f"{self.what} = {_short(self.value)}: expected {self.allowed}."
        return one_line(f"{text} {self.hint}" if self.hint else text)


class MechanismError(InvalidInput):
    """A mechanism that cannot be built."""


class ConfigError(InvalidInput):
    """A configuration file, or one of its keys, that cannot be used."""


class SolverError(RollingJointError, RuntimeError):
    """An equilibrium that the caller required and the solver could not give."""


_PLOT = ("matplotlib", "PIL", "pygame")
_EXTRAS = {  # of pyproject.toml, and the packages that they bring; of several the first is named
    "plot": _PLOT,
    "design": ("torch",),
    "train": ("stable_baselines3", "sb3_contrib", "optuna", "torch", "tensorboard", "tqdm", "filelock", *_PLOT),
    "search": ("cma", "ribs", "optuna", "torch", "tqdm", "filelock", *_PLOT),
    "cluster": ("ray",),
    "onnx": ("onnx", "onnxruntime"),
    "data": ("minari", "h5py"),
    "video": ("moviepy",),
    "track": ("wandb",),
    "rig": ("dynamixel_sdk",),
    "parquet": ("pyarrow",),
    "camera": ("PIL",),
    "view": ("viser", *_PLOT),
    "cad": ("ezdxf", "shapely", "trimesh", "manifold3d", *_PLOT),
}


class MissingPackage(RollingJointError, ModuleNotFoundError):
    """A package that is not installed, of an extra that brings it."""


def named(error: ModuleNotFoundError, own: str = "") -> ModuleNotFoundError:
    """The error, with the extra that brings the package in one line; unchanged if there is none.

    own: the preferred extra, such as the command's.
    """
    package = (error.name or "").partition(".")[0]
    bringing = [extra for extra, packages in _EXTRAS.items() if package in packages]
    if not bringing or (isinstance(error, MissingPackage) and own not in bringing):
        return error
    extra = own if own in bringing else bringing[0]
    return MissingPackage(f'{package} is not installed: run pip install "rollingjoint[{extra}]"', name=error.name)


@contextmanager
def naming_extras(own: str = "") -> Iterator[None]:
    """A context of imports in which a package that is not installed is named with the extra that brings it.

    own: as of `named`.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise named(error, own) from None


@contextmanager
def naming(path: object) -> Iterator[None]:
    """A context in which an OSError that names no file, such as "File too large", gets this one."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def _short(value: object, limit: int = 160) -> str:
    """The beginning of repr(value), computed only that far: lists of shared lists may be endless."""
    text = ""
    for piece in _pieces(value):
        text += piece
        if len(text) > limit:
            return text[: limit - 3] + "..."
    return text


def _pieces(value: object) -> Iterator[str]:
    """repr(value) piece by piece."""
    if type(value) is dict:
        yield "{"
        for i, (key, item) in enumerate(value.items()):
            yield ", " if i else ""
            yield from _pieces(key)
            yield ": "
            yield from _pieces(item)
        yield "}"
    elif type(value) in (list, tuple):
        items: Sequence[object] = value  # type: ignore[assignment]
        yield "[" if type(value) is list else "("
        for i, item in enumerate(items):
            yield ", " if i else ""
            yield from _pieces(item)
        yield "]" if type(value) is list else ",)" if len(items) == 1 else ")"
    elif type(value) is str:
        yield repr(value[:1000])
    else:
        try:
            yield " ".join(repr(value).split())  # arrays print one row per line
        except ValueError:  # an integer of thousands of digits, which Python does not print
            yield f"a very large {type(value).__name__}"


def one_line(text: str) -> str:
    """The text with its lines joined, and characters that would not print as their escapes."""
    joined = " ".join(line.strip() for line in text.splitlines())
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in joined)
