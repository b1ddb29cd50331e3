"""Shipped policies: trained networks in files that are never executed, run with NumPy alone.

The files themselves lie here, too: one NAME.safetensors per shipped policy.

Modules:
    network: the forward pass of a policy.
    file: the container of a policy.
    recorded_score: the score in a policy file, and how near to it the same episodes must score again.
    shipped: a shipped policy.
    conversion: a Stable-Baselines3 model as a network.
    export: the policy of a run folder as a shipped policy.
    loading: shipped policies by name or from a file.
"""
