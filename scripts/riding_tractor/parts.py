"""Parts of docs/real_machine.md: tables and figures from a comparison, by the names of the page's blocks."""

from collections.abc import Callable, Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.palette import BLUE, DARK_GREY, GREEN, ORANGE, VERMILION
from agrobot_mj.core.signals import Array
from agrobot_mj.studies.style import PANEL_WIDTH_IN, STYLE, save
from agrobot_mj.tyres.laws import tyre_set
from riding_tractor import coverage, gnss, steering_rates
from riding_tractor.closed_loop import CENTRE, Board, Pass, calibrated, terrain
from riding_tractor.comparison import FAST, SLOW, Comparison
from riding_tractor.coverage import Straight
from riding_tractor.logs import CALIBRATION, HELD_OUT, STANDING, Run, field_log
from riding_tractor.prediction import CARCASS, NO_SLIP, Numbers, explained

MODEL_COLOURS = (BLUE, ORANGE, GREEN, VERMILION)
"""Colours of the models beside the recording, which is grey."""


def drawn(file: Path, height: float, columns: int, draw: Any, **layout: Any) -> Path:
    """Draw a row of panels of some height [in]; `draw` gets their axes."""
    with rc_context(STYLE):
        figure = Figure(figsize=(columns * PANEL_WIDTH_IN, height), layout="constrained")
        draw(figure.subplots(1, columns, **layout))
        return save(figure, file)


def draw_slip(passes: Sequence[Straight], heading_error: float, file: Path) -> Path:
    """Reading straight ahead, and the offset from the line beside what that reading asks for."""
    minutes = np.array([p.t for p in passes]) / 60.0
    west = np.array([p.westwards for p in passes])

    def draw(axes: Any) -> None:
        reading, offset = axes
        for way, marker, name in ((west, "<", "westwards"), (~west, ">", "eastwards")):
            pots, lefts = (np.array([getattr(p, key) for p in passes])[way] for key in ("pot", "left"))
            reading.plot(minutes[way], pots, marker, color=BLUE, markersize=3.5, label=name)
            offset.plot(minutes[way], 100 * lefts, marker, color=BLUE, markersize=3.5, label=f"recorded, {name}")
        reading.axhline(447, color=DARK_GREY, label="straight ahead by the firmware")
        asked = [100 * p.expected(heading_error) for p in passes]
        offset.plot(minutes, asked, "x", color=VERMILION, markersize=3.5, label="by firmware and sensor")
        reading.set(xlabel="Time [min]", ylabel="Counts", title="Potentiometer while driving straight on")
        offset.set(xlabel="Time [min]", ylabel="Left of the line [cm]", title="Offset from the mission")
        reading.legend(loc="lower left")
        offset.legend(loc="lower right")

    return drawn(file, 2.6, 2, draw)


def draw_yaw_rates(t: Array, recorded: Array, models: Mapping[str, Array], file: Path) -> Path:
    """Yaw rate of a held-out piece [rad/s], recorded and predicted, and what is left of it."""

    def draw(axes: Any) -> None:
        rate, rest = axes
        rate.plot(t, np.degrees(recorded), color=DARK_GREY, linewidth=1.8, label="recorded")
        for colour, (name, values) in zip(MODEL_COLOURS, models.items(), strict=False):
            rate.plot(t, np.degrees(values), color=colour, label=name)
            rest.plot(t, np.degrees(values - recorded), color=colour, label=name)
        rate.set(xlabel="Time [s]", ylabel="Yaw rate [deg/s]", title="Yaw rate")
        rest.set(xlabel="Time [s]", ylabel="Model less recording [deg/s]", title="Residual")
        rate.legend()

    return drawn(file, 2.6, 2, draw)


def draw_passes(recorded: Mapping[str, Pass], simulated: Mapping[str, Sequence[Pass]], file: Path) -> Path:
    """Distances from the line: recorded passes as points, those of the twin over seeds as boxes."""

    def draw(axes: Any) -> None:
        for panel, key, title in zip(axes, ("mean", "p95", "left"), ("Mean", "95 %", "To the left"), strict=True):
            groups = [[getattr(p, key) for p in some] for some in simulated.values()]
            panel.boxplot(groups, widths=0.5, whis=(0, 100), medianprops={"color": BLUE})
            for k, speed in enumerate((0.5, 0.85), 1):
                values = [getattr(p, key) for name, p in recorded.items() if name.endswith("85") == (speed > 0.5)]
                panel.plot(np.full(len(values), k), values, "o", color=VERMILION, markersize=4, label="recorded")
            panel.set_xticks(range(1, len(groups) + 1), list(simulated), rotation=20, ha="right")
            panel.set(ylabel="Distance [cm]", title=title)
        axes[0].legend(*(each[:1] for each in axes[0].get_legend_handles_labels()))

    return drawn(file, 2.8, 3, draw)


def draw_turns(found: Sequence[tuple[str, Array, Mapping[str, Array]]], file: Path) -> Path:
    """Keyhole turns: planned, recorded and simulated ways, each (2, n) [m]."""
    styles = {"recorded": (DARK_GREY, 1.8), "replayed": (BLUE, 0.9), "twin under its guidance": (VERMILION, 0.9)}

    def draw(axes: Any) -> None:
        for panel, (title, planned, ways) in zip(axes, found, strict=True):
            panel.plot(*planned, "k:", label="planned")
            for name, way in ways.items():
                colour, width = styles[name]
                panel.plot(*way, color=colour, linewidth=width, label=name)
            panel.set_aspect("equal", adjustable="datalim")
            panel.set(xlabel="East [m]", ylabel="North [m]", title=title)
        axes[0].legend()

    return drawn(file, 3.2, len(found), draw)


Blocks = dict[str, str]
HEADS = (
    *("run", "model", "yaw rate explained", "residual [deg/s]", "lag [s]"),
    *("10 s windows rms / p95 [cm]", "open loop rms / end [m]"),
)


def calibration_part(c: Comparison) -> Blocks:
    """What the runs of the calibration say of the sensors, beside the firmware."""
    left, right = (degrees(1.0 / counts) for counts in (Board().left, Board().right))
    firmware = {"steer.offset": f"{CENTRE:g}", "steer.scale": f"{left:.3f} left, {right:.3f} right"}
    lines = []
    for key, each in c.calibration.found.items():
        told = f"{each.value:.3f} [{each.low:.3f}, {each.high:.3f}]" if each.identified else "not told"
        lines.append((f"`{key}`", firmware.get(key, "-"), told))
    for drive in (150.0, 255.0):
        lines.append((f"steering rate at a drive of {drive:g} [deg/s]", "-", f"{c.motor.at(drive):.0f}"))
    return {"calibration": markdown_table(("quantity", "firmware", "runs 1W and 1E, 95 % interval"), lines)}


def row(run: str, name: str, found: Numbers) -> tuple[str, ...]:
    """A line of `HEADS`."""
    rate, place = found["yaw_rate"], found["position"]
    windows = f"{100 * place['windows_rms']:.1f} / {100 * place['windows_p95']:.1f}"
    told = (f"{rate['explained']:.0%}", f"{degrees(rate['rms_without_bias']):.2f}", f"{rate['lag_s']:+.2f}")
    return run, name, *told, windows, f"{place['rms']:.2f} / {place['at_the_end']:.2f}"


def prediction_part(c: Comparison) -> Blocks:
    """All models on the runs that were held out, and on those that they were fitted to."""

    def table(runs: tuple[Run, ...]) -> str:
        lines = [row(run.name, name, c.told(run.name, model)) for run in runs for name, model in c.models.items()]
        return markdown_table(HEADS, lines)

    found = {"fitted": table(CALIBRATION), "held out": table(HELD_OUT)}
    draw_prediction(c)
    return found


def draw_prediction(c: Comparison) -> None:
    """The piece of a fast run that was held out in which it turns most."""
    named = {name: c.ways("2W85", model) for name, model in c.models.items() if model != NO_SLIP}
    turning = [float((each.yaw_rate.value**2).sum()) if each.yaw_rate else 0.0 for each in c.pieces["2W85"]]
    k = int(np.argmax(turning))
    seen = c.pieces["2W85"][k].yaw_rate
    assert seen is not None
    rates = {name: np.interp(seen.t, ways[k][1].t, ways[k][1].yaw_rate) for name, ways in named.items()}
    draw_yaw_rates(seen.t, seen.value, rates, c.images / "real_yaw_rate.png")


def relaxation_part(c: Comparison) -> Blocks:
    """Share of the yaw rate that is explained, by the stiffness of the carcass: on all runs a fit."""
    names = [run.name for run in (*CALIBRATION, *HELD_OUT)]
    lines = []
    for share in CARCASS:
        tyres = tyre_set(c.twin.changed({"plant.tyre.carcass_lateral": share}).plant.tyre, c.twin.tractor)
        front, rear = tyres.relaxation[[0, 2], 1].tolist()
        mark = " (twin)" if share == c.carcass else ""
        lines.append(
            (f"{share:g}{mark}", f"{front:.2f}, {rear:.2f}", *(f"{explained(c.told(n, share)):.0%}" for n in names))
        )
    return {"relaxation": markdown_table(("carcass", "front, rear [m]", *names), lines)}


def mean(passes: Sequence[Pass], key: str) -> str:
    """Mean and range over passes."""
    values = [getattr(p, key) for p in passes]
    return f"{np.mean(values):.1f} ({min(values):.1f} to {max(values):.1f})"


def closed_loop_part(c: Comparison) -> Blocks:
    """Recorded and simulated passes; what the owner would gain."""
    keys = ("mean", "p95", "left")
    lines, drawn = [], {}
    for speed, fast in ((SLOW, False), (FAST, True)):
        some = [p for name, p in c.passes.items() if name.endswith("85") == fast]
        lines.append((f"recorded, {speed:g} m/s", len(some), *(mean(some, key) for key in keys)))
        twins = c.driven(c.loop, FAST, c.fitted) if fast else c.roughness[c.fitted]
        drawn[f"twin, {speed:g} m/s"] = twins
        how = "predicted" if fast else "roughness fitted"
        lines.append((f"twin, {speed:g} m/s, {how}", len(twins), *(mean(twins, key) for key in keys)))
    draw_passes(c.passes, drawn, c.images / "real_passes.png")
    heads = ("passes", "number", "mean [cm]", "p95 [cm]", "left [cm]")
    scan = [(f"{step * 1e6:.0f}", *(mean(found, key) for key in keys)) for step, found in c.roughness.items()]
    return {
        "closed loop": markdown_table(heads, lines),
        "roughness": markdown_table(("roughness [10^-6 m3]", *heads[2:]), scan),
        "gain": gain(c),
    }


def gain(c: Comparison) -> str:
    """What the owner may put right, one after the other, over the fitted roughness."""
    loop, right = c.loop, calibrated(c.centre, c.scale)
    changes = {
        "as it is": loop,
        "centre put right": loop._replace(board=Board(c.centre)),
        "centre and scale put right": loop._replace(board=right),
        "heading put right besides": loop._replace(board=right, heading_error=0.0),
        "dead band of 5 counts besides": loop._replace(board=right._replace(dead_band=5.0), heading_error=0.0),
    }
    lines = []
    for name, each in changes.items():
        slow, fast = (c.driven(each, speed, c.fitted) for speed in (SLOW, FAST))
        lines.append((name, *(mean(some, key) for key in ("left", "mean", "p95") for some in (slow, fast))))
    heads = [f"{what} at {speed:g} m/s [cm]" for what in ("left", "mean", "p95") for speed in (SLOW, FAST)]
    return markdown_table(("", *heads), lines)


def slip_part(c: Comparison) -> Blocks:
    """The coverage run: a sensor that slips."""
    passes = coverage.straights(coverage.track(c.logs))
    first, last, minutes = coverage.drift(passes)
    off, asked = np.array([(p.left, p.expected(c.heading_error)) for p in passes]).T
    draw_slip(passes, c.heading_error, c.images / "real_slip.png")
    rest = off - asked
    text = (
        f"{len(passes)} straight passes in {minutes:.0f} minutes: the reading straight ahead goes from {first:.0f} to "
        f"{last:.0f} counts, {abs(last - first) * c.scale:.0f} deg, and the offset from {100 * off[:3].mean():+.0f} to "
        f"{100 * off[-3:].mean():+.0f} cm, left positive. What firmware and reading ask for explains "
        f"{1 - rest.var() / off.var():.0%} of it, {100 * np.sqrt(np.mean(rest**2)):.0f} cm rms."
    )
    return {"slip": text}


def turns_part(c: Comparison) -> Blocks:
    """Keyhole turns of the coverage run."""
    track = coverage.track(c.logs)
    passes, lines, drawn = coverage.straights(track), [], []
    for each in coverage.TURNS:
        turn = coverage.turn(track, passes, c.loop, each)
        numbers = (turn.centre, *turn.off_plan, *turn.apart)
        lines.append((each.name, f"{numbers[0]:.0f}", *(f"{number:.2f}" for number in numbers[1:])))
        ways = {"recorded": turn.recorded, "twin under its guidance": turn.simulated}
        drawn.append((f"Turn {each.name}", turn.planned, ways))
    draw_turns(drawn, c.images / "real_turns.png")
    heads = (
        *("turn", "straight ahead at [counts]", "off the plan: recorded [m]", "twin [m]"),
        *("twin from recorded, rms [m]", "largest [m]"),
    )
    return {"turns": markdown_table(heads, lines)}


def gnss_part(c: Comparison) -> Blocks:
    """Receivers as they fail, and what becomes of the tractor."""
    worst = max(gnss.wander(field_log(c.logs, run)) for run in STANDING)
    ground = terrain(c.work, 1, c.fitted)
    return {
        "gnss failures": gnss.failures(c.logs),
        "gnss stops": gnss.stops_table(c.logs),
        "gnss wander": f"Positions of quality 2 of the standing tractor lie up to {worst:.2f} m off the fixed ones.",
        "gnss twin": gnss.on_the_twin(c.loop, ground, (1, 2)),
    }


def can_part(c: Comparison) -> Blocks:
    """Steering of a full-size tractor beside our valve."""
    if c.bus is None:
        return {}
    s, (left, right) = steering_rates.measured(c.bus, c.work), steering_rates.valve_rates()
    lines = [
        ("rate over a second [deg/s]", f"{s.over_1_s:.0f}", f"{left:.1f} left, {right:.1f} right"),
        ("rate over half a second [deg/s]", f"{s.over_half_s:.0f}", ""),
        ("largest wheel angle [deg]", f"{s.lock:.0f}", "45"),
        ("wheels for a turn by hand [deg]", f"{s.left_per_turn:.0f} left, {s.right_per_turn:.0f} right", "-"),
        ("wheels behind the hand [s]", f"{s.lag:.2f}, explains {s.explained:.0%}", "-"),
    ]
    return {"steering rates": markdown_table(("", "Massey Ferguson 7720, by hand", "our valve"), lines)}


PARTS: dict[str, Callable[[Comparison], Blocks]] = {
    "calibration": calibration_part,
    "prediction": prediction_part,
    "relaxation": relaxation_part,
    "closed_loop": closed_loop_part,
    "slip": slip_part,
    "turns": turns_part,
    "gnss": gnss_part,
    "can": can_part,
}
"""Every part by its name on the command line."""
