"""Payload, drawbar pull, side force and soft tyres on the MuJoCo tractor, compared with statics and tyre curves."""

from math import atan, degrees, radians

import mujoco
import numpy as np
import pytest

from agrobot_mj.core.signals import NEUTRAL_V, NOMINAL, Drive, PointMass, Reference
from agrobot_mj.core.spec import every
from agrobot_mj.extensions.bench.manoeuvres.theory import parts
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants import Clock, Mujoco, MujocoPlant
from agrobot_mj.plants.driver import Driver, track_course
from agrobot_mj.plants.mujoco.loads import AHEAD, GIVE
from agrobot_mj.plants.mujoco.payload import check_payloads
from agrobot_mj.terrain import Flat, Slope
from agrobot_mj.tyres import Linear, MagicFormula, Ruts, Soil, Tyre
from agrobot_mj.tyres.base import Footing, Slip
from agrobot_mj.tyres.laws import tyre_set
from agrobot_mj.tyres.patch import FORCE_X, LOAD, SLIP_RATIO

TRACTOR, REST = TractorParameters(), Drive(NEUTRAL_V, NEUTRAL_V)
L, L_R, T = TRACTOR.wheelbase_m, TRACTOR.cg_to_rear_axle, TRACTOR.track_m
ORIGIN = Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
FORCE_TYRES = [tyre for tyre in every(Tyre) if tyre().judged]
TANK = PointMass(150.0, -0.6, 0.2, 0.9)
SOFT_LEFT = NOMINAL._replace(tyre_stiffness=(1, 1, 0.4, 1), tyre_rolling=(1, 1, 1.6, 1))


class Under:
    """Plant under constant conditions, with the interface of a `Driver`."""

    def __init__(self, conditions=NOMINAL, tyre=None, terrain=Flat(), settled=None, dt=0.002, **driveline):
        self.plant = MujocoPlant(
            Mujoco(tyre=tyre or MagicFormula()),
            Machine(driveline=Driveline(**driveline)),
            terrain.ground(),
            Clock.of(dt),
        )
        self.conditions = conditions
        self.truth = self.plant.reset(ORIGIN, conditions if settled is None else settled)

    def advance(self, drive=REST):
        self.truth = self.plant.advance(drive, self.conditions)
        return self.truth

    def wait(self, seconds):
        for _ in range(round(seconds / 0.05)):
            self.advance()
        return self.truth

    def wheels(self):
        return self.plant.wheels()

    def report(self):
        return self.wheels().reshape(6, 4)

    def drive(self, speed, seconds, steer=0.0):
        self.driver = Driver(self, self.truth, speed)
        return self.driver.go(seconds, steer)

    def state(self):
        return self.plant.data.qpos.tobytes() + self.plant.data.qvel.tobytes() + self.wheels().tobytes()


# --- payload ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tyre", every(Tyre))
@pytest.mark.parametrize(
    "payload",
    [(TANK,), (PointMass(-60.0, 1.3, 0.0, 0.6),), (PointMass(80.0, 1.6, 0.0, 0.7), PointMass(80.0, -0.6, 0.0, 0.7))],
    ids=["tank", "ballast taken away", "both ends"],
)
def test_axle_loads_with_payload_agree_with_statics(tyre, payload):
    under = Under(NOMINAL._replace(payload=payload), tyre())
    under.wait(4.0)
    load = under.report()[LOAD]
    extra = sum(m.kg for m in payload)
    front = TRACTOR.front_axle_load + GRAVITY * sum(m.kg * m.ahead for m in payload) / L
    assert load.sum() == pytest.approx((TRACTOR.mass_kg + extra) * GRAVITY, rel=1e-3)
    # soil that remembers bears a wheel off its middle, by the millimetres that it rolled while it sank
    off = 0.006 * load.sum() / L if tyre is Ruts else 0.0
    assert load[:2].sum() == pytest.approx(front, abs=0.01 * front + off)
    rear = (TRACTOR.mass_kg + extra) * GRAVITY - front
    assert load[2:].sum() == pytest.approx(rear, abs=0.01 * rear + off)
    assert under.plant.model.body_subtreemass[1] == pytest.approx(TRACTOR.mass_kg + extra)


def test_payload_on_the_left_loads_left_wheels_and_rolls_the_tractor():
    under = Under(NOMINAL._replace(payload=(TANK,)))
    roll = under.wait(4.0).roll
    load = under.report()[LOAD]
    body = parts(TRACTOR)  # which rolls about the line from the rear patches to the pivot, without the front axle
    slope = body.pivot_z / L
    leaning = body.body_kg * (body.body_z - slope * body.body_x) + TANK.kg * (TANK.up - slope * TANK.ahead)
    moment = GRAVITY * (TANK.kg * TANK.left + leaning * np.sin(-roll))
    assert roll < 0
    assert (load[::2].sum() - load[1::2].sum()) * T / 2 == pytest.approx(moment, rel=0.01)


def test_cg_and_inertia_with_payload_equal_those_of_both_bodies_combined():
    """The reference is a model with a point mass on the chassis, compiled by MuJoCo."""
    under = Under()
    under.plant.chassis.carry((TANK,))
    found = mujoco.MjData(under.plant.model)
    mujoco.mj_forward(under.plant.model, found)
    bare = Under().plant.model
    data = mujoco.MjData(bare)
    mujoco.mj_forward(bare, data)
    d = np.array(TANK[1:]) - data.subtree_com[1]
    share = TANK.kg / (TRACTOR.mass_kg + TANK.kg)
    assert found.subtree_com[1] == pytest.approx(data.subtree_com[1] + share * d, abs=1e-12)
    # the mass matrix seen by the free joint's rotation about R
    arm = np.array(TANK[1:])
    M, M_bare = np.zeros((2, bare.nv, bare.nv))
    mujoco.mj_fullM(under.plant.model, found, M)
    mujoco.mj_fullM(bare, data, M_bare)
    added = TANK.kg * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    assert (M - M_bare)[3:6, 3:6] == pytest.approx(added, abs=1e-9)
    assert (M - M_bare)[:3, :3] == pytest.approx(TANK.kg * np.eye(3), abs=1e-9)


def test_removing_a_payload_changes_only_the_wheel_loads():
    under = Under(NOMINAL._replace(payload=(TANK,)))
    under.drive(1.2, 6.0)
    before = under.truth
    model = under.plant.model
    under.plant._apply_conditions(NOMINAL)
    arrays = dict.fromkeys(("steer_samples", "pedal_samples", "knuckle_samples", "implement"))
    assert under.plant.truth()._replace(**arrays) == before._replace(**arrays)
    fresh = Under().plant.model
    for name in ("body_mass", "body_ipos", "body_inertia", "body_iquat", "body_subtreemass", "dof_invweight0"):
        assert getattr(model, name).tobytes() == getattr(fresh, name).tobytes(), name
    under.conditions = NOMINAL
    trace = under.drive(1.2, 6.0)
    assert np.abs(np.diff(trace["speed"])).max() < 0.05
    assert under.report()[LOAD].sum() == pytest.approx(TRACTOR.mass_kg * GRAVITY, rel=0.01)
    assert under.plant.warnings() == 0


@pytest.mark.parametrize(
    ("payload", "words"),
    [((PointMass(-700.0, 0.5, 0.0, 0.6),), "remove less mass"), ((PointMass(-200.0, 1.6, 0.0, 0.6),), "inertia")],
    ids=["mass", "inertia"],
)
def test_removal_of_more_mass_than_available_is_rejected(payload, words):
    plant = Under().plant
    before = plant.model.body_mass.tobytes()
    with pytest.raises(ValueError, match=rf"^fault\[3\]\.mass_kg: .*{words}"):
        check_payloads(plant.chassis.bare, [(3, payload)])
    assert plant.model.body_mass.tobytes() == before


# --- drawbar ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pull", [1000.0, 2500.0])
@pytest.mark.parametrize("tyre", [Linear(rolling_resistance=0.05), MagicFormula(), Soil()], ids=lambda t: t.kind)
def test_drawbar_pull_increases_wheel_slip_drive_torque_and_rear_load(tyre, pull):
    under = Under(NOMINAL._replace(drawbar=pull), tyre)
    trace = under.drive(1.2, 15.0)
    report = trace.wheels[-40:].mean(axis=0)
    free = Under(NOMINAL, tyre).drive(1.2, 15.0).wheels[-40:].mean(axis=0)
    load, slip, forward = report[LOAD], report[SLIP_RATIO], report[FORCE_X]
    sunk = load[2] / TRACTOR.rear_wheel.stiffness
    assert trace.mean("speed", 2.0) == pytest.approx(1.2, rel=0.005)
    assert forward.sum() == pytest.approx(pull, rel=0.01)
    height = TRACTOR.hitch_height_m + 2 / 3 * sunk  # above the line of the tyres' effective radius
    assert (free - report)[LOAD, :2].sum() == pytest.approx(pull * height / L, rel=0.03)
    down = pull * abs(np.sin(trace.mean("pitch", 2.0)))  # the pull acts along the tractor, whose nose rises
    assert load.sum() == pytest.approx(TRACTOR.mass_kg * GRAVITY + down, rel=1e-3)

    tyres = tyre_set(tyre, TRACTOR)
    footing = Footing(1.0, tyres.cone_index)
    gross = tyres.rear.force(Slip(-slip[2], 0.0, load[2], sunk, 1.2, footing)).x
    if not isinstance(tyre, Soil):  # whose motion resistance is in the report, but not in the curve
        assert forward[2] == pytest.approx(gross, rel=0.02)
    r_e = TRACTOR.rear_wheel_radius_m - sunk / 3
    rolling = tyres.rolling_resistance * load[2:].sum()
    torque = under.plant.actuation()[2]
    assert torque == pytest.approx((2 * gross + rolling) * r_e, rel=0.02)
    if not isinstance(tyre, Soil):  # the work of the pull and of all rolling resistance
        assert torque == pytest.approx((pull + tyres.rolling_resistance * TRACTOR.mass_kg * GRAVITY) * r_e, rel=0.02)


def test_wheel_slip_grows_more_than_proportionally_with_drawbar_pull():
    slips = []
    for pull in (500.0, 1500.0, 3500.0):
        slips.append(Under(NOMINAL._replace(drawbar=pull)).drive(1.2, 10.0).wheels[-20:].mean(axis=0)[SLIP_RATIO, 2])
    assert slips == sorted(slips)
    assert (slips[2] - slips[1]) / 2000 > 1.2 * (slips[1] - slips[0]) / 1000


def test_implement_pull_also_opposes_the_motion_in_reverse():
    under = Under(NOMINAL._replace(drawbar=1500.0))
    trace = under.drive(-0.8, 12.0)
    assert trace.mean("speed", 2.0) == pytest.approx(-0.8, rel=0.01)
    assert trace.wheels[-20:].mean(axis=0)[FORCE_X].sum() == pytest.approx(-1500.0, rel=0.01)


@pytest.mark.parametrize("dt", [0.002, 0.005])
@pytest.mark.parametrize("pull", [1500.0, 1e5])
def test_parked_tractor_with_a_drawbar_pull_does_not_creep(pull, dt):
    """The tyres take up the load while the soil force relaxes, without vibration."""
    under = Under(NOMINAL._replace(drawbar=pull), terrain=Slope(grade_deg=10, direction_deg=30), dt=dt)
    early = under.wait(5.0)
    speeds = [under.advance().speed for _ in range(200)]
    late = under.truth
    assert np.hypot(late.x - early.x, late.y - early.y) < 2e-3
    assert np.abs(speeds[-100:]).max() < 2e-4
    assert under.plant.warnings() == 0


def test_implement_resistance_decays_at_standstill_without_motion():
    under = Under(NOMINAL._replace(drawbar=1500.0))
    under.drive(1.0, 8.0)
    full = abs(under.plant.loads[AHEAD])
    for _ in range(60):
        pedal = under.truth.pedal
        under.advance(Drive(NEUTRAL_V, NEUTRAL_V - 10 * pedal - 0.31 * np.sign(pedal)))
    stopped = under.truth
    speeds = [under.advance().speed for _ in range(600)]
    assert full == pytest.approx(GIVE, rel=0.01)
    assert abs(under.plant.loads[AHEAD]) < 0.3 * GIVE
    assert np.abs(speeds[200:]).max() < 0.01
    assert abs(under.truth.x - stopped.x) < 0.05


def test_drawbar_pull_above_the_grip_stops_the_tractor_and_wheels_spin():
    under = Under(NOMINAL._replace(drawbar=8000.0), settled=NOMINAL)
    trace = under.drive(1.2, 18.0)  # the last tyres slide after 10 s
    late = trace["x"][-100:]
    assert np.ptp(late) < 0.1
    assert under.report()[SLIP_RATIO, 2] > 0.9
    assert abs(trace.mean("speed", 3.0)) < 0.02
    assert under.plant.warnings() == 0


@pytest.mark.parametrize("side", [1, -1])
def test_hitch_force_in_a_turn_opposes_the_velocity_of_the_hitch(side):
    """The hitch moves outside the turning circle, so its pull has a yaw moment against the turn."""
    free, held = (Under(NOMINAL._replace(drawbar=pull)).drive(1.2, 12.0, side * 0.3) for pull in (0.0, 2000.0))
    assert 0 < side * held.mean("yaw_rate", 2.0) < 0.99 * side * free.mean("yaw_rate", 2.0)


# --- side force ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1, -1])
def test_crab_angle_under_a_side_force_follows_from_cornering_stiffness(side):
    """The rear axle carries F l_f / L; with heading and steering the weighted mean slip is F / (C_f + C_r)."""
    tyre, wind = Linear(), 600.0
    under = Under(NOMINAL._replace(side_force=side * wind), tyre)
    trace = under.drive(1.2, 30.0, track_course())
    C_f, C_r = 2 * tyre.front_cornering_stiffness_n_rad, 2 * tyre.rear_cornering_stiffness_n_rad
    heading, steer = trace.mean("yaw", 3.0), trace.mean("steer", 3.0)
    assert heading == pytest.approx(-side * atan(wind * (L - L_R) / L / C_r), rel=0.03)
    weighted = (C_f * (heading + steer) + C_r * heading) / (C_f + C_r)
    assert weighted == pytest.approx(-side * wind / (C_f + C_r), rel=0.03)
    forces = trace.wheels[-20:].mean(axis=0)
    assert forces[4].sum() == pytest.approx(-side * wind, rel=0.02)
    assert side * trace.mean("roll", 1.0) < 0
    leaning = TRACTOR.mass_kg * GRAVITY * abs(trace.mean("roll", 1.0))
    moment = (wind + leaning) * TRACTOR.cg_height_m
    lifted = side * (forces[LOAD, ::2].sum() - forces[LOAD, 1::2].sum()) * T / 2
    assert lifted == pytest.approx(moment, rel=0.03)


def test_parked_tractor_rolls_under_a_side_force_but_does_not_move():
    under = Under(NOMINAL._replace(side_force=800.0))
    early = under.wait(5.0)
    late = under.wait(10.0)
    assert late.roll < -radians(0.2)  # the left side down
    assert np.hypot(late.x - early.x, late.y - early.y) < 1e-3


# --- soft tyres ---------------------------------------------------------------------------------------------------


def test_roll_angle_on_a_soft_rear_tyre_follows_from_its_stiffness():
    under = Under(SOFT_LEFT)
    roll = under.wait(4.0).roll
    load = under.report()[LOAD]
    k = TRACTOR.rear_wheel.stiffness
    sunk = load[2] / (0.4 * k) - load[3] / k
    assert roll == pytest.approx(-sunk / T, rel=0.02)
    assert degrees(roll) < -0.7
    assert load.sum() == pytest.approx(TRACTOR.mass_kg * GRAVITY, rel=1e-3)


@pytest.mark.parametrize("left", [True, False])
def test_soft_tyre_pulls_the_tractor_towards_the_soft_side(left):
    conditions = SOFT_LEFT if left else NOMINAL._replace(tyre_stiffness=(1, 1, 1, 0.4), tyre_rolling=(1, 1, 1, 1.6))
    sound, soft = (Under(c).drive(1.2, 12.0)["yaw"][-1] for c in (NOMINAL, conditions))
    assert abs(sound) < radians(0.01)
    assert (soft if left else -soft) > radians(0.5)


def test_soft_tyre_has_less_stiffness_and_more_rolling_resistance():
    both = NOMINAL._replace(tyre_stiffness=(1, 1, 0.4, 0.4), tyre_rolling=(1, 1, 1.6, 1.6))
    sound, soft = Under(tyre=MagicFormula()), Under(both, tyre=MagicFormula())
    push = []
    for under in (sound, soft):
        under.drive(1.2, 18.0)
        push.append(np.mean([under.driver.go(0.05) and under.plant.actuation()[2] for _ in range(40)]))
    resists = 0.05 * TRACTOR.mass_kg * GRAVITY, 0.05 * (TRACTOR.mass_kg * GRAVITY + 0.6 * TRACTOR.rear_axle_load)
    sunk = [TRACTOR.rear_axle_load / (2 * share * TRACTOR.rear_wheel.stiffness) for share in (1.0, 0.4)]
    rolling = [F * (TRACTOR.rear_wheel_radius_m - d / 3) for F, d in zip(resists, sunk, strict=True)]
    assert push[1] - push[0] == pytest.approx(rolling[1] - rolling[0], rel=0.06)
    windy = [Under(c._replace(side_force=500.0)) for c in (NOMINAL, both)]
    wind = [under.drive(1.2, 25.0, track_course()).mean("yaw", 3.0) for under in windy]
    assert wind[1] / wind[0] == pytest.approx(1 / 0.4, rel=0.1)


# --- all of them --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tyre", every(Tyre))
def test_zero_disturbances_leave_the_run_bit_identical(tyre):
    """Cases include disturbances that were removed by a reset."""
    nothing = NOMINAL._replace(payload=(), drawbar=0.0, side_force=-0.0, tyre_stiffness=(1.0,) * 4, gnss_latency_s=0.1)
    plain, other = Under(NOMINAL, tyre()), Under(nothing, tyre())
    for under in (plain, other):
        for k in range(40):
            under.advance(Drive(NEUTRAL_V + 2 * np.sin(k), 8.0))
    assert plain.state() == other.state()
    rough = NOMINAL._replace(payload=(TANK,), drawbar=900.0, side_force=300.0, grip=0.5)
    other.conditions = rough
    other.wait(1.0)
    other.conditions = NOMINAL
    other.plant.reset(ORIGIN)
    other.truth = None
    for k in range(40):
        other.advance(Drive(NEUTRAL_V + 2 * np.sin(k), 8.0))
    assert plain.state() == other.state()


@pytest.mark.parametrize("tyre", FORCE_TYRES)
def test_halved_time_step_changes_results_little_under_all_disturbances(tyre):
    rough = SOFT_LEFT._replace(payload=(TANK,), drawbar=900.0, side_force=300.0, grip=0.8)
    coarse, fine = (Under(rough, tyre(), dt=dt).drive(1.2, 6.0, 0.1) for dt in (0.002, 0.001))
    for name, room in (("x", 0.02), ("y", 0.02), ("speed", 0.02), ("yaw", 0.01), ("roll", 0.01)):
        assert np.abs(coarse[name] - fine[name]).max() < room, name
