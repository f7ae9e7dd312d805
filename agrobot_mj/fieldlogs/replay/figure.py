"""The figure of a replay: both ways, both yaw rates, and what is left of yaw rate and position."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLUE, DARK_GREY, VERMILION
from agrobot_mj.fieldlogs.recording import FieldRecording
from agrobot_mj.fieldlogs.replay.driving import Driven
from agrobot_mj.fieldlogs.replay.residuals import position_errors
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save


def write_figure(recording: FieldRecording, driven: Driven, file: Path) -> Path:
    """Draw the four panels."""
    with rc_context(STYLE):
        figure = Figure(figsize=(2 * PANEL_WIDTH_IN, 5.0), layout="constrained")
        (way, rate), (place, rest) = figure.subplots(2, 2)
        _way(way, recording, driven)
        _rates(rate, rest, recording, driven)
        _place(place, recording, driven)
        return save(figure, file)


def _way(axes: Any, recording: FieldRecording, driven: Driven) -> None:
    if recording.position is not None:
        axes.plot(*recording.position.value.T, ".", color=DARK_GREY, markersize=1.5, label="recorded")
    axes.plot(*driven.point.T, color=BLUE, label="plant")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="East [m]", ylabel="North [m]", title="Way of the recorded point")
    axes.legend()


def _rates(rate: Any, rest: Any, recording: FieldRecording, driven: Driven) -> None:
    rate.plot(driven.t, np.degrees(driven.yaw_rate), color=BLUE, label="plant", zorder=3)
    if recording.yaw_rate is not None:
        t, value = recording.yaw_rate.between(driven.t[0], driven.t[-1])
        rate.plot(t, np.degrees(value), color=DARK_GREY, label=f"recorded ({recording.yaw_rate_source})")
        rest.plot(t, np.degrees(np.interp(t, driven.t, driven.yaw_rate) - value), color=VERMILION)
    rate.set(xlabel="Time [s]", ylabel="Yaw rate [deg/s]", title="Yaw rate")
    rest.set(xlabel="Time [s]", ylabel="Plant less recording [deg/s]", title="Residual of the yaw rate")
    rate.legend()


def _place(axes: Any, recording: FieldRecording, driven: Driven) -> None:
    t, off, window = position_errors(recording, driven)
    if len(t):
        axes.plot(t, off[:, 0], color=DARK_GREY, label="ahead")
        axes.plot(t, off[:, 1], color=BLUE, label="left")
        axes.plot(t, window, color=VERMILION, label="windows of 10 s")
        axes.legend()
    axes.set(xlabel="Time [s]", ylabel="Plant less recording [m]", title="Residual of the position")
