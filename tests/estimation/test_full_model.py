"""Model of `ekf_full`: derivatives, linear special cases, and consistency of the errors with the covariance."""

from math import cos, radians, sin

import numpy as np
import pytest
from scipy.stats import chi2

from agrobot_mj.core.signals import NO_FIX, Fix, Quality
from agrobot_mj.estimation.full_core import FOUND, Core, Gates, Inputs, Smooth
from agrobot_mj.estimation.full_filter import FullFilter, step
from agrobot_mj.estimation.full_model import (
    AHEAD,
    B_G,
    B_S,
    BETA,
    G_E,
    G_N,
    OMEGA,
    PSI,
    C,
    D,
    FixNoise,
    FullLevels,
    K,
    N,
    S,
    SideLoad,
    V,
    X,
    Y,
    braking,
    course,
    process_noise,
    propagate_mean,
    steady_gain,
    transition,
)
from agrobot_mj.estimation.full_rows import FixNumbers, MotionNoise, MotionReadings, fix_rows, motion_rows

DT = 0.05
LEVELS = FullLevels(
    wheelbase=1.4,
    walks=(0.01, 0.01, 0.002, 0.1, 0.05, 1e-4, 2e-3, 1e-3, 2e-4, 5e-4, 1e-4),
    gyro_sigma=0.002,
    wheel_sigma=0.02,
    steer_sigma=0.02,
    velocity_sigma=0.03,
)
NOISE = FixNoise(correlated=0.011, white=0.017, correlation_time=30.0)
OPEN = Gates(nis=1e9, position=1e9, velocity=1e9, patience=40)


def filter_of(levels, antenna=0.0):
    """Return a filter with open gates and equal position errors for all fix qualities."""
    return FullFilter(levels, (NOISE,) * 4, OPEN, (0.0, 0.0, antenna), 0.0)


STATES = [
    np.array([3.0, -2.0, psi, v, omega, 0.01, -0.03, 0.5, -1.0, 0.02, 0.012, 0.05, 0.017, 0.03])
    for psi in (0.0, 1.0, -2.5, 7.0)
    for v in (-1.0, 0.0, 1.2)
    for omega in (0.0, 0.3)
]


def derivative(function, state, h=1e-6):
    """Return the derivative of a function of the state by central differences, with values along the first axis."""
    return np.transpose([(function(state + h * e) - function(state - h * e)) / (2 * h) for e in np.eye(N)])


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("side", [SideLoad(), SideLoad(-1.7, 0.1)])
def test_transition_jacobian_equals_finite_differences(state, side):
    fixed = (side, DT, 0.99)
    assert np.allclose(
        transition(state, *fixed), derivative(lambda x: propagate_mean(x, *fixed), state), rtol=0, atol=1e-8
    )


SIDE = SideLoad(-1.7, 0.1)
FIX = FixNumbers(3.1, -2.2, 0.4, 0.9, np.nan, 0.0, 0.0, 0.03**2, 0.0, np.nan)
SLIDING = MotionNoise(1.4, 0.02**2, 0.002**2, 0.02**2)


def motion(state, **measured):
    """Return innovations (m,) and Jacobian (m, N) of measurements of the motion."""
    y, H, R = np.zeros(10), np.zeros((10, N)), np.zeros((10, 10))
    m = motion_rows(state, MotionReadings(**measured), SLIDING, y, H, R)
    assert (np.diag(R)[:m] > 0.0).all()
    return y[:m], H[:m]


def of_fix(state, first, fix=FIX):
    """Return innovations and Jacobian of two rows of a fix, starting with row `first`."""
    rows = fix_rows(state, np.eye(N), fix, NOISE, SIDE)
    return rows.innovation[first : first + 2], rows.jacobian[first : first + 2]


def of_tilted_fix(state, forward, left):
    """Return the position rows of an antenna fix, moved to R by a lever arm that rotates with the heading."""
    c, s = cos(state[PSI]), sin(state[PSI])
    east, north = c * forward - s * left, s * forward + c * left
    return of_fix(state, 0, FIX._replace(x=FIX.x - east, y=FIX.y - north, lever_east=east, lever_north=north))


ROWS = {
    "gyro": lambda x: motion(x, gyro=0.2),
    "wheel": lambda x: motion(x, wheel=1.1, pitch=0.1, cruise=float(x[V])),
    "steer": lambda x: motion(x, steer=0.3),
    "standing": lambda x: motion(x, standing=True),
    "position": lambda x: of_fix(x, 0),
    "position below a tilted antenna": lambda x: of_tilted_fix(x, 0.3, -0.4),
}


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("name", ROWS)
def test_measurement_jacobian_rows_equal_finite_differences(state, name):
    """An innovation is the measured minus the expected value, so that its derivative is the negative Jacobian."""
    innovations = derivative(lambda x: ROWS[name](x)[0], state)
    if name == "steer":
        innovations[:, V] = 0.0  # the row assumes a known speed
    assert np.allclose(ROWS[name](state)[1], -innovations, rtol=0, atol=1e-8)


@pytest.mark.parametrize("state", STATES)
def test_velocity_rows_of_the_jacobian_match_finite_differences(state):
    side, chi = SIDE, course(state, SIDE)

    def velocity(x):
        """Return the antenna's velocity along and across the course of `state`."""
        turned, v = course(x, side) - chi, x[V]
        aside = x[AHEAD] * v * side.bend
        return np.array([v * cos(turned) - aside * sin(turned), v * sin(turned) + aside * cos(turned)])

    innovations, dense = of_fix(state, 2)
    assert np.allclose(dense, derivative(velocity, state), rtol=0, atol=1e-8)
    measured = [FIX.vx * cos(chi) + FIX.vy * sin(chi), FIX.vy * cos(chi) - FIX.vx * sin(chi)]
    assert innovations == pytest.approx(np.array(measured) - velocity(state))


def test_heading_row_of_the_jacobian_matches_finite_differences():
    state, fix = np.append(STATES[5], (0.03, 0.02)), FIX._replace(heading=1.5, heading_variance=0.004**2)
    rows = [
        fix_rows(state + change, np.eye(N + 2), fix, NOISE, SIDE) for change in (np.zeros(N + 2), *1e-6 * np.eye(N + 2))
    ]
    slopes = [(row.innovation[4] - rows[0].innovation[4]) / 1e-6 for row in rows[1:]]
    assert rows[0].innovation[4] == pytest.approx(1.5 - state[PSI] - 0.02)
    assert np.allclose(rows[0].jacobian[4], np.negative(slopes), rtol=0, atol=1e-8)
    turned = fix_rows(state, np.eye(N + 2), fix._replace(heading=1.5 + 2 * np.pi), NOISE, SIDE)
    assert turned.innovation[4] == pytest.approx(rows[0].innovation[4])


def test_predicted_position_after_a_full_circle_equals_its_start():
    """The midpoint rule without slip returns R to within 1 mm after 100 ticks on a circle of 5 m."""
    omega = 2 * np.pi / (100 * DT)
    mean = np.zeros(N)
    mean[V], mean[OMEGA] = 5.0 * omega, omega
    for _ in range(100):
        mean = propagate_mean(mean, SideLoad(), DT, 1.0)
    assert np.abs(mean[[X, Y]]).max() < 1e-3
    assert mean[PSI] == pytest.approx(2 * np.pi)


@pytest.mark.parametrize("first", [0, 2])
def test_squared_innovation_combines_both_components(first):
    root = np.random.default_rng(1).standard_normal((N, N))
    P = root @ root.T
    rows = fix_rows(STATES[5], P, FIX._replace(course_variance=0.01), NOISE, SIDE)
    H, y = rows.jacobian[first : first + 2], rows.innovation[first : first + 2]
    innovation = H @ P @ H.T + np.diag(rows.variance[first : first + 2])
    found = (rows.position_nis, rows.velocity_nis)[first // 2]
    assert found == pytest.approx(y @ np.linalg.solve(innovation, y), rel=1e-9)


def test_process_noise_equals_the_random_walk_variances():
    levels, n = LEVELS._replace(sideslip_walk=0.003), N + 2
    decay, Q = process_noise(levels, DT, NOISE.correlation_time, n)
    walked = DT * np.array(LEVELS.walks) ** 2
    walked[2] += DT**2 / 4 * walked[4]
    assert np.diag(Q)[[X, Y, PSI, V, OMEGA, B_G, B_S, K, C, S, AHEAD]] == pytest.approx(walked)
    assert Q[PSI, OMEGA] == Q[OMEGA, PSI] == pytest.approx(DT / 2 * walked[4])
    assert np.count_nonzero(Q - np.diag(np.diag(Q))) == 2
    assert Q[BETA, BETA] == pytest.approx(DT * 0.003**2)
    assert decay == pytest.approx(np.exp(-DT / NOISE.correlation_time))
    assert decay**2 + Q[G_E, G_E] == decay**2 + Q[G_N, G_N] == pytest.approx(1.0)


def test_steady_state_gain_solves_the_riccati_equation():
    walk, sigma, p = 0.1, 0.02, 1.0
    for _ in range(200):
        p += walk**2 * DT
        gain = p / (p + sigma**2)
        p *= 1 - gain
    assert steady_gain(walk, sigma, DT) == pytest.approx(gain, rel=1e-9)


def test_filter_on_a_straight_with_known_yaw_is_linear():
    """Course, biases and scale are known. The reference is a textbook filter of x, v, y and correlated errors."""
    levels = LEVELS._replace(walks=(0.01, 0.01, 0.0, 0.1, *[0.0] * 7))
    filter_ = filter_of(levels)
    mean, sigmas = np.zeros(N), np.zeros(N)
    sigmas[[X, Y, V, G_E, G_N]] = 0.05, 0.05, 0.5, 1.0, 1.0
    core = Core(mean, np.diag(sigmas**2), search=FOUND)
    keep = [X, V, Y, G_E, G_N]
    decay, Q = process_noise(levels, DT, NOISE.correlation_time)
    m, P, Q = np.zeros(5), np.diag(sigmas[keep] ** 2), Q[np.ix_(keep, keep)]
    F = np.diag([1.0, 1.0, 1.0, decay, decay])
    F[0, 1] = DT
    s = NOISE.correlated
    H = np.array([[0, 1, 0, 0, 0], [1, 0, 0, s, 0], [0, 0, 1, 0, s], [0, 1, 0, 0, 0]], dtype=float)
    R = np.diag([levels.wheel_sigma**2, NOISE.white**2, NOISE.white**2, levels.velocity_sigma**2])
    rng = np.random.default_rng(4)
    for k in range(400):
        z = np.array([1.2, 1.2 * DT * (k + 1), 0.0, 1.2]) + 0.02 * rng.standard_normal(4)
        fix = NO_FIX if 200 < k < 240 else Fix(z[1], z[2], z[3], 0.0)
        inputs = Inputs(DT * (k + 1), 0.0, z[0], 0.0, 0.0, 0.0)
        core = step(filter_, core, inputs, fix, Quality.FIX, DT)
        rows = slice(0, 1) if fix is NO_FIX else slice(0, 4)
        m, P = F @ m, F @ P @ F.T + Q
        innovation = H[rows] @ P @ H[rows].T + R[rows, rows]
        gain = np.linalg.solve(innovation, H[rows] @ P).T
        m, P = m + gain @ (z[rows] - H[rows] @ m), P - gain @ H[rows] @ P
        assert np.allclose(core.mean[keep], m, rtol=0, atol=1e-9)
        assert np.allclose(core.covariance[np.ix_(keep, keep)], P, rtol=0, atol=1e-12)
    assert P[0, 0] < 1e-3


@pytest.mark.parametrize("w", [0.8, -0.5])
def test_initial_yaw_search_weights_velocities_by_wheel_speed(w):
    """The argument of the sum of w V exp(-i chi) is the yaw error in forward and reverse motion."""
    mean, yaw, off = np.zeros(N), 0.4, 0.9
    mean[PSI] = yaw
    core, found = Core(mean, np.diag(np.full(N, 1e-4))), []
    filter_ = filter_of(LEVELS)
    for k in (1, 2):
        fix = Fix(0.0, 0.0, 1.1 * w * cos(yaw + off), 1.1 * w * sin(yaw + off))
        core = step(filter_, core, Inputs(k * DT, 0.0, w, 0.0, 0.0, 0.0), fix, Quality.FIX, DT)
        found.append(core.search)
    assert [search.weight for search in found] == pytest.approx([w * w, 2 * w * w])
    assert [np.hypot(search.along, search.across) for search in found] == pytest.approx(
        [1.1 * w * w, 2.2 * w * w], rel=1e-3
    )
    assert [np.arctan2(search.across, search.along) for search in found] == pytest.approx([off, off], abs=1e-3)


def test_estimation_errors_match_the_reported_covariance():
    """For independent runs of the model, normalised squared errors and innovations are chi-square distributed."""
    runs, ticks, nees, nis = 60, 100, 0.0, 0.0
    sigmas = np.array([0.05, 0.05, 0.03, 0.05, 0.01, 0.005, 0.01, 1.0, 1.0, 0.02, 0.003, 0.05, 0.005, 0.01])
    decay, Q = process_noise(LEVELS, DT, NOISE.correlation_time)
    Q[D, D] = 1.2 * DT * LEVELS.turn_offset_walk**2
    start = np.array([1.0, 2.0, 0.3, 1.2, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.012, 0.0, 0.017, 0.02])
    root = np.linalg.cholesky(Q)
    for seed in range(runs):
        rng, filter_ = np.random.default_rng(seed), filter_of(LEVELS)
        truth = start + sigmas * rng.standard_normal(N)
        core = Core(start, np.diag(sigmas**2), search=FOUND, smooth=Smooth(cruise=1.2, bend=0.2 / 1.2))
        for k in range(ticks):
            bend = SideLoad(bend=core.smooth.bend)
            truth = propagate_mean(truth, bend, DT, decay) + root @ rng.standard_normal(N)
            core = step(filter_, core, *_measured(truth, rng, DT * (k + 1), bend), Quality.FIX, DT)
            nis += core.nis
        error = core.mean - truth
        nees += error @ np.linalg.solve(core.covariance, error)
    low, high = chi2.ppf([1e-3, 1 - 1e-3], N * runs)
    assert low < nees < high
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 2 * runs * ticks)
    assert low < nis < high


def test_sideslip_offset_in_turns_is_a_random_walk_over_distance():
    """The random walk is zero at standstill and 4 mm times the root of the distance in metres, in both directions."""
    filter_, grown = filter_of(LEVELS), []
    for v in (0.0, 0.9, -2.7):
        mean = np.zeros(N)
        mean[V] = v
        core = Core(mean, np.diag(np.full(N, 1e-9)), search=FOUND)
        after = step(filter_, core, Inputs(DT, np.nan, np.nan, np.nan, 0.0, 0.0), NO_FIX, Quality.FIX, DT)
        grown.append(after.covariance[D, D] - 1e-9)
    assert grown == pytest.approx([0.0, 0.004**2 * 0.9 * DT, 0.004**2 * 2.7 * DT], abs=1e-15)


def test_only_a_changing_sideslip_adds_course_uncertainty():
    """Along a contour line, the sideslip is steady within a minute and no longer increases the lateral uncertainty."""
    filter_, side, v = filter_of(LEVELS), 0.25, 1.7
    mean = np.zeros(N)
    mean[[V, C]] = v, 0.013
    core = Core(mean, np.diag(np.full(N, 1e-9)), search=FOUND)
    crab = -(course(mean, SideLoad(9.81 * sin(side))) - mean[PSI])
    inputs = Inputs(DT, np.nan, np.nan, np.nan, side, 0.0)
    began, settled = (
        step(filter_, core._replace(smooth=Smooth(cruise=v, steady=s)), inputs, NO_FIX, Quality.FIX, DT)
        for s in (0.0, crab)
    )
    widened = began.covariance[Y, Y] - settled.covariance[Y, Y]
    assert widened == pytest.approx(DT * 5.0 * (0.15 * crab * v * cos(crab)) ** 2, rel=1e-6)
    assert settled.smooth.steady == pytest.approx(crab)
    assert began.smooth.steady == pytest.approx(crab * (1.0 - np.exp(-DT / 20.0)))


@pytest.mark.parametrize(("v", "bend"), [(2.5, 0.08), (2.5, -0.08), (-2.0, 0.1)])
def test_antenna_offset_includes_the_roll_angle_in_a_bend(v, bend):
    """At a height of 3 m, the antenna moves to the right in a left bend, forward and in reverse."""
    h, per_force, yaw = 3.0, radians(0.3), 0.7
    filter_ = filter_of(LEVELS._replace(roll=per_force), h)
    mean = np.zeros(N)
    mean[[PSI, V]] = yaw, v
    core = Core(mean, np.diag(np.full(N, 1e-6)), search=FOUND, smooth=Smooth(cruise=v, bend=bend))
    lever = step(filter_, core, Inputs(DT, np.nan, np.nan, np.nan, 0.0, 0.0), NO_FIX, Quality.FIX, DT).lever
    outward = h * sin(per_force * v * v * bend)
    assert lever.offset == pytest.approx((outward * sin(yaw), -outward * cos(yaw)), abs=1e-6)


def _measured(truth, rng, t, bend=SideLoad()):
    """Return inputs and fix of a true state in a bend, simulated with the filter's model."""
    w = rng.standard_normal(7)
    v, omega = truth[V], truth[OMEGA]
    chi, aside = course(truth, bend), truth[AHEAD] * v * bend.bend
    apparent = omega + LEVELS.steer_sigma * w[0]  # the steering row has a yaw-rate error
    steer = np.arctan(apparent * LEVELS.wheelbase / v) + truth[B_S]
    inputs = Inputs(
        t,
        omega + truth[B_G] + LEVELS.gyro_sigma * w[1],
        (1 + truth[K]) * v + LEVELS.wheel_sigma * w[2],
        steer,
        0.0,
        0.0,
    )
    fix = Fix(
        truth[X] + NOISE.correlated * truth[G_E] + truth[AHEAD] * cos(truth[PSI]) + NOISE.white * w[3],
        truth[Y] + NOISE.correlated * truth[G_N] + truth[AHEAD] * sin(truth[PSI]) + NOISE.white * w[4],
        v * cos(chi) - aside * sin(chi) + LEVELS.velocity_sigma * w[5],
        v * sin(chi) + aside * cos(chi) + LEVELS.velocity_sigma * w[6],
    )
    return inputs, fix


def test_steering_potentiometer_offset_is_estimated():
    filter_, bias = filter_of(LEVELS), radians(2.0)
    sigmas = np.array([0.05, 0.05, 0.03, 0.05, 0.01, 0.005, 0.03, 1.0, 1.0, 0.02, 0.003, 0.02, 0.005, 0.01])
    truth = np.array([0.0, 0.0, 0.3, 1.2, 0.2, 0.0, bias, 0.0, 0.0, 0.0, 0.012, 0.0, 0.017, 0.0])
    core = Core(
        np.array([0.0, 0.0, 0.3, 1.2, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.012, 0.0, 0.017, 0.0]),
        np.diag(sigmas**2),
        search=FOUND,
    )
    rng = np.random.default_rng(2)
    for k in range(600):
        truth = propagate_mean(truth, SideLoad(), DT, 1.0)
        core = step(filter_, core, *_measured(truth, rng, DT * (k + 1)), Quality.FIX, DT)
    assert core.mean[B_S] == pytest.approx(bias, abs=radians(0.3))


@pytest.mark.parametrize("pitch", [-0.25, -0.05, 0.0, 0.1, 0.3])
@pytest.mark.parametrize("bend", [0.0, 0.1, -0.15])
def test_braking_force_and_load_of_the_rear_axle_balance_the_tractor(pitch, bend):
    """Moments about the front contact give the load of the rear axle; front and rear side forces balance the yaw."""
    mass, wheelbase, arm, height, v = 750.0, 1.4, 0.53, 0.55, 1.2
    weight, side = mass * 9.81, mass * v * v * bend
    level, load = (weight * (cos(p) * (wheelbase - arm) - sin(p) * height) / wheelbase for p in (0.0, pitch))
    steered = (side * arm / wheelbase) * (wheelbase * bend)
    force = (weight * sin(pitch) - steered) * level / load / weight
    expected = 9.81 * force * (1.0 + 1.1 * (force**2 + (side / weight) ** 2))
    levels = LEVELS._replace(cg_arm=arm, load_transfer=height / (wheelbase - arm))
    assert braking(pitch, v, SideLoad(0.0, bend), levels) == pytest.approx(expected, rel=1e-3, abs=1e-9)
