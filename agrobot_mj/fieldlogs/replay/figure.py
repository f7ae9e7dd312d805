"""The figure of a replay: both ways, both yaw rates, and what is left of yaw rate and position."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from agrobot_mj.core.palette import BLUE, DARK_GREY, VERMILION
from agrobot_mj.fieldlogs.recording import FieldRecording
from agrobot_mj.fieldlogs.replay.driving import Driven
from agrobot_mj.fieldlogs.replay.residuals import Replayed, position_errors
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save


def write_figure(pieces: Sequence[Replayed], file: Path) -> Path:
    """Draw the four panels."""
    with rc_context(STYLE):
        figure = Figure(figsize=(2 * PANEL_WIDTH_IN, 5.0), layout="constrained")
        (way, rate), (place, rest) = figure.subplots(2, 2)
        for recording, driven in pieces:
            _way(way, recording, driven)
            _rates(rate, rest, recording, driven)
            _place(place, recording, driven)
        _titles(way, rate, rest, place)
        for axes in (way, rate, place):
            _legend(axes)
        return save(figure, file)


def _way(axes: Any, recording: FieldRecording, driven: Driven) -> None:
    if recording.position is not None:
        axes.plot(*recording.position.value.T, ".", color=DARK_GREY, markersize=1.5, label="recorded")
    axes.plot(*driven.point.T, color=BLUE, label="plant")


def _rates(rate: Any, rest: Any, recording: FieldRecording, driven: Driven) -> None:
    rate.plot(driven.t, np.degrees(driven.yaw_rate), color=BLUE, label="plant", zorder=3)
    if recording.yaw_rate is not None:
        t, value = recording.yaw_rate.between(driven.t[0], driven.t[-1])
        rate.plot(t, np.degrees(value), color=DARK_GREY, label=f"recorded ({recording.yaw_rate_source})")
        rest.plot(t, np.degrees(np.interp(t, driven.t, driven.yaw_rate) - value), color=VERMILION)


def _place(axes: Any, recording: FieldRecording, driven: Driven) -> None:
    t, off, window = position_errors(recording, driven)
    if len(t):
        axes.plot(t, off[:, 0], color=DARK_GREY, label="ahead")
        axes.plot(t, off[:, 1], color=BLUE, label="left")
        axes.plot(t, window, color=VERMILION, label="windows of 10 s")


def _titles(way: Any, rate: Any, rest: Any, place: Any) -> None:
    way.set_aspect("equal", adjustable="datalim")
    way.set(xlabel="East [m]", ylabel="North [m]", title="Way of the recorded point")
    rate.set(xlabel="Time [s]", ylabel="Yaw rate [deg/s]", title="Yaw rate")
    rest.set(xlabel="Time [s]", ylabel="Plant less recording [deg/s]", title="Residual of the yaw rate")
    place.set(xlabel="Time [s]", ylabel="Plant less recording [m]", title="Residual of the position")


def _legend(axes: Any) -> None:
    """One entry for each name, however many pieces there are."""
    found = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    if found:
        axes.legend(found.values(), found.keys())
