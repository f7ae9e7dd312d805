"""Closed-form force of the crank-knuckle coupling, for physics steps in which this coupling is the only constraint.

MuJoCo computes constraint forces f from a quadratic problem. With couplings only, which act in both directions, the
problem is linear: with the inertia M, the Jacobian J, the acceleration a_0 without constraints, MuJoCo's reference
acceleration a_ref and the regularisation R

  (J M^-1 J' + R) f = a_ref - J a_0.

This equation has two rows and is solved with MuJoCo's factorisation M = L' D L. The motion is the same as with MuJoCo's
solver, except for rounding errors. Other constraints (contacts, stops, friction, engaged clutches) need the solver. The
wrenches on the bodies are summed over the kinematic tree, with MuJoCo's motion axes `cdof` at the centre of mass.
"""

from agrobot_mj.core.kernels import kernel
from agrobot_mj.core.signals import Array
from agrobot_mj.core.vectors import Vector, cross
from agrobot_mj.plants.mujoco.views import Coupling, Views

LEFT, RIGHT = 0, 1


@kernel
def is_alone(c: Coupling) -> bool:
    """Return whether only the knuckle couplings are active: no other equality constraint and no joint friction."""
    if c.rows.size == 0:
        return False
    active = 0
    for i in range(c.eq_active.size):
        active += c.eq_active[i]
    for i in range(c.frictionloss.size):
        if c.frictionloss[i] > 0.0:
            return False
    return bool(active == 2 and c.eq_active[c.rows[LEFT]] and c.eq_active[c.rows[RIGHT]])


@kernel
def is_within_stops(c: Coupling, qpos: Array) -> bool:
    """Return whether all joints are between their stops; NaN gives False."""
    for i in range(c.stops_q.size):
        angle = qpos[c.stops_q[i]]
        if not c.stops[i, 0] <= angle <= c.stops[i, 1]:
            return False
    return True


@kernel
def set_coupled(c: Coupling, coupled: bool) -> None:
    """Enable or disable MuJoCo's constraints between crank and knuckles. The function `accelerate` replaces disabled
    constraints."""
    c.eq_active[c.rows[LEFT]] = coupled
    c.eq_active[c.rows[RIGHT]] = coupled


@kernel
def power(x: float, p: float) -> float:
    """Return `x` to the power `p`, without calling `pow` for p = 1 and 2."""
    return x * x if p == 2.0 else x if p == 1.0 else float(x**p)


@kernel
def impedance(solimp: Array, error: float) -> float:
    """Return MuJoCo's impedance [-] of a constraint with the parameters `solimp` (5,) at the position error `error`."""
    low, high, width, middle, p = solimp[0], solimp[1], solimp[2], solimp[3], solimp[4]
    if low == high or width <= 1e-15:
        return float(0.5 * (low + high))
    x = abs(error) / width
    if x >= 1.0:
        return float(high)
    if p == 1.0:
        y = x
    elif x <= middle:
        y = power(x, p) / power(middle, p - 1.0)
    else:
        y = 1.0 - power(1.0 - x, p) / power(1.0 - middle, p - 1.0)
    return float(low + y * (high - low))


@kernel
def coupling_values(v: Views, side: int) -> Vector:
    """Return gear ratio d(knuckle)/d(crank), reference acceleration a_ref and regularisation R of the coupling on a
    `side`."""
    c, i = v.coupling, v.coupling.rows[side]
    p, delta, knuckle = c.eq_data[i], v.qpos[v.steer_q], c.knuckles_v[side]
    square = delta * delta
    error = (
        v.qpos[v.knuckles_q[side]]
        - p[0]
        - (p[1] * delta + p[2] * square + p[3] * square * delta + p[4] * square * square)
    )
    ratio = p[1] + 2.0 * p[2] * delta + 3.0 * p[3] * square + 4.0 * p[4] * square * delta
    share = impedance(c.solimp[side], error)
    rate = v.qvel[knuckle] - ratio * v.qvel[v.steer_v]
    reference = -c.solref[side, 1] * rate - c.solref[side, 0] * share * error
    return ratio, reference, (1.0 - share) / share * (c.weights[knuckle] + c.weights[v.steer_v])


@kernel
def add_forces(v: Views) -> None:
    """Write the sum of all forces except the coupling forces to `qfrc_smooth`."""
    c, com = v.coupling, v.root_com
    for b in range(1, c.body_parent.size):
        x, force = v.xipos[b], (v.xfrc[b, 0], v.xfrc[b, 1], v.xfrc[b, 2])
        torque = cross((x[0] - com[0], x[1] - com[1], x[2] - com[2]), force)
        for k in range(3):
            c.wrenches[b, k] = v.xfrc[b, 3 + k] + torque[k]
            c.wrenches[b, 3 + k] = force[k]
    i = c.smooth.size
    for b in range(c.body_parent.size - 1, 0, -1):
        w, parent = c.wrenches[b], c.body_parent[b]
        for _ in range(c.body_dofs[b]):
            i -= 1
            s = c.cdof[i]
            along = s[0] * w[0] + s[1] * w[1] + s[2] * w[2] + s[3] * w[3] + s[4] * w[4] + s[5] * w[5]
            c.smooth[i] = c.passive[i] - c.bias[i] + c.applied[i] + c.actuator[i] + along
        if parent > 0:
            for k in range(6):
                c.wrenches[parent, k] += w[k]


@kernel
def accelerate(v: Views) -> None:
    """Compute the accelerations (`qacc`) and the forces of both knuckle couplings (`qfrc_constraint`) in place."""
    add_forces(v)
    c, steer, left, right = v.coupling, v.steer_v, v.coupling.knuckles_v[LEFT], v.coupling.knuckles_v[RIGHT]
    ratio_l, reference_l, soft_l = coupling_values(v, LEFT)
    ratio_r, reference_r, soft_r = coupling_values(v, RIGHT)
    n, (z, of_l, of_r) = c.smooth.size, (c.work[0], c.work[1], c.work[2])
    for i in range(n):
        z[i], of_l[i], of_r[i], c.constraint[i] = c.smooth[i], 0.0, 0.0, 0.0
    of_l[left], of_l[steer], of_r[right], of_r[steer] = 1.0, -ratio_l, 1.0, -ratio_r
    # L^-T times the forces and both rows of J, and their products with D^-1 in between
    A_ll, A_lr, A_rr, b_l, b_r, end = soft_l, 0.0, soft_r, reference_l, reference_r, c.columns.size
    for i in range(n - 1, -1, -1):
        f, x_l, x_r, start, last = z[i], of_l[i], of_r[i], end - c.row_nonzeros[i], end - 1
        end = start
        if x_l == 0.0 and x_r == 0.0:
            for k in range(start, last):
                z[c.columns[k]] -= c.factor[k] * f
            continue
        for k in range(start, last):
            j, share = c.columns[k], c.factor[k]
            z[j] -= share * f
            of_l[j] -= share * x_l
            of_r[j] -= share * x_r
        D_l, D_r = c.inverse_diagonal[i] * x_l, c.inverse_diagonal[i] * x_r
        A_ll, A_lr, A_rr = A_ll + D_l * x_l, A_lr + D_l * x_r, A_rr + D_r * x_r
        b_l, b_r = b_l - D_l * f, b_r - D_r * f
    det = A_ll * A_rr - A_lr * A_lr
    f_l, f_r = (A_rr * b_l - A_lr * b_r) / det, (A_ll * b_r - A_lr * b_l) / det
    start = 0
    for i in range(n):
        x, last = c.inverse_diagonal[i] * (z[i] + f_l * of_l[i] + f_r * of_r[i]), start + c.row_nonzeros[i] - 1
        for k in range(start, last):
            x -= c.factor[k] * c.qacc[c.columns[k]]
        c.qacc[i], start = x, last + 1
    c.constraint[left], c.constraint[right], c.constraint[steer] = f_l, f_r, -ratio_l * f_l - ratio_r * f_r
