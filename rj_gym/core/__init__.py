"""Shared by all tasks: the environments around them, their interface, settings and random numbers.

Modules:
    arguments: checks of arguments, of saved states, and of callers.
    columns: columns of readings.
    env: the scalar environment of every task, plain and with goals.
    episodes: the interface of an episode buffer, which keeps running episodes side by side.
    generators: the random generators of many lanes, from which a kernel draws for all of them at once.
    info: infos in Gymnasium's vector form and of a single lane.
    settings: the base of every settings class.
    spaces: observation spaces and observations, plain and with goals.
    task: the interface of a task.
    vector: the native vector environment of every task, plain and with goals.
"""
