"""Report page and result files of a digital twin: machine, scenario with its path, and column map."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agrobot_mj.core.palette import BLUE, DARK_GREY, LIGHT_GREY, VERMILION
from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.logs.quantities import HEAD, quantity_rows
from agrobot_mj.extensions.logs.replay.residuals import position_errors
from agrobot_mj.extensions.logs.twin.machine import not_told
from agrobot_mj.extensions.logs.twin.twin import MACHINE, SCENARIO, WAY, Twin
from agrobot_mj.extensions.logs.words import map_lines, replay_rows, twin_sentences
from agrobot_mj.simulation.results import write_text
from agrobot_mj.studies.pages.document import Chart, Document, layout
from agrobot_mj.studies.pages.drive import line


def page(t: Twin, health: Sequence[str]) -> Document:
    """Return the report page of a digital twin. `health` contains sentences about the logs."""
    c = t.calibration
    facts = [
        f"machine {t.scenario.machine}",
        f"plant {t.scenario.plant.kind}",
        f"identity {t.identity}",
    ]
    found = Document(f"Twin of {t.name}", facts)
    found.section("Summary")
    for text in [*health, *twin_sentences(t)]:
        found.text(text)
    found.section(
        "Evaluation on held-out data",
        "The twin receives the recorded steering and speed; the start is fitted to the first 10 m of each segment.",
    )
    found.grid([("Track of the antenna", _ways(t)), ("Yaw rate", _yaw_rates(t))])
    found.grid([("Residual of the yaw rate", _rate_residuals(t)), ("Residual of the position", _position_residuals(t))])
    found.table(("held out", "value", "unit"), list(replay_rows(t.held_out.metrics)))
    found.section("Identified parameters", "Identified from the fitted part of the log, with 95 % intervals.")
    for title, part in {"Sensors, with the keys of map.toml:": c.found, "Vehicle:": t.beyond_map}.items():
        found.text(title)
        found.table(HEAD, list(quantity_rows(part, c.units)))
    found.section("Parameters that the log does not identify", "Values of the scenario or machine, or defaults.")
    found.table(("key", "value", "from"), not_told(t.scenario, t.keys))
    for name, text in {"map.toml": map_lines(c), **t.texts}.items():
        if name.endswith(".toml"):
            found.code(name, text)
    return found


def _ways(t: Twin) -> Chart:
    fitted, recorded = ([each.position.value for each in some if each.position] for some in (t.fitted, t.recorded))
    driven = [each.point for each in t.driven]
    curves = [
        _curve([(x, y) for x, y in (places.T for places in part)], name, colour)
        for part, name, colour in (
            (fitted, "recorded, fitted", LIGHT_GREY),
            (recorded, "recorded, held out", DARK_GREY),
            (driven, "twin, open loop", BLUE),
        )
    ]
    return {"data": curves, "layout": layout("east [m]", "north [m]", yaxis={"scaleanchor": "x"})}


def _yaw_rates(t: Twin) -> Chart:
    recorded = [(each.yaw_rate.t, np.degrees(each.yaw_rate.value)) for each in t.recorded if each.yaw_rate]
    driven = [(each.t, np.degrees(each.yaw_rate)) for each in t.driven]
    curves = [_curve(recorded, "recorded", DARK_GREY), _curve(driven, "twin", BLUE)]
    return {"data": curves, "layout": layout("time [s]", "yaw rate, left + [deg/s]")}


def _rate_residuals(t: Twin) -> Chart:
    off = [
        (each.yaw_rate.t, np.degrees(np.interp(each.yaw_rate.t, driven.t, driven.yaw_rate) - each.yaw_rate.value))
        for each, driven in t.held_out.pieces
        if each.yaw_rate
    ]
    curve = _curve(off, "twin minus recording", VERMILION)
    return {"data": [curve], "layout": layout("time [s]", "twin minus recording [deg/s]")}


def _position_residuals(t: Twin) -> Chart:
    errors = [position_errors(*piece) for piece in t.held_out.pieces]
    curves = [
        _curve([(at, 100 * off[:, 0]) for at, off, _ in errors], "ahead, open loop", DARK_GREY),
        _curve([(at, 100 * off[:, 1]) for at, off, _ in errors], "left, open loop", BLUE),
        _curve([(at, 100 * window) for at, _, window in errors], "windows of 10 s", VERMILION),
    ]
    return {"data": curves, "layout": layout("time [s]", "twin minus recording [cm]")}


def _curve(parts: Sequence[tuple[Array, Array]], name: str, colour: str) -> Chart:
    x, y = (np.concatenate([np.append(part[k], np.nan) for part in parts] or [np.empty(0)]) for k in (0, 1))
    return line(x, y, name, colour)


REPORT = "report.html"
FILES = (REPORT, MACHINE, SCENARIO, WAY, "map.toml")  # Files of a twin, in addition to `twin.json`


def write_twin(t: Twin, health: Sequence[str], folder: Path) -> None:
    """Write all result files of a twin to `folder`. Raises `ScenarioError` before writing if plotly is not
    installed."""
    page(t, health).write(folder / REPORT)
    for name, text in {**t.texts, "map.toml": map_lines(t.calibration)}.items():
        write_text(folder / name, text)
