"""Learners of our own, as algorithms of Stable-Baselines3.

Modules:
    apg: analytic policy gradients, which train policies with memory by the derivatives of the simulator.
    demonstrations: episodes with a teacher next to the policy.
    distill: distillation, in which policies with memory imitate that teacher.
    episodes: whole episodes of a native vector environment, with gradients.
    feed_forward: a policy without memory as a torch module.
    gain: its last layer where actions vanish with the tip error.
    learner: the common base of the learners: whole episodes of all lanes, again and again.
    motion: the effect of a step on motors, tendons, tensions and tip, with its derivative.
    muon: an optimiser for matrices.
    observing: how observations answer motors, tensions and tip.
    policy: actors as Stable-Baselines3 keeps policies.
    recurrent: a policy with memory as a torch module, and its gradients over episodes.
    tape: records of an actor's steps, for their gradients.
    true_state: feedback on the true state.
    walled_episodes: whole episodes in lumens, with gradients through contact.
"""
