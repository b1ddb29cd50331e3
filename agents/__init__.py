"""Training, evaluation and comparison of controllers for the environments of rj_gym.

Modules:
    train: python -m agents.train --config FILE, or --resume RUN.
    evaluate: python -m agents.evaluate RUN; evaluate_controllers from Python.
    tune: python -m agents.tune --config FILE --study DIR.
    campaign: python -m agents.campaign FILE --out DIR: many runs.
    export: python -m agents.export RUN --name NAME.
    dataset: python -m agents.dataset CONTROLLER --steps N --out WHERE: episodes for learning offline.
    shipped: load_policy: trained policies that run with NumPy alone.
    enter: python -m agents.enter FILE.py:NAME: score a controller of your own beside the others.
    executors: where work units run: processes of this machine, or a Ray cluster.
    runs: what a run is: configuration and folder.
    evaluation: controllers, episodes, scores, floors.
    controllers: controllers that are programmed, from model inverses to banks of filters.
    baselines: the former name of controllers.
    policies: shipped policies and their files.
    training: from a configuration to a run folder.
    learners: learners of our own.
    tuning: studies of hyper-parameters.
    results: python -m agents.results DIR: the page that compares runs.
    search: python -m agents.search FILE: design search.
    adapt: python -m agents.adapt --controller NAME: controllers adapted to robots that nobody modelled.
    adaptation: what a robot is after a few minutes on the bench, and controllers that know it.
    robots: python -m agents.robots: controllers on robots that nobody modelled.
    view: python -m agents.view: episodes and designs in a browser.
    viewer: its rooms.

Torch and Stable-Baselines3 are loaded by the modules that need them.
"""

from rollingjoint import interrupts as _interrupts  # noqa: F401 (it handles Ctrl-C while a command is imported)
