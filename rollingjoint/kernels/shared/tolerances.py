"""The numbers by which iterations stop, shared by the solvers of one lane and of eight."""

LARGEST_INPUT = 1e12  # beyond it (or NaN) an input cannot be resolved
RESIDUAL_LIMIT = 1e-8  # N·mm: no result above it is called converged
RESIDUAL_GOAL = 1e-9  # N·mm: where iteration stops; smaller for small forces
RESIDUAL_FLOOR = 1e-12
RELATIVE_GOAL = 1e-11  # of the force scale
NEGLIGIBLE = 1e-8  # N·mm/rad: with no stiffness above it, nothing holds the pose
SMALLEST_PIVOT = 1e-10  # of the largest entry: a stiffness with smaller ones is not positive definite
MAX_STEP = 0.5  # rad in any joint
ROUNDING = 1e-14  # of the magnitude of the energy terms
