"""Path-following laws without tyre slip: convergence to the path, forward and in reverse."""

import sys
from math import cos, radians, sin

import numpy as np
import pytest
from drives import MACHINE, Bend, drive
from extras import NEEDS_CASADI
from hypothesis import given
from hypothesis import strategies as st

from agrobot_mj.control import Lqr, Nmpc, PurePursuit, Stanley, following
from agrobot_mj.control.base import Situation
from agrobot_mj.control.deviation import sideslip
from agrobot_mj.control.following import Following
from agrobot_mj.control.lqr import SPEEDS, _discrete_model, _gains, rolling, slip_of
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S, Command, Estimate
from agrobot_mj.paths import Circle
from agrobot_mj.paths.route import SampledRoute
from agrobot_mj.scenario.reference import families

LAWS = [
    pytest.param(kind(), id=kind().kind, marks=[NEEDS_CASADI] if kind is Nmpc else [])
    for kind in families()["guidance"].values()
    if issubclass(kind, Following)
]
INTEGRATING = [p for p in LAWS if isinstance(p.values[0], Lqr | Nmpc)]
SPEED = [1.2, -1.2, 0.5, -0.5, 3.0]


@pytest.mark.parametrize("speed", SPEED)
@pytest.mark.parametrize("law", LAWS)
def test_law_converges_from_offset_and_heading_error(law: Following, speed: float) -> None:
    d = drive(law, Bend(speed), 60.0, offset=0.6, heading=0.25)
    assert abs(d.offset[-100:]).max() < 0.02
    assert abs(d.offset).max() < 1.3


@pytest.mark.parametrize("curvature", [0.1, -0.2])
@pytest.mark.parametrize("speed", [1.2, -1.2])
@pytest.mark.parametrize("law", LAWS)
def test_law_has_no_steady_state_error_on_arc(law: Following, speed: float, curvature: float) -> None:
    d = drive(law, Bend(speed, curvature), 40.0)
    assert abs(d.offset[-100:]).max() < 0.01
    assert np.mean(d.steer[-100:]) == pytest.approx(
        np.arctan(
            MACHINE.wheelbase_m * np.tan(np.arcsin(MACHINE.cg_to_rear_axle * curvature)) / MACHINE.cg_to_rear_axle
        ),
        abs=radians(0.3),
    )


@pytest.mark.parametrize("law", LAWS)
def test_curvature_step_causes_cross_track_error_below_9_cm(law: Following) -> None:
    """The limit is the squared look-ahead of 2.7 m divided by eight radii: 9 cm."""
    d = drive(law, Bend(1.2, 0.1), 15.0)
    assert abs(d.offset).max() < 0.09


@pytest.mark.parametrize("speed", [1.2, -1.2])
@pytest.mark.parametrize("law", LAWS)
def test_mirrored_path_gives_mirrored_commands(law: Following, speed: float) -> None:
    left = drive(law, Mirrored(speed, 0.1, 1.0), 12.0, offset=0.3, heading=0.1)
    right = drive(law, Mirrored(speed, 0.1, -1.0), 12.0, offset=-0.3, heading=-0.1)
    steers = np.array([(a.steer, -b.steer) for a, b in zip(left.commands, right.commands, strict=True)])
    assert steers[:, 0] == pytest.approx(steers[:, 1], abs=1e-6)
    assert [c.speed for c in left.commands] == pytest.approx([c.speed for c in right.commands], abs=1e-9)


class Mirrored(Bend):
    """Bend with initial direction east, mirrored at the east axis if the sign is negative."""

    def __init__(self, speed: float, curvature: float, sign: float) -> None:
        super().__init__(speed, sign * curvature)

    def at(self, t: float):
        """Return the reference rotated to an initial direction of east."""
        r = super().at(t)
        c, s = cos(-0.3), sin(-0.3)
        turn = lambda x, y: (c * x - s * y, s * x + c * y)  # noqa: E731
        return r._replace(
            **dict(zip("xy", turn(r.x, r.y), strict=True)),
            **dict(zip(("vx", "vy"), turn(r.vx, r.vy), strict=True)),
            yaw=r.yaw - 0.3,
        )


@pytest.mark.parametrize("speed", [1.2, -1.2])
@pytest.mark.parametrize("law", INTEGRATING)
def test_law_with_integral_action_has_no_offset_with_steering_bias(law: Following, speed: float) -> None:
    d = drive(law, Bend(speed), 80.0, bias=radians(3.0))
    assert abs(d.offset[-100:]).max() < 0.01


def test_stanley_integral_removes_steering_bias_offset_without_overshoot() -> None:
    """The test is in forward direction. Acquiring a line from 3 m does not wind up the integral."""
    biased = drive(Stanley(), Bend(1.2), 80.0, bias=radians(3.0))
    assert abs(biased.offset[-100:]).max() < 0.01
    assert biased.reports[-1][-1] == pytest.approx(radians(3.0), abs=radians(0.3))
    free, plain = (drive(Stanley(integral_per_m=k), Bend(1.2), 40.0, offset=3.0) for k in (0.083, 0.0))
    assert abs(free.offset - plain.offset).max() < 0.1
    assert free.offset.min() > -0.03


@pytest.mark.parametrize("law", LAWS)
def test_estimated_steering_bias_causes_no_cross_track_offset(law: Following) -> None:
    d = drive(law, Bend(1.2), 60.0, bias=radians(3.0), known_bias=radians(3.0))
    assert abs(d.offset[-100:]).max() < 0.01


@pytest.mark.parametrize("law", LAWS)
def test_steering_command_respects_angle_and_acceleration_limits(law: Following) -> None:
    d = drive(law, Bend(3.0, 0.05), 20.0, offset=3.0, heading=-1.0)
    steer = np.array([c.steer for c in d.commands])
    assert abs(steer).max() <= MACHINE.steer_limit + 1e-12
    at_speed = steer[200:]
    allowed = np.arctan(MACHINE.wheelbase_m * law.lateral_acceleration_m_s2 / 2.5**2)
    assert abs(at_speed).max() <= allowed


@pytest.mark.parametrize("speed", [1.2, -1.2])
@pytest.mark.parametrize("law", LAWS)
def test_commanded_speed_has_the_sign_of_the_path_segment(law: Following, speed: float) -> None:
    """A tractor ahead of its reference waits instead of driving back."""
    path = Bend(speed)
    m, route = MACHINE, SampledRoute(path)
    r = path.at(10.0)
    lead = 5.0 * (1 if speed > 0 else -1)
    x, y = r.x + lead * cos(r.yaw), r.y + lead * sin(r.yaw)
    e = Estimate(
        x, y, r.yaw, 0.0, 0.0, x - m.cg_to_rear_axle * cos(r.yaw), y - m.cg_to_rear_axle * sin(r.yaw), np.eye(3)
    )
    law = law.model_copy(update={"saturation_m_s": 2.0})
    state, command = law.update(law.init(), Situation(10.0, e, r, route, m, 0.0), TICK_S)
    assert command.speed == 0.0
    assert state.s == pytest.approx(17.0, abs=0.2)  # the nearest point is found without a previous tick


@pytest.mark.parametrize("law", LAWS)
def test_lagging_tractor_exceeds_the_path_speed_only_near_the_path(
    law: Following, monkeypatch: pytest.MonkeyPatch
) -> None:
    """During the approach the tractor has the path speed, because at a higher speed the steering would be too slow."""
    monkeypatch.setattr(following, "MAX_HEADING_CHANGE", np.inf)  # wheels remain straight
    path, l_r = Bend(1.2), MACHINE.cg_to_rear_axle
    r, route = path.at(10.0), SampledRoute(path)

    def speed(offset: float, heading: float) -> float:
        x, y, yaw = r.x - 2.0 * cos(r.yaw) - offset * sin(r.yaw), r.y - 2.0 * sin(r.yaw) + offset, r.yaw + heading
        e = Estimate(x, y, yaw, 1.2, 0.0, x - l_r * cos(yaw), y - l_r * sin(yaw), np.eye(3))
        return law.update(law.init(), Situation(10.0, e, r, route, MACHINE, 0.0), TICK_S)[1].speed

    on_path = speed(0.0, 0.0)
    assert on_path == pytest.approx(1.2 + law.saturation_m_s * np.tanh(law.gain_per_m * 2.0), abs=0.01)
    assert speed(0.25, radians(10)) == pytest.approx(on_path, abs=0.01)
    assert speed(1.0, 0.0) == speed(0.0, radians(45)) == pytest.approx(1.2, abs=0.01)


@pytest.mark.parametrize("law", [p for p in LAWS if not isinstance(p.values[0], Nmpc)])  # Nmpc starts at the wheels
def test_speed_is_low_until_wheels_reach_the_steering_command(law: Following) -> None:
    """The tractor starts at rest, 10 deg off, with the wheels at the opposite stop."""
    path, l_r = Bend(3.0), MACHINE.cg_to_rear_axle
    r, route, yaw = path.at(1.0), SampledRoute(path), path.at(1.0).yaw + radians(10.0)
    e = Estimate(r.x, r.y, yaw, 0.0, 0.0, r.x - l_r * cos(yaw), r.y - l_r * sin(yaw), np.eye(3))

    def command(steer: float) -> Command:
        return law.update(law.init(), Situation(1.0, e, r, route, MACHINE, steer), TICK_S)[1]

    assert command(MACHINE.steer_limit).speed < 0.5
    assert command(command(0.0).steer).speed > 2.5


def test_expected_sideslip_follows_path_curvature_with_a_lag() -> None:
    route = SampledRoute(Bend(1.0, 0.1, 5.0))
    leg, l_r = (0.0, np.inf), 0.5
    assert sideslip(route, 4.9, 1.0, leg, l_r) == 0.0
    assert 0.4 < sideslip(route, 5.4, 1.0, leg, l_r) / np.arcsin(0.05) < 0.8
    assert sideslip(route, 9.0, 1.0, leg, l_r) == pytest.approx(np.arcsin(0.05))
    assert 0.2 < sideslip(route, 4.6, -1.0, leg, l_r) / np.arcsin(0.05) < 0.7
    assert sideslip(route, 5.1, -1.0, leg, l_r) == pytest.approx(np.arcsin(0.05))


def test_pure_pursuit_on_circle_steers_for_the_rear_axle_radius() -> None:
    path = Circle(radius_m=8.0, speed_m_s=1.0, ramp_s=0.0)
    r, m, route = path.at(20.0), MACHINE, SampledRoute(path)
    beta = np.arcsin(m.cg_to_rear_axle / 8.0)
    psi = r.yaw - beta
    e = Estimate(
        r.x,
        r.y,
        psi,
        cos(beta),
        1.0 / 8.0,
        r.x - m.cg_to_rear_axle * cos(psi),
        r.y - m.cg_to_rear_axle * sin(psi),
        np.eye(3),
    )
    law = PurePursuit()
    _, command = law.update(law.init(), Situation(20.0, e, r, route, m, 0.0), TICK_S)
    assert command.steer == pytest.approx(np.arctan(m.wheelbase_m / np.sqrt(8.0**2 - m.cg_to_rear_axle**2)), rel=1e-3)


def test_lqr_integral_is_frozen_at_the_steering_limit() -> None:
    """With a large offset and a small steering limit, the integral is below 30 % of its value without anti-windup."""
    law = Lqr(approach_deg=80.0, lateral_acceleration_m_s2=0.05, integral_limit_deg=45.0)
    d = drive(law, Bend(1.2), 20.0, offset=1.5)
    integral = np.array([report[-1] for report in d.reports])
    plain = law.gains(MACHINE, 1.2)[-1] * np.cumsum(d.offset) * TICK_S
    assert abs(integral).max() < 0.3 * abs(plain).max()


@pytest.mark.parametrize("side", [1, -1])
def test_lqr_integral_stays_within_its_configured_limit(side: int) -> None:
    """With a bias above the limit of the integral, an offset remains."""
    law = Lqr(integral_limit_deg=4.0)
    d = drive(law, Bend(1.2), 40.0, bias=side * radians(9.0))
    integral = np.array([report[-1] for report in d.reports])
    assert abs(integral).max() <= radians(4.0) * (1 + 1e-12)
    assert abs(integral[-1]) == pytest.approx(radians(4.0))
    free = drive(Lqr(), Bend(1.2), 40.0, bias=side * radians(9.0))
    assert abs(d.offset[-1]) > abs(free.offset[-1]) + 0.02


@pytest.mark.parametrize("law", LAWS)
def test_law_reverses_when_its_reference_reverses_at_a_cusp(law: Following) -> None:
    """The tractor drives forward before the cusp and stands at the cusp."""
    path = Bend(-1.2)
    r, m = path.at(5.0), MACHINE
    e = Estimate(
        r.x, r.y, r.yaw, 0.0, 0.0, r.x - m.cg_to_rear_axle * cos(r.yaw), r.y - m.cg_to_rear_axle * sin(r.yaw), np.eye(3)
    )
    state = law.init()._replace(direction=1.0)
    state, command = law.update(state, Situation(5.0, e, r, SampledRoute(path), m, 0.0), TICK_S)
    assert state.direction == -1.0
    assert command.speed == pytest.approx(-1.2, abs=0.05)


@pytest.mark.parametrize("speed", [0.5, 1.5, 3.0])
def test_lqr_steady_state_sideslip_equals_the_bicycle_model(speed: float) -> None:
    """The slip angles follow from the axle forces on the circle, divided by the cornering stiffnesses."""
    law, m, gamma = Lqr(), MACHINE, 0.1
    force = m.mass_kg * speed * gamma
    rear = force * m.cg_to_front_axle / m.wheelbase_m / law.rear_cornering_stiffness_n_rad
    front = force * m.cg_to_rear_axle / m.wheelbase_m / law.front_cornering_stiffness_n_rad
    lateral = m.cg_to_rear_axle * gamma - speed * rear  # lateral velocity of the CG, positive left
    steer = m.wheelbase_m * gamma / speed + front - rear
    assert rolling(slip_of(law, m), speed) == pytest.approx((lateral / gamma, steer * speed / gamma))


@pytest.mark.parametrize(
    ("key", "gain", "grows"),
    [("offset_m", 0, True), ("heading_deg", 1, True), ("integral_m_s", -1, True), ("steer_deg", 0, False)],
)
def test_larger_lqr_weights_change_gains_with_the_expected_sign(key: str, gain: int, grows: bool) -> None:
    """A key is the deviation with a cost of 1, so that half of the key multiplies the cost by four."""
    law = Lqr()
    costly = law.model_copy(update={key: 0.5 * getattr(law, key)})
    before, after = (abs(one.gains(MACHINE, 1.2)[gain]) for one in (law, costly))
    assert (after > 1.05 * before) if grows else (after < 0.95 * before)


@given(st.sampled_from(SPEEDS), st.booleans())
def test_lqr_closed_loop_is_stable_at_every_grid_speed(speed: float, reverse: bool) -> None:
    law, u = Lqr(), -speed if reverse else speed
    a, wheelbase = rolling(slip_of(law, MACHINE), u)
    A, B = _discrete_model(a, u / wheelbase, u, law.steering_lag_s, 2)
    assert abs(np.linalg.eigvals(A - B @ _gains(law, MACHINE, u)[0][None])).max() < 1.0


@pytest.mark.parametrize("speed", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("integral", [1.3, 2.6])
def test_lqr_integral_has_the_documented_time_constant(speed: float, integral: float) -> None:
    law = Lqr(integral_m_s=integral)
    a, wheelbase = rolling(slip_of(law, MACHINE), speed)
    A, B = _discrete_model(a, speed / wheelbase, speed, law.steering_lag_s, round(law.steering_delay_s / TICK_S))
    slowest = abs(np.linalg.eigvals(A - B @ _gains(law, MACHINE, speed)[0][None])).max()
    assert -TICK_S / np.log(slowest) == pytest.approx(integral / law.offset_m, rel=0.05)


def test_discrete_lqr_model_matches_integration_with_small_steps() -> None:
    """One tick of the model equals a fine integration of its equations."""
    law, u, n = Lqr(steering_delay_s=0.0), 0.4, 0
    a, wheelbase = rolling(slip_of(law, MACHINE), u)
    A, B = _discrete_model(a, u / wheelbase, u, law.steering_lag_s, n)
    x, command = np.array([0.1, -0.05, 0.1, 0.0]), 0.2
    expected = A @ x + B[:, 0] * command
    for _ in range(5000):
        e_y, e, delta, _ = x
        gamma = u * delta / wheelbase
        x = x + TICK_S / 5000 * np.array([u * e + a * gamma, gamma, (command - delta) / law.steering_lag_s, e_y])
    assert x == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_lqr_model_responds_after_the_valve_delay(n: int) -> None:
    a, wheelbase = rolling(slip_of(Lqr(), MACHINE), 1.0)
    (late, given_late), (prompt, given_now) = (_discrete_model(a, 1.0 / wheelbase, 1.0, 0.7, k) for k in (n, 0))
    x, y, commands = np.zeros(4 + n), np.zeros(4), [0.3, -0.1, 0.2, 0.05, -0.2, 0.1, 0.3, 0.0]
    x[:3] = y[:3] = 0.1, -0.05, 0.02
    for k, command in enumerate(commands):
        x = late @ x + given_late[:, 0] * command
        y = prompt @ y + given_now[:, 0] * (commands[k - n] if k >= n else 0.0)
        assert [*x[:3], x[-1]] == pytest.approx(y)


def test_nmpc_without_casadi_names_the_package_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from agrobot_mj.control import nmpc

    nmpc._solver.cache_clear()
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(ScenarioError, match=r'"nmpc" needs casadi; pip install "agrobot-mj\[nmpc\]"'):
        Nmpc().init()
    nmpc._solver.cache_clear()


@pytest.mark.parametrize("law", LAWS)
def test_law_reports_one_value_per_column(law: Following) -> None:
    assert len(law.columns) == len(law.report(law.init()))
    assert all(c.unit and c.description for c in law.columns)


@pytest.mark.parametrize("u", [0.62, 1.2, 2.9, -1.7])
def test_lqr_gains_are_interpolated_between_grid_speeds(u):
    """Interpolated gains are close to the gains computed at the speed itself."""
    law = Lqr()
    k = next(k for k, speed in enumerate(SPEEDS) if speed > abs(u))
    low, high = (_gains(law, MACHINE, SPEEDS[j] if u > 0 else -SPEEDS[j])[0] for j in (k - 1, k))
    weight = (abs(u) - SPEEDS[k - 1]) / (SPEEDS[k] - SPEEDS[k - 1])
    assert law.gains(MACHINE, u) == pytest.approx((1 - weight) * low + weight * high, rel=1e-12)
    assert law.gains(MACHINE, u) == pytest.approx(_gains(law, MACHINE, u)[0], rel=0.05, abs=0.01)


class Unsampled:
    """Route without samples, for evaluating a law step by step."""

    def __init__(self, route: SampledRoute) -> None:
        self.route = route

    def __getattr__(self, name: str):
        if name == "around":
            raise AttributeError(name)
        return getattr(self.route, name)


@pytest.mark.parametrize("speed", [1.2, -1.2])
@pytest.mark.parametrize("law", [Lqr(), Stanley()], ids=["lqr", "stanley"])
def test_compiled_tick_equals_the_sequence_of_its_steps(law: Following, speed: float) -> None:
    path, rng, states = Bend(speed), np.random.default_rng(4), [law.init(), law.init()]
    routes = [SampledRoute(path), Unsampled(SampledRoute(path))]
    for k in range(60):
        r, (dx, dy, turned, steer) = path.at(0.3 * k), 0.2 * rng.standard_normal(4)
        e = Estimate(r.x + dx, r.y + dy, r.yaw + turned, speed, 0.0, r.x, r.y, np.eye(3), steer_bias=0.1 * dx)
        found = [
            law.update(state, Situation(0.3 * k, e, r, route, MACHINE, steer), TICK_S)  # type: ignore[arg-type]
            for state, route in zip(states, routes, strict=True)
        ]
        states = [state for state, _ in found]
        assert found[0][1] == found[1][1]
        assert tuple(law.report(states[0])) == tuple(law.report(states[1]))


def test_steering_method_of_a_subclass_replaces_the_compiled_tick() -> None:
    class Constant(Lqr):
        def steering(self, memory, deviation, situation, dt):
            return memory, 0.123

    path = Bend(1.2)
    r = path.at(5.0)
    e = Estimate(r.x, r.y, r.yaw, 1.2, 0.0, r.x, r.y, np.eye(3))
    situation = Situation(5.0, e, r, SampledRoute(path), MACHINE, 0.0)
    assert Constant().update(Constant().init(), situation, TICK_S)[1].steer == 0.123
    assert Lqr().update(Lqr().init(), situation, TICK_S)[1].steer != 0.123
