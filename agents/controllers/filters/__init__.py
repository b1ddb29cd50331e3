"""Banks of extended Kalman filters: what can be known of a mechanism that is not seen.

Modules:
    hypotheses: the settings of filters, and the hypotheses in which those of a bank differ.
    prior: their belief before anything is measured.
    model: tips, tensions and link angles of a model, and their derivatives.
    models: the models of a planar chain and of a hanging arm.
    kernels: the formulas of models and play, compiled.
    levers: torques of loads at joints, and rates of the tip by joints, compiled.
    kalman: the formulas of Kalman filters, compiled.
    estimate: means over the hypotheses.
    filters: states, covariances and evidence of many episodes; forecasts, and updates by tensions and pictures.
    bank: the filters of a bank together.
"""
