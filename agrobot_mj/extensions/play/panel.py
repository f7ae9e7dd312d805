"""Control panel in the viewer, with keys, sliders and curves. The panel exchanges messages with the simulation.

The panel runs in a thread of MuJoCo Studio, the web viewer of MuJoCo.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import degrees
from typing import Any, NamedTuple

from mujoco.studio import messages, plugin
from mujoco.studio.dear_imgui import dear_imgui as imgui
from mujoco.studio.implot import implot

from agrobot_mj.extensions.play.adjustments import ADJUSTMENTS, STEEPEST_DEG, NextStart
from agrobot_mj.extensions.play.driver import FASTEST_M_S, REVERSE_M_S, Keys
from agrobot_mj.extensions.play.gamepad import Gamepad
from agrobot_mj.machine.tyre_size import LEAST_BAR, MOST_BAR

KEY = imgui.Key
HELD = {
    "left": (KEY.LeftArrow, KEY.A),
    "right": (KEY.RightArrow, KEY.D),
    "faster": (KEY.UpArrow, KEY.W),
    "slower": (KEY.DownArrow, KEY.S),
}
"""Keys of actions that continue while a key is pressed, by action."""
PRESSED = {
    "stop": KEY.Space,
    "law": KEY.L,
    "driver": KEY.H,
    "mark": KEY.M,
    "recall": KEY.R,
    "inject": KEY.F,
    "pause": KEY.P,
    "restart": KEY.Backspace,
}
"""Key of each action that is executed once per key press."""
HELP = (
    "arrows or WASD: steer, faster, slower\n"
    "Space stop   L law   H driver   P pause\n"
    "M save state   R restore   F fault\n"
    "Backspace: start again"
)
WIDTH, TALLEST, MARGIN = 300.0, 780.0, 10.0
"""Width and maximum height of the panel, and its distance from the page border [pixels]."""
CURVE_SHARE, CURVE_LEAST = 0.24, 145.0
"""Height of the curve plots divided by the page height [-], and minimum height of the plots [pixels]."""
LABEL = 125.0  # Width of the sliders in the panel [pixels]
SHOWN_S = 20.0  # Length of the time axis of the curves [s]
FLAG = imgui.WindowFlags
FIXED = sum(map(int, (FLAG.NoNav, FLAG.NoTitleBar, FLAG.NoMove, FLAG.NoResize)))
"""Flags for a fixed window without title bar, in which the keyboard does not move the focus."""
WARNING = imgui.Vec4(0.9, 0.35, 0.1, 1.0)


@dataclass(frozen=True)
class Press(messages.Event):  # type: ignore[misc, unused-ignore]
    """Message about a pressed key, a pressed button or a moved slider."""

    name: str
    value: float = 0.0
    text: str = ""


@dataclass(frozen=True)
class Restart(messages.Event):  # type: ignore[misc, unused-ignore]
    """Message that requests a new start of the drive with new settings."""

    settings: NextStart


@dataclass(frozen=True)
class HeldKeys(messages.Snapshot):  # type: ignore[misc, unused-ignore]
    """Message with the currently pressed driving keys."""

    keys: Keys


class CurvePoint(NamedTuple):
    """Point of the displayed curves."""

    t: float
    cross_track: float  # Cross-track error [m]
    roll: float  # Roll [deg]


@dataclass(frozen=True, eq=False)
class PlayStatus(messages.Snapshot):  # type: ignore[misc, unused-ignore]
    """Message to the panel with the displayed state of the drive."""

    title: str = ""
    laws: Sequence[str] = ()
    faults: Sequence[str] = ()
    tyres: Sequence[str] = ()
    t: float = 0.0
    speed: float = 0.0
    wanted: float = 0.0
    angle: float = 0.0
    roll: float = 0.0
    cross_track: float = 0.0
    law: int = 0
    chosen: int = 1
    paused: bool = False
    rate: float = 1.0  # Simulated time divided by wall-clock time [-]
    message: str = ""
    values: dict[str, float] = field(default_factory=dict)
    grade: float = 0.0
    tyre: int = 0
    pressure: float = 0.0  # Pressure of the rear tyres [bar]
    curve: Sequence[CurvePoint] = ()


class DrivePanel(plugin.ViewerPlugin):  # type: ignore[misc, unused-ignore]
    """Panel of an interactive drive, with keys, sliders and curves."""

    def __init__(self, aim: Any, pad: Gamepad) -> None:
        """Create the panel. The function `aim` points a camera at the tractor, and `pad` is the gamepad of the page."""
        self.aim, self.pad, self.status, self.fault = aim, pad, PlayStatus(), 0
        self.edited: dict[str, float] = {}
        """Values of sliders that the driver is dragging, and of sliders whose values apply at a restart."""
        self.tyre: int | None = None

    @messages.handler
    def on_status(self, status: PlayStatus) -> None:
        """Store the status of the drive for display in the next frame."""
        self.status = status

    @messages.handler
    def on_model(self, _: messages.PostModelEvent) -> None:
        """Point the camera at the tractor of a new model, and reset the edited sliders."""
        self.aim(self.viewer.camera)
        self.edited.clear()
        self.tyre = None

    @messages.handler
    def on_build_gui(self, _: messages.BuildGuiEvent) -> None:
        """Read the keys and the gamepad, and draw the panel and the curves."""
        self._keys()
        self._panel()
        self._curves()

    def send(self, name: str, value: float = 0.0, text: str = "") -> None:
        """Send a message about the key, button or slider `name` to the simulation."""
        self.viewer.send_to_sim(Press(name, value, text))

    def _keys(self) -> None:
        for name in self.pad.new_presses():
            self._act(name)
        if imgui.IsAnyItemActive():  # a slider may be edited as text
            return
        held = {name: any(imgui.IsKeyDown(key) for key in keys) for name, keys in HELD.items()}
        self.viewer.send_to_sim(HeldKeys(self.pad.added_to(Keys(**held, seen=time.monotonic()))))
        for name, key in PRESSED.items():
            if imgui.IsKeyPressed(key, False):
                self._act(name)

    def _act(self, name: str) -> None:
        if name == "law":
            self.send(name, self.status.chosen)
        elif name == "inject":
            self.send(name, 0.0, self.status.faults[self.fault] if self.status.faults else "")
        elif name == "restart":
            tyre = self.status.tyres[self.tyre] if self.tyre is not None else ""
            grade = self.edited.get("grade", self.status.grade)
            self.viewer.send_to_sim(Restart(NextStart(grade, tyre, self.edited.get("pressure"))))
        else:
            self.send(name)

    def _panel(self) -> None:
        s = self.status
        height = imgui.GetIO().DisplaySize.y - 2 * MARGIN
        imgui.SetNextWindowPos(imgui.Vec2(MARGIN, MARGIN), imgui.Cond.Always)
        imgui.SetNextWindowSize(imgui.Vec2(WIDTH, min(height, TALLEST)), imgui.Cond.Always)
        imgui.Begin("Drive", flags=FIXED)
        self._state(s)
        imgui.SeparatorText("Steering and speed")
        self._slider("steer", "angle [deg]", degrees(s.angle), -45.0, 45.0, live=True)
        self._slider("speed", "speed [m/s]", s.wanted, REVERSE_M_S, FASTEST_M_S, live=True)
        imgui.SetNextItemWidth(LABEL)
        changed, chosen = imgui.Combo("guidance law", s.chosen - 1, list(s.laws) or ["-"])
        if changed:
            self.send("choose", chosen + 1)
        self._button("driver" if s.law else "law", "Take over (H)" if s.law else "Hand over to the law (L)")
        imgui.SeparatorText("Applied at once")
        for name, each in ADJUSTMENTS.items():
            self._slider(name, each.label, s.values.get(name, each.neutral), each.low, each.high)
        imgui.SetNextItemWidth(LABEL)
        _, self.fault = imgui.Combo("fault", self.fault, list(s.faults) or ["-"])
        self._button("inject", "Inject for 5 s (F)")
        self._button("mark", "Save state (M)")
        imgui.SameLine()
        self._button("recall", "Restore (R)")
        imgui.SeparatorText("Applied at the next start")
        self._slider("grade", "grade [deg]", s.grade, -STEEPEST_DEG, STEEPEST_DEG, kept=True)
        self._slider("pressure", "tyre pressure [bar]", s.pressure, LEAST_BAR, MOST_BAR, kept=True)
        imgui.SetNextItemWidth(LABEL)
        changed, tyre = imgui.Combo("tyre law", s.tyre if self.tyre is None else self.tyre, list(s.tyres) or ["-"])
        self.tyre = tyre if changed else self.tyre
        self._button("restart", "Start again (Backspace)")
        imgui.Separator()
        imgui.TextUnformatted(HELP)
        imgui.End()

    def _state(self, s: PlayStatus) -> None:
        imgui.TextUnformatted(s.title)
        who = s.laws[s.law - 1] if s.law and s.laws else "driver"
        speed, off = round(s.speed, 2) + 0.0, round(s.cross_track, 2) + 0.0  # no -0.00
        imgui.TextUnformatted(f"{s.t:.2f} s   {speed:.2f} m/s   {'paused' if s.paused else who}")
        imgui.TextUnformatted(f"roll {degrees(s.roll):.1f} deg   cross-track error {off:.2f} m")
        imgui.TextUnformatted(f"{s.rate:.2f} x real time")
        if s.message:
            imgui.PushTextWrapPos(WIDTH - MARGIN)
            imgui.TextColored(WARNING, s.message)
            imgui.PopTextWrapPos()

    def _button(self, name: str, text: str) -> None:
        if imgui.Button(text):
            self._act(name)

    def _slider(
        self, name: str, label: str, value: float, low: float, high: float, live: bool = False, kept: bool = False
    ) -> None:
        """Draw a slider with the range `low` to `high`. The value is sent when the slider is released and, if `live`,
        while it is dragged. If `kept`, the value is only sent at a restart."""
        imgui.SetNextItemWidth(LABEL)
        changed, new = imgui.SliderFloat(f"{label}##{name}", self.edited.get(name, value), low, high, "%.2f")
        if changed:
            self.edited[name] = new
            if live:
                self.send(name, new)
        if imgui.IsItemDeactivatedAfterEdit() and not kept:
            self.send(name, self.edited.pop(name, new))

    def _curves(self) -> None:
        s, size = self.status, imgui.GetIO().DisplaySize
        width = max((size.x - WIDTH - 4 * MARGIN) / 2, 200.0)
        times, *curves = zip(*s.curve, strict=True) if s.curve else ((), (), ())
        for k, (title, least) in enumerate((("cross-track error [m]", 0.2), ("roll [deg]", 2.0))):
            values = curves[k]
            left = WIDTH + 2 * MARGIN + k * (width + MARGIN)
            height = max(CURVE_SHARE * size.y, CURVE_LEAST)
            top = size.y - height - MARGIN
            imgui.SetNextWindowPos(imgui.Vec2(left, top), imgui.Cond.Always)
            imgui.SetNextWindowSize(imgui.Vec2(width, height), imgui.Cond.Always)
            imgui.Begin(title, flags=FIXED | int(FLAG.NoScrollbar))
            if times and implot.BeginPlot(title, imgui.Vec2(-1.0, -1.0), int(implot.Flags.NoLegend)):
                last, middle = max(times[-1], SHOWN_S), (min(values) + max(values)) / 2
                half = max(0.6 * (max(values) - min(values)), least)
                implot.SetupAxes("time [s]", "")
                implot.SetupAxesLimits(last - SHOWN_S, last, middle - half, middle + half, int(imgui.Cond.Always))
                implot.PlotLine(title, list(times), list(values))
                implot.EndPlot()
            imgui.End()
