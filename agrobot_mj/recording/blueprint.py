"""The layout of a recording: tabs as an engineer thinks, whole runs on the axes, a camera that follows."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from agrobot_mj.geometry import from_heading
from agrobot_mj.recording.signals import Plot
from agrobot_mj.recording.timeline import TIMELINE
from agrobot_mj.signals import Array

FOLLOWED = "world/bodies/chassis/boxes"
"""The camera follows an entity that has geometry."""
GROWING = (*(f"world/tracks/{track}" for track in ("true", "estimated", "gnss", "tyres")), "world/events")
"""What stays from its time on."""
SKY = 0xB9CDDBFF
SO_FAR = rrb.VisibleTimeRanges(
    timeline=TIMELINE, start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.cursor_relative()
)
LEGEND = rrb.PlotLegend(rrb.Corner2D.RightTop)
DRIVE = ("tracking/", "yaw_rate/loop", "control/command")
"""How the paths of the plots beside the scene begin."""
TABS = {
    "Control": ("yaw_rate/", "control/", "steering/", "speed/"),
    "Tyres": ("tyres/", "attitude"),
    "Estimator": ("estimator/",),
}
"""The same for each further tab, which is left out if nothing begins with its first."""
FOLLOW_FROM = (-3.4, -2.6, 2.3)
"""Where the following camera starts, seen from the tractor: forward, left, up [m]."""
LOOK_AT = (0.5, 0.0, 0.6)
"""What it looks at, from the same point and in the same directions, until it follows [m]."""
VIEWED = (2.2, 0.85)
"""Width and height of what the overview shows over its height above the ground. Measured in the viewer."""
TILT = 0.1
"""The overview looks down from a little south, since from straight above the viewer may put south up."""
LEGEND_ROOM = 1.3
"""Time axis over the run, so that the legends hide no line."""


def blueprint(plots: Sequence[Plot], places: Array, yaw: float, end_s: float) -> rrb.Blueprint:
    """The layout of `plots` until `end_s` [s].

    `places` (n, 3) [m] are those to see from above; the tractor starts at the first, towards `yaw` [rad].
    """
    axis = rrb.TimeAxis(view_range=rr.TimeRange(_seconds(0.0), _seconds(LEGEND_ROOM * end_s)))

    def views(starts: tuple[str, ...]) -> list[rrb.View]:
        return [_plot(plot, axis) for plot in plots if plot.path.startswith(starts)]

    states = rrb.StateTimelineView(origin="states", name="States", time_view=axis)
    scenes = rrb.Vertical(_follow(places[0], yaw), _overview(places), row_shares=[3, 2])
    beside = rrb.Vertical(*views(DRIVE), states, row_shares=[*(3.0 for _ in views(DRIVE)), 1.5])
    return rrb.Blueprint(
        rrb.Tabs(
            rrb.Horizontal(scenes, beside, column_shares=[3, 2], name="Drive"),
            *(rrb.Grid(*views(starts), grid_columns=3, name=tab) for tab, starts in TABS.items() if views(starts[:1])),
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
    east, north = from_heading(yaw, *FOLLOW_FROM[:2])
    eye = rrb.EyeControls3D(
        position=start + np.array([east, north, FOLLOW_FROM[2]]),
        look_target=start + LOOK_AT,
        tracking_entity=FOLLOWED,
    )
    return _view(eye, "Tractor")


def _overview(places: Array) -> rrb.Spatial3DView:
    low, high = places.min(axis=0), places.max(axis=0)
    above = high[2] + 8.0 + ((high - low)[:2] / VIEWED).max()
    middle = (low + high) / 2
    eye = rrb.EyeControls3D(position=(middle[0], middle[1] - TILT * above, above), look_target=middle)
    return _view(eye, "From above")


def _view(eye: rrb.EyeControls3D, name: str) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="world",
        name=name,
        eye_controls=eye,
        line_grid=False,
        background=rrb.Background(color=SKY),
        overrides=dict.fromkeys(GROWING, SO_FAR),
    )
