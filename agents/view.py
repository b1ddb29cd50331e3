"""Look at episodes and designs in a browser, and steer mechanisms there: rj view."""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from agents.runs.checks import integer
from agents.runs.command_line import exit_code, note
from agents.runs.consent import add_consent, consent_of
from agents.runs.files import write_text
from rollingjoint import PRESETS
from rollingjoint.checks import as_number
from rollingjoint.errors import ConfigError, MissingPackage, naming_extras
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.io.surroundings_file import load_surroundings

if TYPE_CHECKING:
    from agents.viewer.around import WallScene
    from agents.viewer.episodes import EpisodeSet
    from agents.viewer.server import Rooms

EPISODES = "a file or dataset of recorded episodes, or a shipped policy by name; repeatable"
RECORD = "write one page that plays an episode without a server, and end"
AROUND = "YAML file with walls, to explore the first chain of their kind among them; repeatable"
BASE = "pose of the base among the walls of files: X Y ANGLE, in space X Y Z and a rotation vector [mm, rad]"
RECORDING = "of a rig, to --record: its motors through the model, and the tips that were measured"
IDENTIFIED = "of rj identify, for --recording (default: the mechanism as designed)"
EXPOSED = "allow addresses that other machines can reach"


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 130 stopped by Ctrl-C, 2 an error."""
    parser = argparse.ArgumentParser(prog="rj view", description="Mechanisms in a browser.")
    parser.add_argument("mechanism", nargs="*", default=[], help="a preset or a mechanism file to explore")
    parser.add_argument("--surroundings", action="append", default=[], metavar="FILE", help=AROUND)
    parser.add_argument("--base", nargs="+", type=float, default=[0.0] * 3, metavar="NUMBER", help=BASE)
    parser.add_argument("--run", type=Path, action="append", default=[], help="run folder to replay, repeatable")
    parser.add_argument("--policy", default="best", help='of run folders: "best" (default), "last" or a checkpoint')
    parser.add_argument("--episodes", action="append", default=[], help=EPISODES)
    parser.add_argument("--search", type=Path, action="append", default=[], help="folder of a search, repeatable")
    parser.add_argument("--recording", type=Path, metavar="FILE", help=RECORDING)
    parser.add_argument("--identified", type=Path, metavar="FOLDER", help=IDENTIFIED)
    parser.add_argument("--record", type=Path, metavar="OUT.html", help=RECORD)
    parser.add_argument("--which", default="median", help='to record: "best", "median" (default), "worst" or a seed')
    parser.add_argument("--beside", action="append", default=[], help="controller to record over it, repeatable")
    parser.add_argument("--port", type=int, default=8080, help="port (default 8080); 0: any that is free")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (default 127.0.0.1)")
    parser.add_argument("--exposed", action="store_true", help=EXPOSED)
    add_consent(parser)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments), consent_of(arguments))


def rooms(
    shelf: Sequence[EpisodeSet] = (),
    searches: Sequence[Path] = (),
    mechanisms: Sequence[str] = (),
    scenes: Mapping[str, WallScene] | None = None,
) -> Rooms:
    """All rooms, with these episodes, searches, mechanisms and scenes of walls to choose from.

    Designs is left out where no search is given and the packages that it needs, of the extra `search`, are missing.

    Raises:
        RunFolderError: a folder without a search. MechanismError: a file without a mechanism. MissingPackage: a search
            is given, and a package that Designs needs is not installed.
    """
    from agents.viewer.rooms.control import Control
    from agents.viewer.rooms.explore import Explore
    from agents.viewer.rooms.replay import Replay

    for name in mechanisms:
        load_mechanism(name)
    names = tuple(dict.fromkeys([*mechanisms, *PRESETS]))
    offered: Rooms = {
        Explore.name: partial(Explore, mechanisms=names, scenes=scenes),
        Control.name: Control,
        Replay.name: partial(Replay, shelf=shelf),
    }
    try:
        with naming_extras("search"):
            from agents.viewer.designs import Designs
            from agents.viewer.rooms.designs import DesignsRoom
    except MissingPackage:
        if searches:
            raise
        return offered
    designs = [Designs.read(path) for path in searches]
    return {**offered, DesignsRoom.name: partial(DesignsRoom, searches=designs)}


def _command(arguments: argparse.Namespace) -> int:
    if arguments.recording or arguments.identified:
        return _replay(arguments)
    from agents.viewer.episodes import episodes_of, run_episodes_of

    shelf: list[EpisodeSet] = [run_episodes_of(path, arguments.policy) for path in arguments.run]
    shelf += [item for name in arguments.episodes for item in episodes_of(name)]
    return _record(arguments, shelf) if arguments.record else _serve(arguments, shelf)


def _serve(arguments: argparse.Namespace, shelf: Sequence[EpisodeSet]) -> int:
    from agents.viewer.camera import mechanism_view
    from agents.viewer.server import Viewer, check_host

    check_host(arguments.host, arguments.exposed)
    port = integer(0, 65_535)("--port", arguments.port)
    all_rooms = rooms(shelf, arguments.search, arguments.mechanism, _scenes(arguments))
    first = load_mechanism(next(iter([*arguments.mechanism, *PRESETS])))
    viewer = Viewer(all_rooms, arguments.host, port, arguments.exposed, mechanism_view(first))
    print(f"Open {viewer.url} in a browser; Ctrl-C stops.", flush=True)
    try:
        threading.Event().wait()
    finally:
        viewer.stop()
    return 0


def _scenes(arguments: argparse.Namespace) -> dict[str, WallScene]:
    """The surroundings of the files, by their names."""
    from agents.viewer.around import WallScene

    if any(arguments.base) and not arguments.surroundings:
        raise ConfigError("--base", arguments.base, "--surroundings beside it")
    base = tuple(as_number("--base", value) for value in arguments.base)
    every = {name: load_surroundings(name) for name in arguments.surroundings}
    chains = [load_mechanism(name) for name in arguments.mechanism]
    for name, around in every.items():
        if chains and all(chain.dimension != around.dimension for chain in chains):
            raise ConfigError("--surroundings", name, f"walls around {chains[0].title}")
        if len(base) != 3 and (around.dimension == 2 or len(base) != 6):
            raise ConfigError("--base", arguments.base, "three numbers, in space three or six")
    return {Path(name).stem: WallScene(around, base) for name, around in every.items()}


def _replay(arguments: argparse.Namespace) -> int:
    """Write the page of a recording of a rig."""
    from agents.viewer.record import recording_page
    from rollingjoint.identify import read_recording
    from rollingjoint.identify.rig import designed_space, mechanism_of
    from rollingjoint.identify.rig_files import load_identified

    for option in ("recording", "record"):
        if getattr(arguments, option) is None:
            raise ConfigError(f"--{option}", None, "a file; --recording FILE and --record OUT.html go together")
    recording = read_recording(arguments.recording, note)
    given = load_mechanism(arguments.mechanism[0]) if arguments.mechanism else None
    mechanism = mechanism_of(recording, given)
    space, values = (
        load_identified(arguments.identified, mechanism) if arguments.identified else designed_space(mechanism)
    )
    page = recording_page(recording, space, values, title=arguments.recording.name)
    return _written(arguments.record, page, f"{recording.steps} steps of {arguments.recording}")


def _record(arguments: argparse.Namespace, shelf: Sequence[EpisodeSet]) -> int:
    from agents.viewer.record import episode_page, sweep_page

    if arguments.mechanism and not shelf:
        name = arguments.mechanism[0]
        return _written(arguments.record, sweep_page(load_mechanism(name), name), f"{name}, every tendon in turn")
    if not shelf:
        expected = "a mechanism, --run or --episodes beside it, which say what to record"
        raise ConfigError("--record", str(arguments.record), expected)
    seed = shelf[0].seed_of(arguments.which)
    films = shelf[0].films(seed, arguments.beside)
    what = f"{films[0].name}, seed {seed}, {films[0].steps} steps"
    return _written(arguments.record, episode_page(films), what)


def _written(path: Path, page: str, what: str) -> int:
    write_text(path, page)
    print(f"{path}: {what}, {path.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
