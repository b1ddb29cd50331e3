"""Banks of extended Kalman filters: what can be known of a mechanism that is not seen.

Modules:
    settings: what filters assume.
    hypotheses: what the filters of a bank differ in.
    prior: what they believe before anything is measured.
    model: tips, tensions and link angles of a model, and their derivatives.
    chain_model: that of a planar chain.
    arm_model: that of a hanging arm.
    models: which mechanisms have which.
    kernels: the formulas of models and play, compiled.
    levers: what loads do to joints, and joints to the tip, compiled.
    kalman: those of Kalman filters.
    estimate: means over the hypotheses.
    belief: states, covariances and evidence of many episodes.
    filters: forecasts, and what tensions and pictures change.
    bank: the filters of a bank together.
"""
