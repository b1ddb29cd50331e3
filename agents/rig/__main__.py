"""The command rj rig: check, home, bench, drive, reboot, replay. Not yet run on hardware: docs/rig.md.

Motors hold when a command ends, by whatever. An emergency stop is a switch in their supply.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.runs.command_line import exit_code, note
from rollingjoint.checks import as_integer, as_number
from rollingjoint.errors import ConfigError, InvalidInput

if TYPE_CHECKING:
    from agents.rig.settings import RigSettings

_NEAR_MM = 1.0  # a target that stays farther away is noted
_FAR_MM = 20.0  # from where the unloaded mechanism comes, as designed: targets beyond are refused; loads move the tip


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 done, 2 an error in one line, 130 stopped by Ctrl-C; motors hold after each."""
    parser = argparse.ArgumentParser(prog="rj rig", description="Drive a rig; not yet run on hardware (docs/rig.md).")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, function: Any, about: str, with_rig: bool = True) -> argparse.ArgumentParser:
        one = commands.add_parser(name, help=about, description=about)
        one.set_defaults(run=function)
        if with_rig:
            one.add_argument("rig", type=Path, metavar="RIG.yaml", help="the file of the rig")
        return one

    command("check", _check, "read motors and load cells, move nothing, and time the loop")
    homing = command("home", _home, "find wrong signs, bring tendons to a tension, keep the zero")
    homing.add_argument("--tension", type=float, default=3.0, metavar="N", help="of every tendon (default 3)")
    sweeping = command("bench", _bench, "guarded sweeps to and fro, recorded")
    sweeping.add_argument("--steps", type=int, default=1000, help="of the rig's rate (default 1000)")
    sweeping.add_argument("--bend", type=float, default=8.0, metavar="MM", help="of motors from the middle (default 8)")
    sweeping.add_argument("--seed", type=int, default=0, help="of the ends of sweeps (default 0)")
    driving = command("drive", _drive, "a policy drives to a target, recorded")
    driving.add_argument("--policy", default="instrument", metavar="NAME", help="or file (default instrument)")
    driving.add_argument("--target", type=float, nargs=2, action="append", metavar=("X", "Y"), help="[mm]; repeatable")
    driving.add_argument("--episodes", type=int, default=1, help="with targets that are drawn (default 1)")
    driving.add_argument("--seed", type=int, default=0, help="of the targets (default 0)")
    for one in (sweeping, driving):
        one.add_argument("--out", type=Path, required=True, metavar="FILE.jsonl", help="a new recording")
    rebooting = command("reboot", _reboot, "reboot a motor after a hardware error, and forget the zero")
    rebooting.add_argument("--id", type=int, required=True, metavar="N", help="of the motor, which loses its torque")
    exporting = command("export", _export, "a recording as a Minari dataset, or as a Parquet table", False)
    exporting.add_argument("recording", type=Path, metavar="FILE", help="a recording")
    exporting.add_argument(
        "--out", required=True, metavar="WHERE", help="id of a dataset (rig/bench-v0), a folder, or FILE.parquet"
    )
    replaying = command("replay", _replay, "recorded motors through the model, beside what was measured", False)
    replaying.add_argument("recording", type=Path, metavar="FILE", help="a recording")
    replaying.add_argument("--identified", type=Path, metavar="FOLDER", help="of rj identify (default: as designed)")
    replaying.add_argument("--mechanism", metavar="NAME", help="preset or file (default: as the recording says)")
    arguments = parser.parse_args(argv)
    return exit_code(lambda: int(arguments.run(arguments)), extra="rig")


def _check(arguments: argparse.Namespace) -> int:
    from agents.rig.settings import connected

    settings = _settings(arguments)
    calibrated = settings.calibration_path.is_file()
    with connected(settings, calibrated) as (rig, motors):
        state = rig.begin("check")
        for _ in range(round(2.0 * settings.rate)):
            state = rig.step(rig.goal)
        print(f"motors [mm]: {_row(state.motors)}{'' if calibrated else ' (not homed)'}")
        print(f"tensions [N]: {_row(state.tensions)}")
        print(rig.pace.summary())
        counts = motors.counts
        print(f"{counts['reads']} readings, {counts['retries']} asked again, {counts['old']} old answers")
    return 0


def _home(arguments: argparse.Namespace) -> int:
    from agents.rig.calibrate import home, wrong_signs
    from agents.rig.settings import connected

    settings = _settings(arguments)
    as_number("--tension", arguments.tension, settings.guard.low, settings.guard.high, error=ConfigError)
    with connected(settings, calibrated=False) as (rig, motors):
        rig.begin("home")
        if wrong := wrong_signs(rig):
            ids = [settings.motors["ids"][j] for j in wrong]
            raise ConfigError(
                "signs", settings.motors["signs"], f"the other sign for the motors {ids}", "Nothing was kept."
            )
        state, lengths = home(rig, settings.mechanism, arguments.tension)
        motors.read()
        settings.keep_calibration(motors.ticks, lengths, arguments.tension)
    print(f"tensions {_row(state.tensions)} N; zero kept in {settings.calibration_path}")
    return 0


def _bench(arguments: argparse.Namespace) -> int:
    from agents.rig.calibrate import bench
    from agents.rig.settings import connected
    from agents.runs.command_line import progress_bar
    from rollingjoint.identify import RecordingWriter

    settings = _settings(arguments)
    as_integer("--steps", arguments.steps, 1, 10**6, error=ConfigError)
    travel = settings.guard.travel_mm
    as_number(
        "--bend", arguments.bend, 0.1, travel, allowed=f"0.1 to {travel:g} mm, guard.travel_mm", error=ConfigError
    )
    as_integer("--seed", arguments.seed, 0, error=ConfigError)
    settings.spools()  # its errors before the file
    writer = RecordingWriter(arguments.out, settings.mechanism, rate=settings.rate, rig=str(settings.path))
    with connected(settings, True, writer) as (rig, _), progress_bar(arguments.steps, " steps", leave=False) as bar:
        rig.begin("bench")
        bench(rig, arguments.steps, arguments.bend, arguments.seed, bar.update)
        print(rig.pace.summary())
    print(f"recorded: {arguments.out}")
    return 0


def _drive(arguments: argparse.Namespace) -> int:
    import numpy as np

    from agents.policies.loading import load_policy
    from agents.rig.env import RigEnv, task_of_rigs
    from agents.rig.settings import connected
    from rollingjoint.identify import RecordingWriter

    settings, policy = _settings(arguments), load_policy(arguments.policy)
    as_integer("--episodes", arguments.episodes, 1, 10_000, error=ConfigError)
    as_integer("--seed", arguments.seed, 0, error=ConfigError)
    if policy.mechanism.n_tendons != settings.mechanism.n_tendons:
        raise ConfigError("--policy", arguments.policy, f"a policy for {settings.mechanism.n_tendons} tendons")
    try:
        task_of_rigs(policy.settings)
    except InvalidInput:
        allowed = "a policy that sees motors and tensions, such as instrument, and no poses"
        raise ConfigError("--policy", arguments.policy, allowed) from None
    for target in arguments.target or ():
        _check_reach(settings, target)
    settings.spools()
    about = {"rate": settings.rate, "rig": str(settings.path), "policy": policy.name, "policy_sha256": policy.sha256}
    writer = RecordingWriter(arguments.out, settings.mechanism, **about)
    targets: list[Any] = arguments.target or [None] * arguments.episodes
    with connected(settings, True, writer) as (rig, _):
        env = RigEnv(policy.settings, rig)
        for episode, target in enumerate(targets):
            options = None if target is None else {"target": tuple(target)}
            observation, info = env.reset(seed=arguments.seed + episode, options=options)
            policy.reset()
            done, errors = False, []
            while not done:
                observation, _, _, done, info = env.step(policy(observation))
                errors.append(info.get("error_mm", np.nan))
            seen = (
                "" if np.isnan(errors).all() else f", tip error {np.mean(errors[-10:]):.2f} mm over the last 10 steps"
            )
            print(f"episode {episode + 1}: tensions {_row(info['tensions'])} N{seen}")
        print(rig.pace.summary())
    print(f"recorded: {arguments.out}")
    return 0


def _check_reach(settings: RigSettings, target: Sequence[float]) -> None:
    """Note a target that the tip of the mechanism as designed does not reach; ConfigError where it stays far away."""
    from rollingjoint import reach

    found = reach(settings.mechanism, target, tension_limits=(settings.guard.low, settings.guard.high))
    near = f"the nearest place found is ({found.tip[0]:.1f}, {found.tip[1]:.1f})"
    if not found.distance < _FAR_MM:
        raise ConfigError("--target", list(target), f"a place that the tip reaches [mm]; {near}")
    if found.distance > _NEAR_MM:
        note(f"--target {list(target)}: {near}, for the unloaded mechanism as designed")


def _reboot(arguments: argparse.Namespace) -> int:
    from agents.rig.settings import reboot

    settings = _settings(arguments)
    reboot(settings, arguments.id)
    print(f"motor {arguments.id} was rebooted: it has no torque, its turns are lost, and the zero is forgotten")
    print(f"next: rj rig home {settings.path}")
    return 0


def _replay(arguments: argparse.Namespace) -> int:
    import numpy as np

    from rollingjoint.identify import read_recording
    from rollingjoint.identify.rig import Misfit, designed_space, mechanism_of
    from rollingjoint.identify.rig_files import load_identified
    from rollingjoint.identify.twin import RigModel
    from rollingjoint.io.mechanism_file import load_mechanism

    recording = read_recording(arguments.recording, note)
    mechanism = mechanism_of(recording, load_mechanism(arguments.mechanism) if arguments.mechanism else None)
    if arguments.identified:
        space, values = load_identified(arguments.identified, mechanism)
    else:
        space, values = designed_space(mechanism)
    misfit = Misfit(RigModel(recording, space))
    errors = misfit.errors(((values - space.mean) / space.sd)[None])
    print(f"{recording.steps} steps in {len(recording.runs)} run(s), {len(recording.events)} event(s)")
    for name, unit in (("tension", "N"), ("position", "mm")):
        sizes = np.abs(errors[name][np.isfinite(errors[name])])
        if errors[name].size:
            lost = 1.0 - sizes.size / errors[name].size
            text = (
                "no equilibrium"
                if not sizes.size
                else f"rms {np.sqrt(np.mean(sizes**2)):.3f}, largest {sizes.max():.3f} {unit}"
            )
            print(f"{name}: {text}; {100 * lost:.1f} % of readings without an equilibrium of the model")
    return 0


def _export(arguments: argparse.Namespace) -> int:
    from agents.rig.export import write_minari, write_parquet

    where: str | Path = arguments.out
    if Path(where).suffix.lower() == ".parquet":
        steps = write_parquet(arguments.recording, where)
    else:
        where, steps = write_minari(arguments.recording, where)
    print(f"{where}: {steps} steps")
    return 0


def _settings(arguments: argparse.Namespace) -> RigSettings:
    from agents.rig.settings import load_rig

    return load_rig(arguments.rig)


def _row(values: Any) -> str:
    return ", ".join(f"{value:.2f}" for value in values)


if __name__ == "__main__":
    sys.exit(main())
