"""Runs of the riding tractor that were held out, predicted once by models that were fitted to two others.

Every piece of a run is driven by the recorded steering angle and speed; the yaw rates of all its pieces count together,
and so do its windows of 10 s.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from agrobot_mj.fieldlogs.calibrate import Calibration, calibrate
from agrobot_mj.fieldlogs.maps import HeadingColumn, LogMap, PositionColumns, SpeedColumn, SteerColumn, TimeColumn
from agrobot_mj.fieldlogs.pieces import pieces
from agrobot_mj.fieldlogs.recording import FieldRecording, read_recording
from agrobot_mj.fieldlogs.replay.driving import Driven, Pose
from agrobot_mj.fieldlogs.replay.residuals import Replayed, kinematic, start_pose
from agrobot_mj.fieldlogs.replay.result import replay_pieces
from agrobot_mj.scenario import Scenario
from riding_tractor.logs import CALIBRATION, Repository, Run, field_log

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
