"""Look at episodes and designs in a browser, and steer mechanisms there: python -m agents.view."""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from agents.runs.checks import integer
from agents.runs.command_line import exit_code
from agents.runs.pickles import add_trust

if TYPE_CHECKING:
    from agents.viewer.server import Rooms

EXPOSED = "allow addresses that other machines can reach"


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 stopped by Ctrl-C, 2 an error."""
    parser = argparse.ArgumentParser(prog="python -m agents.view", description="Mechanisms in a browser.")
    parser.add_argument("--run", type=Path, action="append", default=[], help="run folder to replay, repeatable")
    parser.add_argument("--policy", default="best", help='of run folders: "best" (default), "last" or a checkpoint')
    parser.add_argument(
        "--episodes", type=Path, action="append", default=[], help="recorded episodes: a file or a dataset, repeatable"
    )
    parser.add_argument("--search", type=Path, action="append", default=[], help="folder of a search, repeatable")
    parser.add_argument("--port", type=int, default=8080, help="port (default 8080); 0: any that is free")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (default 127.0.0.1)")
    parser.add_argument("--exposed", action="store_true", help=EXPOSED)
    add_trust(parser)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments), arguments.trust)


def rooms(
    runs: Sequence[Path] = (), episodes: Sequence[Path] = (), searches: Sequence[Path] = (), policy: str = "best"
) -> Rooms:
    """All rooms, with what they show from these folders and files; raises RollingJointError if one cannot be read."""
    from agents.viewer.designs import Designs
    from agents.viewer.episodes import Episodes, recorded_episodes, run_episodes_of
    from agents.viewer.rooms.control import Control
    from agents.viewer.rooms.designs import DesignsRoom
    from agents.viewer.rooms.replay import Replay

    shelf: list[Episodes] = [run_episodes_of(path, policy) for path in runs]
    shelf += [one for path in episodes for one in recorded_episodes(path)]
    found = [Designs.read(path) for path in searches]
    return {
        Control.name: Control,
        Replay.name: partial(Replay, shelf=shelf),
        DesignsRoom.name: partial(DesignsRoom, searches=found),
    }


def _command(arguments: argparse.Namespace) -> int:
    from agents.viewer.server import Viewer, check_host

    check_host(arguments.host, arguments.exposed)
    port = integer(0, 65_535)("--port", arguments.port)
    made = rooms(arguments.run, arguments.episodes, arguments.search, arguments.policy)
    viewer = Viewer(made, arguments.host, port, arguments.exposed)
    print(f"Open {viewer.url} in a browser; Ctrl-C stops.", flush=True)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        viewer.stop()
    return 0


if __name__ == "__main__":
    sys.exit(main())
