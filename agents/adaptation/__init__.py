"""A few minutes with one robot outside the training distribution: its identification, and controllers adapted to it.

Modules:
    robot: robots by number.
    controllers: Instrument-v0's by name, file, run or policy.
    driving: one score per controller, with an interval over robots.
    bench: robots on the bench: motors sweep to and fro, positions, tensions and perhaps the tip are recorded.
    identify: beliefs about a robot, and the twin that explains a recording of it.
    tuning: settings of opponents, searched on robots as they may be.
    informed: controllers that know the twin.
    world: episodes of robots as they may be after identification.
    fine_tuning: policies with memory, trained on in that world.
    trial: before and after, on many robots.

This package imports no modules; torch is loaded by fine_tuning alone.
"""
