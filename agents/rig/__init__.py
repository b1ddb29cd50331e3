"""Rigs with motors and load cells: one loop for hardware and for servos that exist in software alone.

Not yet run on hardware. docs/rig.md says what is promised.

Modules:
    protocols: what the loop asks of motors, load cells and trackers, and the errors of a rig.
    spool: ticks of a motor <-> unstretched length of its tendon.
    pace: clocks, and a fixed rate.
    guard: what every goal passes before it is sent.
    loop: a rig: motors, load cells, guard, pace and recording.
    env: RigEnv, the observations of a simulated task from a rig.
    camera: the tip as a camera sees it, by balls on the links.
    calibrate: signs, homing by tension, sweeps on the bench.
    settings: the file of a rig, and its calibration.
    export: recordings as Minari datasets and Parquet tables.
    dynamixel: Dynamixel XM430-W350 by the manufacturer's SDK.
    cells: load cells behind a serial amplifier.
    simulated: servos and load cells in software behind pseudo-terminals.

This package imports no modules; dynamixel and cells need the extra `rig`.
"""
