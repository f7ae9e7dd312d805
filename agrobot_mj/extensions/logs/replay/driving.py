"""Replay on a plant: the speed and either the wheel angle or the valve voltage follow a recording.

In a replay of the wheel angle (`by="steer"`), an ideal valve replaces the valve of the scenario and follows the
recorded angle every 10 ms, without lag, dead band or limit. A replay of the voltage uses the valve of the scenario. A
pedal without lag imposes the speed. An integral controller corrects the speed over ground for wheel slip. A simulated
lead-in before the recording brings the tractor to the initial speed and angle.
"""

from math import cos, sin
from typing import Literal, NamedTuple

import numpy as np

from agrobot_mj.core.geometry import from_heading, to_heading, wrap
from agrobot_mj.core.signals import NEUTRAL_V, Array, Drive, Reference, Truth
from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.machine.hydraulics import LITRE_PER_MINUTE
from agrobot_mj.plants import RunningPlant
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.loop import build_plant

By = Literal["steer", "valve"]  # Recorded input that steers the plant: wheel angle or valve voltage
TICK_S = 0.01  # Tick of the replay [s], short compared with the yaw dynamics of tractors (at least 0.1 s)
STEER_RATE = 4.0  # Steering rate of the ideal valve at full voltage [rad/s]
PEDAL_PER_V_S = 100.0  # Gain of the ideal pedal [1/(V s)], which imposes the recorded speed
FAST_S = 1e-3  # Time constant of the ideal valve and pump [s], half a physics step
CORRECTION = 0.5
"""Fraction of an angle error that the ideal valve corrects per tick [-]. At 1, the steering would oscillate."""
INTEGRAL_S = 2.0
"""Time constant of the integral speed controller [s], long compared with driveline oscillations (3 Hz)."""
DRIVE_DAMPING = 10.0
"""Factor by which a replay increases the nominal drive damping [-]. The product is half of the critical damping of the
driveline."""
LEAD_ACCELERATION = 1.0  # Acceleration of the tractor in the lead-in [m/s2]
LEAD_STEADY_S = 2.0  # Time at the initial speed and angle at the end of the lead-in [s]
MOVING = 0.05  # Minimum initial speed for which a lead-in is simulated [m/s]
HOMING_V_RAD = 60.0
"""Controller gain for steering to the initial wheel angle with the scenario's valve [V/rad]."""
Pose = tuple[float, float, float]  # Pose of the rear-axle centre R: east and north [m], heading [rad]


class Driven(NamedTuple):
    """Motion of the plant in a replay, as arrays of shape (n,)."""

    t: Array  # Time of the recording [s]
    steer: Array  # Wheel angle [rad]
    speed: Array  # Speed along the heading, or speed of the driven wheels if the recording contains it [m/s]
    yaw_rate: Array  # Yaw rate [rad/s]
    yaw: Array  # Heading, unwrapped [rad]
    point: Array  # East and north coordinates of the recorded point, shape (n, 2) [m]
    outcome: str  # `completed`, or the reason for which the plant stopped before the end


class _Inputs(NamedTuple):
    """Recorded inputs at every tick of the replay."""

    t: Array
    steer: Array
    voltage: Array
    speed: Array


def drive(scenario: Scenario, recording: FieldRecording, start: Pose, by: By = "steer") -> Driven:
    """Replay a recording on the plant of a scenario from the pose `start`. Raises `FieldLogError` if the recording
    lacks the input `by`."""
    if (recording.steer if by == "steer" else recording.voltage) is None:
        has = "valve" if by == "steer" else "steer"
        raise FieldLogError(f"{recording.name}: the map has no [{by}]; add it, or use --by {has}")
    return _Replayer(scenario, recording, by).run(start)


def point_of(truth: Truth, arm: tuple[float, float, float]) -> tuple[float, float]:
    """Return the east and north coordinates [m] of a body-fixed point with tilt. `arm` is its position ahead, to the
    left and above the rear-axle centre [m]."""
    ahead, left, up = arm
    forward = ahead * cos(truth.pitch) + up * sin(truth.pitch)
    side = left * cos(truth.roll) - up * sin(truth.roll)
    east, north = from_heading(truth.yaw, forward, side)
    return truth.rear_x + east, truth.rear_y + north


class _Replayer:
    """Replay of one segment on a plant with an ideal pedal and, if the recorded angle is replayed, an ideal valve."""

    def __init__(self, scenario: Scenario, recording: FieldRecording, by: By) -> None:
        self.recording, self.by, self.tractor = recording, by, scenario.tractor
        steps = max(1, round(TICK_S / scenario.step_s))
        self.tick = steps * scenario.step_s
        self.inputs = _inputs(recording, self.tick)
        self.full_speed = max(scenario.driveline.full_speed_m_s, 1.0 + 1.5 * float(np.abs(self.inputs.speed).max()))
        self.own_valve = scenario.steering.valve
        self.plant: RunningPlant = build_plant(scenario.changed(self._imposed_overrides(scenario)), steps)
        self.missing = 0.0

    def _imposed_overrides(self, scenario: Scenario) -> dict[str, float]:
        """Return the scenario overrides for an ideal pedal and, if the recorded angle is replayed, an ideal valve."""
        pedal = {
            "driveline.pedal_dead_band_v": 0.0,
            "driveline.pedal_rate_per_v_s": PEDAL_PER_V_S,
            "driveline.pedal_rate_limit_per_s": 10 * PEDAL_PER_V_S,
            "driveline.full_speed_m_s": self.full_speed,
            "driveline.pump_time_constant_s": FAST_S,
            "driveline.damping_n_m_s_rad": DRIVE_DAMPING * scenario.driveline.strength(scenario.tractor).damping,
        }
        if self.by == "valve":
            return pedal
        self.gain = STEER_RATE / NEUTRAL_V  # rad/s per volt
        flow = self.gain * scenario.steering.cylinder.displacement / LITRE_PER_MINUTE
        return pedal | {
            "steering.valve.delay_s": 0.0,
            "steering.valve.time_constant_s": FAST_S,
            "steering.valve.dead_band_v": 0.0,
            "steering.valve.gain_left_l_min_v": flow,
            "steering.valve.gain_right_l_min_v": flow,
            "steering.valve.pump_flow_l_min": 10 * NEUTRAL_V * flow,
        }

    def run(self, start: Pose) -> Driven:
        """Return the replayed motion. The lead-in is simulated twice, because its final pose is initially unknown."""
        begin = start
        if abs(self.inputs.speed[0]) > MOVING:
            end = self._lead_in(begin)
            turn = wrap(start[2] - end[2])
            ahead, left = to_heading(end[2], begin[0] - end[0], begin[1] - end[1])
            east, north = from_heading(start[2], ahead, left)
            begin = (start[0] + east, start[1] + north, wrap(begin[2] + turn))
            self._lead_in(begin)
        else:
            self._place(begin)
        return self._follow()

    def _place(self, pose: Pose) -> Truth:
        """Reset the plant to standstill, with the rear-axle centre R at a pose."""
        east, north = from_heading(pose[2], self.tractor.cg_to_rear_axle, 0.0)
        reference = Reference(pose[0] + east, pose[1] + north, 0.0, 0.0, pose[2], 0.0)
        self.missing, self.truth = 0.0, self.plant.reset(reference)
        return self.truth

    def _lead_in(self, pose: Pose) -> Pose:
        """Simulate from standstill to the initial speed and angle. Return the final pose of the rear-axle centre R."""
        self._place(pose)
        i = self.inputs
        u, angle = float(i.speed[0]), float(i.steer[0])
        ramp = abs(u) / LEAD_ACCELERATION
        for k in range(round((ramp + LEAD_STEADY_S) / self.tick)):
            share = min(1.0, (k + 1) * self.tick / ramp)
            self._advance(self._steer_voltage(angle, angle, None), share * u)
        return self.truth.rear_x, self.truth.rear_y, self.truth.yaw

    def _follow(self) -> Driven:
        i, rows, outcome = self.inputs, [self._row()], "completed"
        for k in range(len(i.t) - 1):
            volts = self._steer_voltage(float(i.steer[k]), float(i.steer[k + 1]), float(i.voltage[k]))
            self._advance(volts, float(i.speed[k + 1]))
            rows.append(self._row())
            if trouble := self.plant.trouble():
                outcome = trouble
                break
        columns = np.array(rows).T
        t = i.t[: len(rows)]
        return Driven(t, columns[0], columns[1], columns[2], np.unwrap(columns[3]), columns[4:].T, outcome)

    def _row(self) -> tuple[float, ...]:
        truth, recording = self.truth, self.recording
        speed = truth.wheel_speed if recording.wheel_speed else truth.speed
        return truth.steer, speed, truth.yaw_rate, truth.yaw, *point_of(truth, recording.arm)

    def _steer_voltage(self, now: float, following: float, recorded: float | None) -> float:
        """Return the steering valve voltage for this tick [V]. `now` and `following` are the recorded angles at the
        start and end of the tick [rad]. `recorded` is the recorded voltage [V], or None in the lead-in."""
        limit = self.tractor.steer_limit
        now, following = (min(max(angle, -limit), limit) for angle in (now, following))
        if self.by == "steer":
            rate = (following - now + CORRECTION * (now - self.truth.steer)) / self.tick
            return NEUTRAL_V + rate / self.gain
        if recorded is not None:
            return recorded
        error = now - self.truth.steer
        return (
            NEUTRAL_V
            + HOMING_V_RAD * error
            + (self.own_valve.dead_band_v if error > 0 else -self.own_valve.dead_band_v)
        )

    def _advance(self, steer_voltage: float, speed: float) -> None:
        """Advance the plant by one tick with a valve voltage [V]. `speed` is the setpoint at the end of the tick
        [m/s]."""
        if not self.recording.wheel_speed:
            self.missing += (speed - self.truth.speed) * self.tick / INTEGRAL_S
        pedal = (speed + self.missing) / self.full_speed
        rate = (min(max(pedal, -1.0), 1.0) - self.truth.pedal) / self.tick
        self.truth = self.plant.advance(Drive(steer_voltage, NEUTRAL_V + rate / PEDAL_PER_V_S))


def _inputs(recording: FieldRecording, tick: float) -> _Inputs:
    """Return the recorded inputs at every tick. A missing angle is 0, and a missing voltage is neutral."""
    n = int((recording.end - recording.start) / tick) + 1
    t = recording.start + tick * np.arange(n, dtype=np.float64)
    steer = recording.steer.at(t) if recording.steer else np.zeros(n)
    # A valve keeps its voltage until the next row: the last row at or before a time applies.
    volts = np.full(n, NEUTRAL_V)
    if v := recording.voltage:
        volts = v.value[np.clip(np.searchsorted(v.t, t + 1e-9, side="right") - 1, 0, len(v.t) - 1)]
    return _Inputs(t, steer, volts, np.interp(t, *recording.speed))
