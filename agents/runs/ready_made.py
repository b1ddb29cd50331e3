"""Ready-made configurations: the files of configs/, which commands take by their names, in a checkout and installed."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError

_AGENTS = Path(__file__).resolve().parents[1]
_FOLDERS = (_AGENTS / "configs", _AGENTS.parent / "configs")  # as installed, in a checkout
_ENV_FILE = "../env/{}.yaml"  # as files of configs/train name those of configs/env

TRAIN, TUNE, CAMPAIGN, SEARCH, CODESIGN, ENV = KINDS = ("train", "tune", "campaign", "search", "codesign", "env")
RESULTS = {CAMPAIGN: "runs", SEARCH: "runs/search", CODESIGN: "runs/codesign"}
"""Folders for the results of commands that make one per configuration."""


def names(kind: str) -> list[str]:
    """The names of the ready-made configurations of a kind, one of KINDS."""
    return sorted(path.stem for path in (_folder() / kind).glob("*.yaml"))


def list_of(kind: str) -> str:
    """The names of the ready-made configurations of a kind, each with the first sentence of its file, one a line."""
    width = max(len(name) for name in names(kind))
    return "\n".join(f"{name:{width}}  {_first_line(_file(kind, name))}" for name in names(kind))


def add_list(parser: argparse.ArgumentParser, kind: str) -> None:
    """Add --list, which prints the ready-made configurations of a kind and ends the command, as --help does."""
    text = f"name the ready-made configurations (configs/{kind}/) and exit"
    parser.add_argument("--list", action=_List, nargs=0, const=kind, help=text)


def add_configuration(parser: argparse.ArgumentParser, kind: str) -> None:
    """Add --list, the configuration of a kind, and --out, the folder of its results, which `given_files` reads."""
    add_list(parser, kind)
    parser.add_argument("config", help=f"YAML file, or the name of one of configs/{kind}/")
    parser.add_argument("--out", type=Path, help=f"folder (default: {RESULTS[kind]}/ and the name of the file)")


def given_files(arguments: argparse.Namespace, kind: str) -> tuple[Path, Path]:
    """The configuration file and the folder of results that are meant; raises as `configuration_file`."""
    file = configuration_file(kind, arguments.config)
    return file, arguments.out or Path(RESULTS[kind]) / file.stem


class _List(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        print(list_of(str(self.const)))
        parser.exit()


def configuration_file(kind: str, given: str | Path, folder: Path = Path()) -> Path:
    """The file that is meant: a path, relative to a folder, or the name of a ready-made configuration of this kind.

    Raises:
        ConfigError: neither a file nor such a name.
    """
    path, known = folder / given, names(kind)
    if path.is_file() or (path.suffix and path.stem not in known):
        return path
    if str(given) in known:
        return _file(kind, str(given))
    hint = f"The ready-made one is {path.stem!r}." if path.stem in known else suggestion(str(given), known)
    listed = "the names that rj train --list prints" if kind == TRAIN else ", ".join(known)
    raise ConfigError("configuration", str(given), f"a YAML file, or one of {listed}", hint)


def copied(name: str, target: Path) -> None:
    """Write a ready-made configuration of training to a file of the user's, which is not there yet.

    Raises:
        ConfigError: another name, a file that is there, or one that cannot be written.
    """
    text = configuration_file(TRAIN, name).read_text("utf-8")
    for env in names(ENV):
        text = text.replace(_ENV_FILE.format(env), env)
    try:
        with target.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise ConfigError("--write", str(target), "a file that does not exist yet") from None
    except OSError as error:
        raise ConfigError("--write", str(target), "a file that can be written", str(error)) from None


def _folder() -> Path:
    return next(folder for folder in _FOLDERS if folder.is_dir())


def _file(kind: str, name: str) -> Path:
    return _folder() / kind / f"{name}.yaml"


def _first_line(path: Path) -> str:
    """The comment that a file begins with, up to the end of its first sentence."""
    lines = path.read_text("utf-8").splitlines()
    comment = []
    for line in lines:
        if not line.startswith("#"):
            break
        comment.append(line.lstrip("# "))
    return " ".join(comment).partition(". ")[0].rstrip(".")
