"""The layout of a recording: tabs as an engineer thinks, whole runs on the axes, a camera that follows."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from agrobot_mj.geometry import from_heading
from agrobot_mj.recording.scene import reference_points
from agrobot_mj.recording.signals import Plot
from agrobot_mj.recording.timeline import TIMELINE
from agrobot_mj.scenario import Scenario

FOLLOWED = "world/bodies/chassis/boxes"
"""The camera follows an entity that has geometry."""
SKY = 0xB9CDDBFF
SO_FAR = rrb.VisibleTimeRanges(
    timeline=TIMELINE, start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.cursor_relative()
)
LEGEND = rrb.PlotLegend(rrb.Corner2D.RightTop)
DRIVE = ("tracking/error", "yaw_rate/loop", "control/command")
TABS = {
    "Control": (
        *(
            "yaw_rate/loop",
            "yaw_rate/error",
            "control/command",
            "control/q",
            "steering/angle",
            "steering/valve",
        ),
        *("speed/loop", "speed/pedal", "speed/valve"),
    ),
    "Tyres": (
        *(
            "tyres/load",
            "tyres/slip_angle",
            "tyres/slip_ratio",
            "tyres/longitudinal_force",
            "tyres/lateral_force",
        ),
        "attitude",
    ),
    "Estimator": (
        "estimator/east",
        "estimator/north",
        "estimator/yaw",
        "estimator/speed",
        "estimator/nees",
        "estimator/quality",
    ),
}
"""Plots of each tab; a tab whose first plot does not exist is left out."""
FOLLOW_FROM = (-4.0, -3.2, 2.4)
"""Where the following camera starts, seen from the tractor: forward, left, up [m]."""
VIEWED = (2.2, 0.85)
"""Width and height of what the overview shows over its height above the ground. Measured in the viewer."""
LEGEND_ROOM = 1.3
"""Time axis over the run, so that the legends hide no line."""


def blueprint(plots: Sequence[Plot], places: Array, yaw: float, end_s: float) -> rrb.Blueprint:
    """The layout for `plots` of a run to `end_s` [s] over `places` (n, 2) [m], from the first of them at `yaw` [rad]."""
    axis = rrb.TimeAxis(view_range=rr.TimeRange(_seconds(0.0), _seconds(LEGEND_ROOM * end_s)))
    shown = {plot.path: plot for plot in plots}

    def views(paths: Sequence[str]) -> list[rrb.View]:
        return [_plot(shown[path], axis) for path in paths if path in shown]

    states = rrb.StateTimelineView(origin="states", name="States", time_view=axis)
    scenes = rrb.Vertical(_follow(places[0], yaw), _overview(places), row_shares=[3, 2])
    beside = rrb.Vertical(*views(DRIVE), states, row_shares=[*(3.0 for _ in views(DRIVE)), 1.5])
    return rrb.Blueprint(
        rrb.Tabs(
            rrb.Horizontal(scenes, beside, column_shares=[3, 2], name="Drive"),
            *(rrb.Grid(*views(paths), name=tab) for tab, paths in TABS.items() if paths[0] in shown),
            rrb.TextDocumentView(origin="info", name="Info"),
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _seconds(t: float) -> rr.TimeRangeBoundary:
    return rr.TimeRangeBoundary.absolute(seconds=t)


def _plot(plot: Plot, axis: rrb.TimeAxis) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=plot.entity, name=plot.title, axis_x=axis, plot_legend=LEGEND)


def _follow(start: Array, yaw: float) -> rrb.Spatial3DView:
    offset = from_heading(yaw, *FOLLOW_FROM[:2])
    eye = rrb.EyeControls3D(
        position=(*(start + offset), FOLLOW_FROM[2]), look_target=(*start, 0.6), tracking_entity=FOLLOWED
    )
    return _view(eye, "Tractor")


def _overview(places: Array) -> rrb.Spatial3DView:
    low, high = places.min(axis=0), places.max(axis=0)
    (x, y), height = (low + high) / 2, 8.0 + ((high - low) / VIEWED).max()
    eye = rrb.EyeControls3D(position=(x, y - 0.01 * height, height), look_target=(x, y, 0.0))
    return _view(eye, "From above")


def _view(eye: rrb.EyeControls3D, name: str) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="world",
        name=name,
        eye_controls=eye,
        line_grid=False,
        background=rrb.Background(color=SKY),
        overrides={f"world/tracks/{track}": SO_FAR for track in ("true", "estimated", "gnss")},
    )
