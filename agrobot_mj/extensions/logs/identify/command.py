"""What `agrobot-mj identify --vehicle` does: a table, or, where a log cannot tell of tyres, what it does tell."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.table_columns import Source
from agrobot_mj.extensions.logs.calibrate.calibration import calibrate
from agrobot_mj.extensions.logs.calibrate.words import report
from agrobot_mj.extensions.logs.identify.advice import advice
from agrobot_mj.extensions.logs.identify.vehicle import IdentifiedVehicle, TooLittleError, identify_vehicle, told_apart
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.origin import log_identity
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.results import check_folder, claim, write_json


def identify_vehicle_command(
    sources: Sequence[Source], log_map: LogMap | None, scenario: Scenario, folder: Path | None, **options: Any
) -> str:
    """As `identify_vehicle`; writes `vehicle.json` into `folder`, if given, and returns a table.

    Where there is too little for stiffnesses, what the log tells of its sensors, and what to drive.
    """
    if folder is not None:
        check_folder(folder, ("vehicle.json",))
    try:
        found = identify_vehicle(sources, log_map, scenario, **options)
    except TooLittleError as error:
        return _lesser(error, sources, log_map, scenario, options)
    if folder is not None:
        claim(folder, ("vehicle.json",))
        content = {"identity": log_identity(scenario, sources, log_map, **options), **found._asdict()}
        content |= {"found": {name: each._asdict() for name, each in found.found.items()}}
        del content["kept"]
        write_json(folder / "vehicle.json", content)
    return table(found, scenario)


def _lesser(
    error: TooLittleError,
    sources: Sequence[Source],
    log_map: LogMap | None,
    scenario: Scenario,
    options: dict[str, Any],
) -> str:
    """A calibration in place of an identification."""
    lesser = calibrate(sources, log_map, scenario, options.get("start_s", 0.0), options.get("end_s", float("inf")))
    lines = [str(error), "What the log does tell:", report(lesser, scenario.tractor)]
    return "\n".join([*lines, *advice(lesser.pieces.kept, ["cornering_stiffness"])])


def table(found: IdentifiedVehicle, scenario: Scenario) -> str:
    """Values with their 95 % intervals as plain text and valid Markdown, and what they are worth."""
    rows = [(key, *map(_text, each[:3]), "yes" if each.identified else "no") for key, each in found.found.items()]
    lines = [*found.notes, markdown_table(("quantity", "value", "from", "to", "identified"), rows, 1, aligned=True)]
    if not told_apart(found.found):
        lines.append("The axles cannot be told apart in this log: take the understeer gradient, which both share.")
    lines += advice(found.kept, [key for key, each in found.found.items() if not each.identified])
    if (b := found.found.get("backlash_deg")) and not b.identified:
        lines.append("No backlash is seen beyond the noise of the recorded angle.")
    lines.append(
        f"On the rest of the log the fit explains {100 * found.explained:.2f} % and leaves "
        f"{found.residual_deg_s:.3f} rms; wheels without slip leave {found.kinematic_deg_s:.3f} (deg/s, or m)."
    )
    t = scenario.tractor
    lines.append(
        f"Taken as known: {t.mass_kg:g} kg, {t.yaw_inertia_kg_m2:g} kg m2, wheelbase {t.wheelbase_m:g} m, "
        f"{100 * t.front_load_fraction:g} % in front, and the scale of the wheel angle, which `agrobot-mj calibrate` "
        f"checks; {found.geometry}; {found.windows} windows of 5 s."
    )
    if found.moved:
        each = [f"{what} makes them {front:.2f} and {rear:.2f} times" for what, (front, rear) in found.moved.items()]
        lines.append(f"Not given, and not in the intervals of front and rear stiffness: {'; '.join(each)}.")
    return "\n".join(lines)


def _text(value: float | None) -> str:
    return "none" if value is None else f"{value:.4g}"
