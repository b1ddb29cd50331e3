"""Second opinions on spatial arms.

Modules:
    constant_curvature: piecewise constant curvature, the usual kinematics of such arms.
    published: the published iterations.
"""
