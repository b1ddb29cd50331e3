"""Shipped policies: load one by name or from its file and run it, with NumPy alone.

    from agents.shipped import load_policy
    policy = load_policy("fixed_target")
    action = policy(observation)

load_policy("instrument") is the newest policy of that name, load_policy("instrument", version=0) the one for the
environments with -v0.

No torch, no Stable-Baselines3, and no code in the file is executed. docs/policies.md shows more.
"""

from agents.policies.errors import PolicyError
from agents.policies.loading import list_policies, load_policy
from agents.policies.shipped import ShippedPolicy

__all__ = ["PolicyError", "ShippedPolicy", "list_policies", "load_policy"]
