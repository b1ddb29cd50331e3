"""Rigs in software: a mechanism behind play and sheaths, servos on a bus, load cells, and faults on demand.

The manufacturer's SDK opens the bus as it would a serial adapter: it is a pseudo-terminal, which Linux and macOS have.

Modules:
    plant: the mechanism behind the motors.
    protocol2: packets of Dynamixel Protocol 2.0.
    servo: one servo, by its control table.
    bus: servos and load cells on two pseudo-terminals.
    faults: faults of a bus, of motors and of load cells.

This package imports no modules.
"""
