"""Train, evaluate and compare controllers for the environments of rj_gym.

    agents.config      a checked training configuration (no torch)
    agents.train       python -m agents.train --config FILE
    agents.evaluate    python -m agents.evaluate RUN
    agents.baselines   the Controller protocol and the controllers to compare with

Nothing is imported here: torch and Stable-Baselines3 are loaded by the modules that need them.
"""
