"""The layout of a recording: tabs as an engineer thinks, the whole run on each time axis, a camera that follows."""

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
WHOLE_RUN = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
SKY = 0xB9CDDBFF
SO_FAR = rrb.VisibleTimeRanges(
    timeline=TIMELINE, start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.cursor_relative()
)
DRIVE = ("tracking/error", "yaw_rate/loop", "control/command", "steering/angle", "speed/loop")
TABS = {
    "Control": (
        *("yaw_rate/loop", "yaw_rate/error", "control/command", "control/q", "steering/angle", "steering/valve"),
        *("speed/loop", "speed/pedal", "speed/valve"),
    ),
    "Tyres": (
        *("tyres/load", "tyres/slip_angle", "tyres/slip_ratio", "tyres/longitudinal_force", "tyres/lateral_force"),
        "attitude",
    ),
    "Estimator": ("estimator/east", "estimator/north", "estimator/yaw", "estimator/nees", "estimator/quality"),
}
"""Plots of each tab; a tab without any of its own is left out."""
FOLLOW_FROM = (-4.5, -3.5, 2.6)
"""Where the following camera starts, seen from the tractor: forward, left, up [m]."""
FIELD_OF_VIEW = 0.75
"""Least ratio of what the overview shows to its height above the ground. Estimate."""


def blueprint(scenario: Scenario, plots: Sequence[Plot]) -> rrb.Blueprint:
    """The layout for a run that shows `plots`."""
    paths = {plot.path for plot in plots}
    titles = {plot.path: plot.title for plot in plots}
    tabs = [
        rrb.Grid(*(_plot(path, titles[path]) for path in members if path in paths), name=name)
        for name, members in TABS.items()
        if any(path in paths and path not in DRIVE for path in members)
    ]
    scenes = rrb.Vertical(_follow(scenario), rrb.Horizontal(_overview(scenario), _states(), column_shares=[3, 2]), row_shares=[3, 2])
    drive = rrb.Horizontal(
        scenes,
        rrb.Vertical(*(_plot(path, titles[path]) for path in DRIVE if path in paths)),
        column_shares=[3, 2],
        name="Drive",
    )
    return rrb.Blueprint(
        rrb.Tabs(drive, *tabs, rrb.TextDocumentView(origin="info", name="Info")),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _plot(path: str, title: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"plots/{path}",
        name=title,
        axis_x=rrb.TimeAxis(view_range=WHOLE_RUN),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def _follow(scenario: Scenario) -> rrb.Spatial3DView:
    start = scenario.path.at(0.0)
    east, north = from_heading(start.yaw, *FOLLOW_FROM[:2])
    eye = rrb.EyeControls3D(
        position=(start.x + east, start.y + north, FOLLOW_FROM[2]),
        look_target=(start.x, start.y, 0.6),
        tracking_entity=FOLLOWED,
    )
    return _view(eye, "Tractor")


def _overview(scenario: Scenario) -> rrb.Spatial3DView:
    points = reference_points(scenario)
    low, high = points.min(axis=0), points.max(axis=0)
    (x, y), height = (low + high) / 2, 20.0 + (high - low).max() / FIELD_OF_VIEW
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


def _states() -> rrb.StateTimelineView:
    return rrb.StateTimelineView(origin="states", name="States")
