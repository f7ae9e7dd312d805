"""The riding tractor's twin, and runs that were held out, predicted once by models that were fitted to two others.

The twin is the machine of that name with the motor, the receivers and the sensor of its logs. The motor stands in the
place of the steering valve: 12 V is full drive to the left, 6 V none; dead band and rate come from the runs of the
calibration. Every piece of a run is driven by the recorded steering angle and speed; the yaw rates of all its pieces
count together, and so do its windows of 10 s.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj import load_scenario
from agrobot_mj.core.signals import NEUTRAL_V, Array
from agrobot_mj.extensions.logs.calibrate import Calibration, calibrate
from agrobot_mj.extensions.logs.maps import HeadingColumn, LogMap, PositionColumns, SpeedColumn, SteerColumn, TimeColumn
from agrobot_mj.extensions.logs.pieces import pieces
from agrobot_mj.extensions.logs.recording import FieldRecording, read_recording
from agrobot_mj.extensions.logs.replay.driving import Driven, Pose
from agrobot_mj.extensions.logs.replay.residuals import Replayed, kinematic, start_pose
from agrobot_mj.extensions.logs.replay.result import replay_pieces
from agrobot_mj.machine.hydraulics import LITRE_PER_MINUTE
from agrobot_mj.scenario import Scenario
from riding_tractor.closed_loop import MOST
from riding_tractor.logs import CALIBRATION, FieldLog, Repository, Run, field_log

MACHINE = "riding"
ROW_S = 0.05
"""Time between rows of the board [s]."""
FREE = (215.0, 790.0)
"""Readings between which the wheels are off their stops [counts]."""
SETTLED = 2
"""Rows with the same direction of drive after which the rate is that of the drive."""
LAG_S = 0.03
"""Lag of the motor [s]. Estimate: its rate has settled within two rows."""
RECEIVERS: dict[str, Any] = {
    "sensors.gnss.sigma_m": 0.008,
    "sensors.gnss.latency_s": 0.2,
    "sensors.gnss.dual_antenna.enabled": True,
    "sensors.steering_pot.samples": 1,
    "sensors.steering_pot.savgol_window": 1,
    "sensors.steering_pot.savgol_polyorder": 0,
}
"""Receivers and sensor: the scatter of fixes at rest, less that of writing them; the age of a heading, 0.23 s by the
calibration; a board that reads its sensor once."""


class Motor(NamedTuple):
    """Steering motor."""

    dead_band: float  # drive at which it begins to turn [counts of 255]
    rate: float  # steering rate per drive beyond that [deg/s per count]

    def at(self, drive: float) -> float:
        """Steering rate at a drive [deg/s]."""
        return self.rate * max(drive - self.dead_band, 0.0)

    @property
    def valve(self) -> dict[str, Any]:
        """Keys of the valve that stands for it, beside a cylinder of the default size."""
        volts = NEUTRAL_V / MOST
        cylinder = load_scenario("straight_line").steering.cylinder
        flow = np.radians(self.rate / volts) * cylinder.displacement / LITRE_PER_MINUTE
        keys = {
            "delay_s": 0.0,
            "time_constant_s": LAG_S,
            "dead_band_v": self.dead_band * volts,
            "gain_left_l_min_v": float(flow),
            "gain_right_l_min_v": float(flow),
            "pump_flow_l_min": float(flow * NEUTRAL_V),
        }
        return {f"steering.valve.{key}": value for key, value in keys.items()}


def motor(repository: Repository, degrees_per_count: float) -> Motor:
    """The motor in the runs of the calibration."""
    steps = [_rates(field_log(repository, run)) for run in CALIBRATION]
    drive, rate = (np.concatenate(each) for each in zip(*steps, strict=True))
    slope, level = np.polyfit(drive, rate, 1)
    return Motor(float(-level / slope), float(slope * degrees_per_count))


def _rates(log: FieldLog) -> tuple[Array, Array]:
    """Drive and rate of the potentiometer along it [counts, counts/s], where the drive has kept its direction."""
    way = np.sign(log.pwm)
    kept = np.ones(len(way) - 1 - SETTLED, dtype=bool)
    for k in range(1, SETTLED + 1):
        kept &= way[SETTLED:-1] == way[SETTLED - k : -1 - k]
    kept &= (way[SETTLED:-1] != 0) & (log.pot[SETTLED:-1] > FREE[0]) & (log.pot[SETTLED:-1] < FREE[1])
    rate = way[SETTLED:-1] * np.diff(log.pot)[SETTLED:] / ROW_S
    return np.abs(log.pwm[SETTLED:-1])[kept], rate[kept]


def twin(found: Motor) -> Scenario:
    """The twin on a straight line."""
    return load_scenario("straight_line", {"machine": MACHINE, **found.valve, **RECEIVERS})


COLUMNS = LogMap(
    title="riding tractor, field logger",
    time=TimeColumn(column="t"),
    steer=SteerColumn(column="pot"),
    speed=SpeedColumn(column="speed"),
    heading=HeadingColumn(column="heading"),
    position=PositionColumns(latitude="latitude", longitude="longitude", quality="quality"),
)
"""Meaning of the columns before anything is calibrated."""
LEAST_S = 10.0
"""Shortest piece that is predicted, a window [s]."""
Model = float | str
"""What drives a piece: MuJoCo with a carcass of that stiffness, `BICYCLE`, or `NO_SLIP`."""
BICYCLE, NO_SLIP = "bicycle", "no slip"
CARCASS = (0.15, 0.45, 1.8)
"""Lateral over vertical stiffness of the carcass that are tried; the relaxation length is inversely as it [-]."""


def calibration(repository: Repository, machine: Scenario) -> Calibration:
    """Centre, scale and ages of the sensors from the runs of the calibration."""
    return calibrate([field_log(repository, run).table for run in CALIBRATION], COLUMNS, machine)


def recordings(repository: Repository, run: Run, log_map: LogMap, machine: Scenario) -> list[FieldRecording]:
    """Pieces of a run that can be driven."""
    whole = read_recording(field_log(repository, run).table, log_map, machine.tractor.antenna_height_m)
    return [piece for piece in pieces([whole]).kept if piece.end - piece.start >= LEAST_S]


Numbers = dict[str, Any]


def replayed(found: Sequence[FieldRecording], model: Scenario | None, wheelbase: float) -> list[Replayed]:
    """Pieces driven by a model, each from the pose at which its first metres fit best."""
    if model is None:
        return [(piece, _rolled(piece, start_pose(piece, wheelbase), wheelbase)) for piece in found]
    return list(replay_pieces(found, model).pieces)


def _rolled(recording: FieldRecording, pose: Pose, wheelbase: float) -> Driven:
    """Wheels that do not slip."""
    t, yaw, point = kinematic(recording, wheelbase)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turned = point @ np.array(((c, s), (-s, c))) + pose[:2]
    assert recording.steer is not None
    steer, u = recording.steer.at(t), np.interp(t, recording.speed.t, recording.speed.value)
    return Driven(t, steer, u, u * np.tan(steer) / wheelbase, yaw + pose[2], turned, "completed")


def explained(found: Numbers) -> float:
    """Share of the variance of the yaw rate [-]."""
    share: float = found["yaw_rate"]["explained"]
    return share
