"""Simulation of the twin of a real riding tractor with an external guidance program.

`python examples/riding_tractor.py` takes one minute and prints the tables of the page real_machine.md: passes on rough
ground, and receiver failures.

The guidance reproduces the owner's program from logs and code [Jones2026]: pure pursuit of the first waypoint beyond
the look-ahead distance, with unfiltered position and heading. The steering board drives the motor by a proportional law
with dead band and minimum command, in counts of the steering potentiometer. Without RTK fix or valid heading the
tractor stops, and the wheels are set to the centre value of the firmware. Positions are rounded to 1e-5 minutes, as in
the receiver. Some constants are results of `agrobot-mj twin --only calibrate` on two logs.
"""

from collections.abc import Sequence
from math import atan, cos, degrees, isfinite, nan, radians, sin, tan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj import Simulation, load_scenario
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import NEUTRAL_V, Array, Measurement, Quality
from agrobot_mj.machine.hydraulics import LITRE_PER_MINUTE
from agrobot_mj.scenario import Scenario
from agrobot_mj.terrain.rough import ROUGHNESS, Rough

WHEELBASE_M, LOOKAHEAD_M, LARGEST = 1.27, 2.0, 0.623
"""Wheelbase [m], look-ahead distance of the straight missions [m], and maximum commanded steering angle [rad]."""
RIGHT, CENTRE, LEFT = 197.0, 447.0, 815.0
"""Potentiometer values in the firmware for maximum right, zero and maximum left steering angle [counts]."""
KP, DEAD_BAND, LEAST, MOST = 1.0, 10.0, 150.0, 255.0
"""Parameters of the steering board: gain [drive counts per potentiometer count], dead band [potentiometer counts],
minimum and maximum drive [counts of 255]."""
WAYPOINTS_M = 0.49
"""Distance between waypoints of the straight missions [m]."""
GOAL_M = 0.5
"""Distance to the last waypoint, along the heading, below which a mission ends [m]."""


class Board(NamedTuple):
    """Settings and control law of the steering board."""

    centre: float = CENTRE  # potentiometer value for wheels straight ahead [counts]
    left: float = (LEFT - CENTRE) / LARGEST  # counts per radian of steering to the left
    right: float = (CENTRE - RIGHT) / LARGEST  # counts per radian of steering to the right
    dead_band: float = DEAD_BAND

    def wanted(self, angle: float) -> float:
        """Return the potentiometer setpoint [counts] for a steering angle [rad], left positive."""
        angle = min(max(angle, -LARGEST), LARGEST)
        return self.centre + angle * (self.left if angle > 0 else self.right)

    def bias(self, straight: float) -> float:
        """Return the commanded angle [rad], right positive, at which the wheels are straight, for a true centre
        `straight` [counts]."""
        return (self.centre - straight) / (self.right if straight < self.centre else self.left)

    def drive(self, error: float) -> float:
        """Return the motor drive [counts of 255] for a steering error [counts], left positive."""
        if abs(error) <= self.dead_band:
            return 0.0
        size = min(max(KP * abs(error), LEAST), MOST)
        return size if error > 0 else -size

    def voltage(self, error: float) -> float:
        """Return the valve voltage that represents the motor drive [V]. 12 V is the maximum drive to the left."""
        return NEUTRAL_V * (1.0 + self.drive(error) / MOST)


def calibrated(centre: float, degrees_per_count: float) -> Board:
    """Return a board with the true centre [counts] and scale of its potentiometer."""
    scale = degrees(1.0) / degrees_per_count
    return Board(centre, scale, scale)


class Pursuit(NamedTuple):
    """State of the pure pursuit law between two ticks."""

    waypoints: Array  # east, north and look-ahead distance, shape (n, 3) [m]
    index: int = 0  # index of the target waypoint
    done: bool = False

    def after(self, x: float, y: float, yaw: float) -> "tuple[Pursuit, float]":
        """Return the new state and the steering angle [rad], left positive, for a position [m] and a heading [rad]."""
        places, reach = self.waypoints[self.index :, :2], self.waypoints[self.index :, 2]
        beyond = np.flatnonzero(np.hypot(*(places - (x, y)).T) > reach)
        last = len(self.waypoints) - 1
        k = self.index + int(beyond[0]) if beyond.size else last
        dx, dy, lookahead = (self.waypoints[k] - (x, y, 0.0)).tolist()
        ahead, left = dx * cos(yaw) + dy * sin(yaw), dy * cos(yaw) - dx * sin(yaw)
        done = not beyond.size and ahead <= GOAL_M
        return self._replace(index=k, done=done), atan(2.0 * WHEELBASE_M * left / lookahead**2)


def steady_offset(bias: float, heading: float, lookahead: float = LOOKAHEAD_M) -> float:
    """Return the steady-state lateral offset of pure pursuit from the line, left positive [m].

    `bias` is the commanded angle to the right at which the wheels are straight, and `heading` the heading error to the
    left [rad]. In steady state, the lateral distance of the waypoint to the right is y_t = L_d^2 tan(bias) / (2 L),
    which includes L_d sin(heading) from the heading error.
    """
    return lookahead**2 * tan(bias) / (2.0 * WHEELBASE_M) - lookahead * sin(heading)


MIDDLE = (0.4, 0.8)
"""Evaluated part of a pass, as fractions of its waypoints [-], as in the owner's evaluation."""
CELL = (1e-5 / 60 * 111.32e3 * cos(radians(40.4856)), 1e-5 / 60 * 111.04e3)
"""Resolution of logged positions, east and north [m]: 1e-5 minutes at the latitude of the field."""
POSITION_TICKS, HEADING_TICKS = 2, 4
"""Periods of the position and heading measurements [ticks]: 10 Hz and 5 Hz, as in the logs."""
LENGTH_M = 26.0
"""Length of a simulated pass [m]. The longest recorded pass has 25.5 m."""
ROUGH_HALF_M, ROUGH_NODE_M = 32.0, 0.05
"""Half side length and node spacing of the rough ground [m]."""


class Pass(NamedTuple):
    """Lateral offsets from the line in the evaluated part of a pass, left positive."""

    offset: Array  # offsets [m]
    wanted: Array  # commanded steering angle, left positive [deg]
    speed: float  # mean speed [m/s]

    @property
    def mean(self) -> float:
        """Mean absolute lateral offset [cm]."""
        return 100 * float(np.abs(self.offset).mean())

    @property
    def p95(self) -> float:
        """95th percentile of the absolute lateral offset [cm]."""
        return 100 * float(np.percentile(np.abs(self.offset), 95))

    @property
    def left(self) -> float:
        """Mean lateral offset, left positive [cm]."""
        return 100 * float(self.offset.mean())


def rough_ground(folder: Path, seed: int) -> Path:
    """Return the file of a square height map with roughness class C. The file is created if it does not exist."""
    file = folder / f"rough-{seed}.npy"
    if not file.exists():
        axis = np.arange(-ROUGH_HALF_M, ROUGH_HALF_M + ROUGH_NODE_M / 2, ROUGH_NODE_M)
        folder.mkdir(parents=True, exist_ok=True)
        np.save(file, Rough(iso_class="C", seed=seed).bare(axis, axis))
    return file


def terrain(folder: Path, seed: int, roughness: float) -> dict[str, Any]:
    """Return the terrain table for a roughness G_d(n_0) [m3], or level ground for 0."""
    if not roughness:
        return {"kind": "flat"}
    file, scale = rough_ground(folder, seed), (roughness / ROUGHNESS["C"]) ** 0.5
    return {"kind": "heightmap", "file": str(file), "spacing_m": ROUGH_NODE_M, "scale": scale}


class Loop(NamedTuple):
    """Closed loop of the twin and the guidance program, with its settings."""

    twin: Scenario
    centre: float  # true potentiometer value for wheels straight ahead [counts]
    degrees_per_count: float  # true scale of the potentiometer
    board: Board = Board()
    heading_error: float = 0.0  # constant error of the heading, left positive [deg]
    gate: bool = True  # whether the tractor stops without an RTK fix and a valid heading

    def run(
        self, speed: float, seed: int, ground: dict[str, Any], fault: Sequence[Any] = (), length: float = LENGTH_M
    ) -> "Driven":
        """Simulate a straight pass to the east at `speed` [m/s] on the terrain `ground`."""
        line = {"kind": "line", "length_m": length, "speed_m_s": speed, "start_x_m": -length / 2}
        x = np.arange(-length / 2, length / 2 + 1e-9, WAYPOINTS_M)
        waypoints = np.column_stack((x, np.zeros_like(x), np.full_like(x, LOOKAHEAD_M), np.full_like(x, speed)))
        changes = {"path": line, "terrain": ground, "seed": seed, "fault": list(fault)}
        return self.follow(changes, waypoints)

    def follow(self, changes: dict[str, Any], waypoints: Array) -> "Driven":
        """Simulate a mission along waypoints (n, 4): east [m], north [m], look-ahead distance [m] and speed [m/s]."""
        heading = {"sensors.gnss.dual_antenna.mounting_deg": self.heading_error}
        simulation = Simulation(self.twin.changed({**changes, **heading}))
        measured, pursuit = simulation.reset(), Pursuit(waypoints[:, :3])
        pose, rows, tick = (nan, nan, nan), [], 0
        while not simulation.done and not pursuit.done:
            pose, sound = _pose(pose, measured, tick)
            going, angle = isfinite(sum(pose)) and (sound or not self.gate), 0.0
            if going:
                pursuit, angle = pursuit.after(*pose)
            reading = self.centre + degrees(measured.steer) / self.degrees_per_count
            volts = self.board.voltage(self.board.wanted(angle) - reading)
            truth = simulation.truth
            rows.append((truth.t, *pose, truth.rear_x, truth.rear_y, truth.speed, degrees(angle), pursuit.index))
            speed = float(waypoints[pursuit.index, 3]) if going else 0.0
            measured = simulation.step(steer_voltage=volts, speed=speed)
            tick += 1
        return Driven(np.array(rows).T, waypoints)


class Driven(NamedTuple):
    """Log of a simulated pass, with its waypoints."""

    rows: Array
    """Log, shape (9, n): time, measured east, north and heading, true east and north of the rear axle, speed, commanded
    angle [deg] and waypoint index."""
    waypoints: Array

    @property
    def middle(self) -> Pass:
        """Evaluated part of a straight pass to the east, from measured positions."""
        index, total = self.rows[8], len(self.waypoints)
        inside = (index >= MIDDLE[0] * total) & (index <= MIDDLE[1] * total)
        return Pass(self.rows[2][inside], self.rows[7][inside], float(self.rows[6][inside].mean()))


def _pose(
    last: tuple[float, float, float], measured: Measurement, tick: int
) -> tuple[tuple[float, float, float], bool]:
    """Return the last measured pose (east and north [m], heading [rad]), and whether the fix is RTK and the heading is
    valid."""
    fix, (x, y, yaw) = measured.fix, last
    if fix is None:
        return last, False
    if tick % POSITION_TICKS == 0:
        x, y = (CELL[k] * round(value / CELL[k]) for k, value in enumerate((fix.x, fix.y)))
    if tick % HEADING_TICKS == 0 and fix.heading == fix.heading:
        yaw = fix.heading
    return (x, y, yaw), measured.quality == Quality.FIX and fix.heading == fix.heading


STRAIGHT, SCALE, HEADING_DEG = 432.794, 0.159, 1.289
"""Potentiometer value for wheels straight ahead [counts], steering angle per count [deg], and heading error, left
positive [deg]. Source: calibration with the runs 1W and 1E."""
MOTOR_FROM, MOTOR_RATE = 70.8, 0.61
"""Calibrated minimum drive that moves the motor [counts of 255], and steering rate per count of drive above this
minimum [deg/s]."""
SLOW, FAST, RECORDED_CM = 0.5, 0.85, 2.4
"""Speeds of the missions [m/s], and mean offset of the recorded slow passes [cm], to which the roughness is fitted."""
RECORDED = (
    ("recorded, 0.5 m/s", 4, "2.4 (2.0 to 3.0)", "5.5 (4.7 to 6.1)", "1.8 (1.0 to 2.2)"),
    ("recorded, 0.85 m/s", 2, "2.4 (2.4 to 2.5)", "4.6 (4.1 to 5.1)", "2.2 (2.1 to 2.4)"),
)
"""Table rows of recorded passes: number, and mean (range) of mean offset, p95 and offset to the left [cm]."""
CARCASS = 1.8
"""Lateral carcass stiffness divided by vertical stiffness [-]: the best of three values for the runs 1W and 1E."""
SEEDS = range(1, 5)
"""Seeds of the passes, each with different ground."""
RECEIVERS = {
    "sensors.gnss.sigma_m": 0.008,
    "sensors.gnss.latency_s": 0.2,
    "sensors.gnss.dual_antenna.enabled": True,
    "sensors.steering_pot.samples": 1,
    "sensors.steering_pot.savgol_window": 1,
    "sensors.steering_pot.savgol_polyorder": 0,
}
"""Scenario overrides of the sensors: noise of fixes at rest, receiver latency from the calibration, and unfiltered
steering sensor."""
LAG_S = 0.03
"""Time constant of the steering motor [s]. Assumed value: in the log the rate settles within two rows of 0.05 s."""


def twin() -> Scenario:
    """Return the scenario of the machine `riding` with the steering motor, receivers and sensors of the logs.

    A valve with a cylinder of default size represents the motor: 12 V is maximum drive to the left.
    """
    volts, cylinder = NEUTRAL_V / MOST, load_scenario("straight_line").steering.cylinder
    flow = radians(MOTOR_RATE / volts) * cylinder.displacement / LITRE_PER_MINUTE
    valve = {"delay_s": 0.0, "time_constant_s": LAG_S, "dead_band_v": MOTOR_FROM * volts}
    valve |= {"gain_left_l_min_v": flow, "gain_right_l_min_v": flow, "pump_flow_l_min": flow * NEUTRAL_V}
    keys = {f"steering.valve.{key}": value for key, value in valve.items()}
    return load_scenario(
        "straight_line", {"machine": "riding", "plant.tyre.carcass_lateral": CARCASS, **keys, **RECEIVERS}
    )


def passes(loop: Loop, speed: float, ground: Path, roughness: float) -> list[Pass]:
    """Simulate one pass per seed on ground of a given roughness [m3]. `ground` is the folder for height maps."""
    return [loop.run(speed, seed, terrain(ground, seed, roughness)).middle for seed in SEEDS]


def _cells(some: Sequence[Pass], *keys: str) -> tuple[str, ...]:
    """Return table cells with mean and range of the attributes `keys` over passes."""
    every = ([getattr(p, key) for p in some] for key in keys)
    return tuple(f"{np.mean(values):.1f} ({min(values):.1f} to {max(values):.1f})" for values in every)


def tables(ground: Path) -> dict[str, str]:
    """Return tables by name: passes by roughness and speed, effect of corrected errors, and receiver failures.

    Height maps are written to the folder `ground`.
    """
    keys = ("mean", "p95", "left")
    loop = Loop(twin(), STRAIGHT, SCALE, heading_error=HEADING_DEG)
    steps = np.geomspace(ROUGHNESS["C"] / 16, 16 * ROUGHNESS["C"], 5).tolist()
    by_step = {step: passes(loop, SLOW, ground, step) for step in steps}
    fitted = min(by_step, key=lambda step: abs(np.mean([p.mean for p in by_step[step]]) - RECORDED_CM))
    slow_line = ("twin, 0.5 m/s, roughness fitted", len(SEEDS), *_cells(by_step[fitted], *keys))
    fast_line = ("twin, 0.85 m/s, predicted", len(SEEDS), *_cells(passes(loop, FAST, ground, fitted), *keys))
    heads = ("mean [cm]", "p95 [cm]", "left [cm]")
    scan = [(f"{step * 1e6:.0f}", *_cells(found, *keys)) for step, found in by_step.items()]
    return {
        "closed loop": markdown_table(("passes", "number", *heads), [RECORDED[0], slow_line, RECORDED[1], fast_line]),
        "roughness": markdown_table(("roughness [10^-6 m3]", *heads), scan),
        "gain": gain(loop, ground, fitted),
        "gnss twin": failures(loop, terrain(ground, 1, fitted)),
    }


def gain(loop: Loop, ground: Path, roughness: float) -> str:
    """Return a table of passes in which the errors of steering and heading are corrected one after the other."""
    right = calibrated(STRAIGHT, SCALE)
    changes = {
        "unchanged": loop,
        "centre corrected": loop._replace(board=Board(STRAIGHT)),
        "centre and scale corrected": loop._replace(board=right),
        "also heading corrected": loop._replace(board=right, heading_error=0.0),
        "also a dead band of 5 counts": loop._replace(board=right._replace(dead_band=5.0), heading_error=0.0),
    }
    lines = []
    for name, each in changes.items():
        some = [_cells(passes(each, speed, ground, roughness), "left", "mean", "p95") for speed in (SLOW, FAST)]
        lines.append((name, *(cell for pair in zip(*some, strict=True) for cell in pair)))
    heads = [f"{what} at {speed:g} m/s [cm]" for what in ("left", "mean", "p95") for speed in (SLOW, FAST)]
    return markdown_table(("", *heads), lines)


BEGIN_S, LINE_M, AFTER_S, RESTING_M_S = 20.0, 56.0, 2.0, 0.05
"""Start of a failure [s], length of the path [m], evaluated time after the end of a failure [s], and speed below which
the tractor is at rest [m/s]."""
FAILURES: dict[str, dict[str, Any]] = {
    "position silent for 37 s, last fix RTK": {"kind": "gnss_frozen", "keep": "velocity", "end_s": BEGIN_S + 37},
    "position silent for 37 s, last fix of quality 2": {
        **{"kind": "gnss_frozen", "keep": "velocity", "quality": "dgps", "end_s": BEGIN_S + 37}
    },
    "heading silent afterwards, reported as valid": {"kind": "heading_stuck"},
    "quality 2 for 1.4 s": {"kind": "gnss_dgps", "end_s": BEGIN_S + 1.4},
    "quality 2 for 7.2 s": {"kind": "gnss_dgps", "end_s": BEGIN_S + 7.2},
    "no heading for 0.2 s": {"kind": "heading_loss", "end_s": BEGIN_S + 0.2},
    "no heading for 3.4 s": {"kind": "heading_loss", "end_s": BEGIN_S + 3.4},
}
"""Receiver failures by name, with median and maximum durations in the logs."""


def failures(loop: Loop, ground: dict[str, Any], seeds: Sequence[int] = range(1, 7)) -> str:
    """Return a table of receiver failures with stopping distance and maximum lateral deviation.

    The speed command is a lever position, as on the real machine: a speed controller would use the frozen speed.
    """
    lever = {"speed.outer.kp": 0.0, "speed.outer.ki": 0.0}
    lever["speed.feedforward_s_m"] = 1.0 / loop.twin.driveline.full_speed_m_s
    loop, lines = loop._replace(twin=loop.twin.changed(lever)), []
    for name, keys in FAILURES.items():
        ways, offs = list[float](), list[float]()
        for seed in seeds:
            rows = loop.run(SLOW, seed, ground, ({"start_s": BEGIN_S, **keys},), LINE_M).rows
            after = rows[:, (rows[0] >= BEGIN_S) & (rows[0] < keys.get("end_s", rows[0][-1]) + AFTER_S)]
            rests = np.flatnonzero(after[6] < RESTING_M_S)
            ways += [float(after[4][rests[0]] - after[4][0])] if rests.size else []
            offs.append(float(np.abs(after[5] - rows[5][rows[0] < BEGIN_S][-1]).max()))
        text = f"{np.mean(ways):.2f} ({max(ways):.2f})" if ways else "continues"
        lines.append((name, f"{len(ways)} of {len(seeds)}", text, f"{np.mean(offs):.2f} ({max(offs):.2f})"))
    return markdown_table(("failure", "stops", "stopping distance [m]", "off its line [m]"), lines)


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        for name, table in tables(Path(folder)).items():
            print(f"\n{name}\n\n{table}")
