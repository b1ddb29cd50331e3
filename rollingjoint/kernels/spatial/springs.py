"""Springs from points of a spatial hinge chain to anchors: forces, energy, and what they add to the stiffness.

H_im gains k (a_i × (x - c_i)) . (a_m × (x - c_m)) from every spring beyond hinges i and m; docs/theory.md, section 8.
"""

from __future__ import annotations

from rollingjoint._numba.jit import part
from rollingjoint.kernels.spatial.arrays import ANCHOR, KX, KXX, LINK, POINT, PX, PY, PZ, SPRING, XF, F, K
from rollingjoint.kernels.spatial.vectors import cross, turned


@part(inline=True)
def has_springs(loads):
    """True when the loads hold a spring."""
    for row in range(loads.shape[0]):
        if loads[row, SPRING] != 0.0:
            return True
    return False


@part
def evaluate_springs(loads, state):
    """Add the forces of springs to the sums and fill held, link by link; returns their energy."""
    sums, held, pose = state.sums, state.held, state.pose
    energy = 0.0
    for i in range(held.shape[0]):
        for column in range(held.shape[1]):
            held[i, column] = 0.0
    for row in range(loads.shape[0]):
        link, k = int(loads[row, LINK]), loads[row, SPRING]
        if link == 0 or k == 0.0:
            continue
        i = link - 1
        px, py, pz = turned(pose, link, loads[row, POINT], loads[row, POINT + 1], loads[row, POINT + 2])
        x, y, z = px + pose[link, PX], py + pose[link, PY], pz + pose[link, PZ]
        dx, dy, dz = loads[row, ANCHOR] - x, loads[row, ANCHOR + 1] - y, loads[row, ANCHOR + 2] - z
        energy += 0.5 * k * (dx * dx + dy * dy + dz * dz)
        at, force = (x, y, z), (k * dx, k * dy, k * dz)
        for a in range(3):
            sums[i, F + a] += force[a]
            for b in range(3):
                sums[i, XF + 3 * a + b] += at[a] * force[b]
        products = (1.0, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z)
        for column in range(10):
            held[i, column] += k * products[column]
    return energy


@part(inline=True)
def _lever(state, i):
    """p and s of H_im = a_m . p + (c_m × a_m) . s for m <= i: what the springs' give adds, from sums beyond hinge i."""
    held = state.held
    ax, ay, az = state.axis[i, 0], state.axis[i, 1], state.axis[i, 2]
    cx, cy, cz = state.pose[i, PX], state.pose[i, PY], state.pose[i, PZ]
    kx, ky, kz = held[i, KX], held[i, KX + 1], held[i, KX + 2]
    xx, xy, xz = held[i, KXX], held[i, KXX + 1], held[i, KXX + 2]
    yy, yz, zz = held[i, KXX + 3], held[i, KXX + 4], held[i, KXX + 5]
    along = kx * ax + ky * ay + kz * az
    trace = xx + yy + zz - (cx * kx + cy * ky + cz * kz)
    px = ax * trace - (xx * ax + xy * ay + xz * az) + cx * along
    py = ay * trace - (xy * ax + yy * ay + yz * az) + cy * along
    pz = az * trace - (xz * ax + yz * ay + zz * az) + cz * along
    k = held[i, K]
    sx, sy, sz = cross(ax, ay, az, kx - k * cx, ky - k * cy, kz - k * cz)
    return px, py, pz, sx, sy, sz


@part(inline=True)
def _turned_about_origin(state, m):
    """c_m × a_m."""
    cx, cy, cz = state.pose[m, PX], state.pose[m, PY], state.pose[m, PZ]
    return cross(cx, cy, cz, state.axis[m, 0], state.axis[m, 1], state.axis[m, 2])


@part
def add_springs(state, H):
    """Add to H how the forces of springs change as their points move."""
    axis = state.axis
    for i in range(axis.shape[0]):
        if state.held[i, K] != 0.0:
            px, py, pz, sx, sy, sz = _lever(state, i)
            for m in range(i + 1):
                qx, qy, qz = _turned_about_origin(state, m)
                value = axis[m, 0] * px + axis[m, 1] * py + axis[m, 2] * pz + qx * sx + qy * sy + qz * sz
                H[i, m] += value
                if m < i:
                    H[m, i] += value


@part
def fill_spring_generators(state, sweep, first):
    """Add the springs: p to the first three columns, s and c × a in three of their own."""
    for i in range(state.angle.size):
        lever, arm = _lever(state, i), _turned_about_origin(state, i)
        for a in range(3):
            sweep.U[i, a] += lever[a]
            sweep.U[i, first + a], sweep.V[i, first + a] = lever[3 + a], arm[a]
            sweep.diagonal[i] += state.axis[i, a] * lever[a] + arm[a] * lever[3 + a]
