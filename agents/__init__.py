"""Train, evaluate and compare controllers for the environments of rj_gym.

    agents.runs.config      a checked training configuration (no torch)
    agents.train       python -m agents.train --config FILE, or --resume RUN
    agents.evaluate    python -m agents.evaluate RUN
    agents.tune        python -m agents.tune --config FILE --study DIR
    agents.campaign    python -m agents.campaign FILE --out DIR: many runs
    agents.results     python -m agents.results DIR: the page that compares them
    agents.evaluation.controller  the Controller protocol: how to plug in one's own
    agents.baselines   controllers to compare with
    agents.evaluation.floor       the smallest tip error that any command can reach
    agents.shipped     load_policy: trained policies that run with NumPy alone
    agents.export      python -m agents.export RUN --name NAME

Nothing is imported here: torch and Stable-Baselines3 are loaded by the modules that need them.
"""
