"""Training, evaluation and comparison of controllers for the environments of rj_gym.

Modules:
    train: rj train --config FILE, or --resume RUN.
    evaluate: rj evaluate RUN; evaluate_controllers from Python.
    tune: rj tune --config FILE --study DIR.
    campaign: rj campaign FILE --out DIR: many runs.
    export: rj export-policy RUN --name NAME.
    dataset: rj dataset CONTROLLER --steps N --out WHERE: episodes for learning offline.
    shipped: load_policy: trained policies that run with NumPy alone.
    enter: rj enter FILE.py:NAME: score a controller of your own beside the others.
    executors: where work units run: processes of this machine, or a Ray cluster.
    runs: what a run is: configuration and folder.
    evaluation: controllers, episodes, scores, floors.
    baselines: controllers to compare with.
    policies: shipped policies and their files.
    training: from a configuration to a run folder.
    learners: learners of our own.
    tuning: studies of hyper-parameters.
    results: rj results DIR: the page that compares runs.
    search: rj search FILE: design search.
    adapt: rj adapt --controller NAME: controllers adapted to robots that nobody modelled.
    adaptation: what a robot is after a few minutes on the bench, and controllers that know it.
    robots: rj robots: controllers on robots that nobody modelled.
    studies: measurements of our own controllers that a command repeats; nothing imports them.
    view: rj view: episodes and designs in a browser.
    viewer: its rooms.

Torch and Stable-Baselines3 are loaded by the modules that need them.
"""

from rollingjoint import interrupts as _interrupts  # noqa: F401 (it handles Ctrl-C while a command is imported)
