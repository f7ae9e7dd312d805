"""Brake: holding without creep, vibration of light machines, and messages about tractors that do not settle."""

from math import asin, degrees

import numpy as np
import pytest
from similar import DEFAULT_KG, similar

from agrobot_mj.control.pid import STANDSTILL_S, STOPPED_S, BrakeState
from agrobot_mj.core.signals import NEUTRAL_V, TICK_S, Command, Drive, Reference
from agrobot_mj.machine import Machine
from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.plants import Clock, Mujoco, MujocoPlant
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.reference import families
from agrobot_mj.simulation.loop import Loop
from agrobot_mj.simulation.run import run
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.terrain import Slope
from agrobot_mj.tyres import Linear

START = Reference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
BRAKED, FREE = Drive(NEUTRAL_V, NEUTRAL_V, 1.0), Drive(NEUTRAL_V, NEUTRAL_V)
TORQUE = 640.0


def parked(grade_deg, dt=0.002, **driveline):
    """Return a plant parked uphill, and its initial state."""
    machine = Machine(driveline=Driveline(**{"connected": False, "brake_torque_n_m": TORQUE, **driveline}))
    ground = Slope(grade_deg=grade_deg, direction_deg=0.0).ground()
    plant = MujocoPlant(Mujoco(tyre=Linear()), machine, ground, Clock.of(dt))
    return plant, plant.reset(START)


@pytest.mark.parametrize("dt", [0.002, 0.005])
@pytest.mark.parametrize("share", [0.97, 1.02])
def test_brake_holds_the_tractor_up_to_its_torque_limit_without_creep(share, dt, capsys):
    tractor = TractorParameters()
    wheel = tractor.rear_wheel
    limit = degrees(asin(TORQUE / (tractor.mass_kg * GRAVITY * (wheel.radius - wheel.deflection / 3))))
    plant, start = parked(share * limit, dt)
    truths = [plant.advance(BRAKED) for _ in range(200)]
    if share > 1.0:
        assert "the wheels roll" in capsys.readouterr().err
        return
    assert abs(truths[-1].x - start.x) < 2e-4
    assert np.std([truth.speed for truth in truths[-40:]]) < 1e-6
    assert capsys.readouterr().err == ""


RIDING = {"machine": "riding", "physics": "fast", "terrain": {"kind": "slope", "grade_deg": 9.0, "direction_deg": 50.0}}


@pytest.mark.parametrize(("machine", "step_s"), [("riding", 0.0025), ("compact", 0.005), ("orchard", 0.005)])
def test_fast_physics_setting_uses_shorter_steps_for_light_wheels(machine, step_s):
    scenario = load_scenario("straight_line", {"machine": machine, "physics": "fast"})
    assert scenario.step_s == step_s
    assert scenario.changed({"plant.kind": "bicycle"}).step_s == 0.005


def test_light_tractor_stays_at_rest_with_the_fast_physics_setting(capsys):
    """With steps of 5 ms, the wheels would vibrate, and the tractor would move 1 mm in 5 s."""
    sim = Simulation(load_scenario("straight_line", {**RIDING, "duration_s": 10.0}))
    sim.reset()
    assert capsys.readouterr().err == ""
    places = []
    for _ in range(200):
        sim.step(steer=0.0, speed=0.0)
        places.append((sim.truth.x, sim.truth.y))
    assert np.ptp(places[100:], axis=0).max() < 1e-6


def test_tractor_on_a_slope_rolls_away_without_the_brake():
    plant, _ = parked(6.0)
    assert [plant.advance(FREE) for _ in range(40)][-1].speed < -1.0


def test_drive_torque_scales_with_mass_and_matches_the_documentation():
    compact = Driveline().strength(TractorParameters())
    assert compact == (3000.0, 14e3, pytest.approx(1118.25), 6e4, 400.0)
    heavy = similar(load_scenario("straight_line"), 8 * DEFAULT_KG).tractor
    assert Driveline().strength(heavy) == pytest.approx((48e3, 112e3, 16 * 1118.25, 96e4, 6400.0))
    assert Driveline(torque_limit_n_m=5.0).strength(heavy).torque == 5.0


@pytest.mark.parametrize("torque", [{}, {"driveline.torque_limit_n_m": 3000.0}], ids=["drive", "brake"])
def test_heavy_tractor_stays_parked_diagonally_on_a_slope(torque, capsys):
    slope = {"terrain.grade_deg": 9.0, "terrain.direction_deg": 40.0}
    truth = Loop(similar(load_scenario("uphill"), 8400.0).changed(slope | torque)).truth
    assert max(abs(truth.speed), abs(truth.lateral_speed), abs(truth.yaw_rate)) < 1e-3
    assert capsys.readouterr().err == ""


WET = {f"plant.tyre.{end}.{way}.mu": 0.25 for end in ("front", "rear") for way in ("lateral", "longitudinal")}
ROUGH = {"terrain.kind": "rough", "terrain.grade_deg": 0.0, "terrain.half_size_m": 60}
NO_BRAKE = {"driveline.torque_limit_n_m": 3000.0, "driveline.brake_torque_n_m": 0.0, "terrain.grade_deg": 9.0}


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (NO_BRAKE, ("the wheels roll", "driveline.torque_limit_n_m (3000)", "driveline.brake_torque_n_m (0)")),
        (WET | {"terrain.grade_deg": 18.0}, ("the tractor slides", "18.0 deg", "plant.tyre")),
        (
            {"terrain.grade_deg": 42.0, "terrain.direction_deg": 90.0},
            ("the tractor rolled over", "tractor.cg_height_m"),
        ),
        (ROUGH | {"plant.settle_limit_s": 0.2, "plant.settle_s": 0.2}, ("the tractor rocks", "plant.settle_limit_s")),
    ],
    ids=["rolls", "slides", "falls", "rocks"],
)
def test_message_for_a_tractor_that_does_not_settle_gives_the_reason(overrides, words, capsys):
    Loop(similar(load_scenario("uphill"), 3300.0).changed(overrides))
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert all(word in told for word in words), told


def braked_across(machine, grade_deg, direction_deg):
    slope = {"kind": "slope", "grade_deg": grade_deg, "direction_deg": direction_deg}
    return load_scenario("straight_line", {"machine": machine, "terrain": slope, "plant.settle_limit_s": 10.0})


def test_message_for_vibrating_braked_wheels_suggests_a_shorter_time_step(capsys):
    scenario = braked_across("riding", 10, 90)
    Loop(scenario.changed({"physics_dt_s": 0.005}))
    told = capsys.readouterr().err
    assert "the tractor creeps" in told
    assert "a shorter step" in told
    Loop(scenario.changed({"physics_dt_s": 0.0025}))
    assert capsys.readouterr().err == ""


def test_braked_wheels_of_a_heavier_machine_do_not_vibrate_at_5_ms(capsys):
    Loop(braked_across("robot", 18, 0).changed({"physics_dt_s": 0.005}))
    assert capsys.readouterr().err == ""


def test_light_machine_vibrating_between_steps_is_classified_as_at_rest(capsys):
    Loop(load_scenario("straight_line", {"machine": "riding", "physics": "fast"}))
    assert capsys.readouterr().err == ""


def test_brake_is_applied_after_a_delay_and_released_immediately():
    ticks = round(STANDSTILL_S / TICK_S)
    state = BrakeState().after(Command(0.0, 0.0), START, TICK_S)
    assert state.share == 1.0
    state = state.after(Command(0.0, 0.5), START, TICK_S)
    assert state.share == 0.0
    for _ in range(ticks - 1):
        state = state.after(Command(0.0, 1.0, pedal=0.0), START, TICK_S)
    assert state.share == 0.0
    state = state.after(Command(0.0, 1.0, pedal=0.0), START, TICK_S)
    assert state.share == 1.0
    assert not state.stands
    for _ in range(round(STOPPED_S / TICK_S) + 1):
        state = state.after(Command(0.0, 1.0, pedal=0.0), START, TICK_S)
    assert state.stands


def test_brake_is_applied_after_1_s_of_crawl_command_and_resting_reference():
    def share(speed, reference):
        state = BrakeState()
        for _ in range(round(STANDSTILL_S / TICK_S) + 1):
            state = state.after(Command(0.0, speed), reference, TICK_S)
        return state.share

    assert BrakeState().after(Command(0.0, 0.02), START, TICK_S).share == 0.0
    assert share(0.02, START) == 1.0
    assert share(-0.3, START) == 0.0
    assert share(0.02, START._replace(vx=0.02)) == 0.0


PAUSED = {
    "path": {
        "kind": "manoeuvre",
        "speed_m_s": 0.9,
        "cusp_pause_s": 60.0,
        "piece": [{"kind": "straight", "length_m": 5}, {"kind": "straight", "length_m": 4, "reverse": True}],
    },
    "duration_s": 48.0,
    "expected_outcome": "unfinished",
}
"""Scenario with standstill from 7 s until the end of the run."""


OBSERVING = pytest.param("eso", marks=pytest.mark.skipif("eso" not in families()["guidance"], reason="removed"))


@pytest.mark.parametrize("law", ["kinematic", "feedforward", "pure_pursuit", "stanley", "lqr", OBSERVING])
def test_every_law_holds_the_braked_tractor_without_creep(law):
    log = run(load_scenario("straight_line", PAUSED | {"guidance.kind": law}))
    t, brake = log.column("t"), log.column("brake")
    standing = t > 14.0
    assert brake[standing].min() == 1.0
    assert np.all(log.column("pedal")[standing] == 0.0)
    assert np.hypot(np.ptp(log.column("x")[standing]), np.ptp(log.column("y")[standing])) < 2e-4


@pytest.mark.parametrize("law", ["kinematic", "stanley", OBSERVING])
def test_steering_valve_stays_closed_while_the_brake_holds_the_tractor(law):
    slope = {"kind": "slope", "grade_deg": 8.5, "direction_deg": 25.0}
    restarted = {"path": PAUSED["path"] | {"cusp_pause_s": 32.0}, "duration_s": 43.0, "terrain": slope}
    log = run(load_scenario("straight_line", PAUSED | restarted | {"guidance.kind": law}))
    t, valve = log.column("t"), log.column("valve_voltage")
    first, last = t[log.column("brake") > 0.0][[0, -1]]
    assert last > 37.0
    held = (t > first + STOPPED_S) & (t <= last)
    assert np.all(valve[held] == NEUTRAL_V)
    assert np.ptp(valve[t > last + 0.2]) > 0.5
    still = t[held] > t[held][0] + 0.6  # time of the valve and of the oil
    assert np.ptp(log.column("steer")[held][still]) < 1e-5
    assert log.metrics["braked_drift_m"] < 2e-4


def test_external_command_steers_the_wheels_at_standstill():
    sim = Simulation("straight_line", {"duration_s": 9.0})
    sim.reset()
    while not sim.done:
        sim.step(steer=0.0 if sim.truth.t < 5.0 else 0.2, speed=0.0)
    assert sim.truth.steer == pytest.approx(0.2, abs=0.01)


def test_braked_bicycle_stays_at_standstill():
    log = run(load_scenario("straight_line", PAUSED | {"guidance.kind": "lqr", "plant": {"kind": "bicycle"}}))
    assert np.ptp(log.column("x")[log.column("t") > 16.0]) < 1e-6


def test_brake_holds_the_tractor_for_ten_minutes_without_drive_torque():
    plant, start = parked(10.0, brake_torque_n_m=1100.0)
    for _ in range(12000):
        truth = plant.advance(BRAKED)
    assert abs(truth.x - start.x) < 2e-4


def test_front_wheels_receive_the_configured_fraction_of_braking_force():
    tractor = TractorParameters()
    torques = Driveline(brake_torque_n_m=800.0, brake_front_share=0.25).brake_torques(tractor)
    radii = np.repeat([tractor.front_wheel_radius_m, tractor.rear_wheel_radius_m], 2)
    assert torques / radii * tractor.rear_wheel_radius_m == pytest.approx([100.0, 100.0, 300.0, 300.0])
    assert Driveline().brake_torques(tractor) == pytest.approx([0.0, 0.0, 559.125, 559.125])


def test_brake_holds_the_tractor_for_a_standstill_command_on_a_slope():
    sim = Simulation("uphill", {"driveline.torque_limit_n_m": 200.0, "duration_s": 20.0})
    sim.reset()
    for _ in range(100):
        sim.step(steer=0.0, speed=0.0)
    assert abs(sim.truth.speed) < 1e-3
    assert sim.log().column("brake").min() == 1.0


def test_supervisor_stop_ends_with_the_brake_applied():
    log = run(load_scenario("gnss_gone"))
    assert log.outcome == "stopped"
    assert log.column("brake")[-1] == 1.0
    assert log.column("brake")[: log.column("t").size // 2].max() == 0.0
