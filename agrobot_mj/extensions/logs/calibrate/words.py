"""A calibration in plain words, as lines for the map, and as numbers."""

from collections.abc import Iterator
from math import degrees, sin, tan
from pathlib import Path
from typing import Any

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.logs.annotated import annotated_toml
from agrobot_mj.extensions.logs.calibrate.calibration import Calibration
from agrobot_mj.extensions.logs.identify.advice import advice
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.machine.tractor import COMPACT, TractorParameters
from agrobot_mj.simulation.results import atomic, write_json

FILES = ("map.toml", "calibration.json")
"""What `--out` writes."""
PLACES = {
    "ahead_m": ("ahead of the rear axle", "behind the rear axle"),
    "left_m": ("left of the middle", "right of the middle"),
}
"""Where an antenna is, by the sign of its place."""
LIKE = {"deg": (40.0, 80.0), "rad": (1 / 80.0, 1 / 40.0)}
"""Scales by a unit that are those of the other unit of angles, or nearly."""
LOOKAHEAD_M = 2.0
"""Look-ahead of the pure pursuit whose offset is told [m]."""
MOVED_DEG = 1.0
"""Wheel angle by which the centre of one half of a drive differs from that of the other before it is told [deg]."""


def report(c: Calibration, tractor: TractorParameters) -> str:
    """Sentences, a table with intervals, and the map with what has been found."""
    rows = [(key, q.text, *q.ends, "yes" if q.identified else "no") for key, q in c.found.items()]
    table = markdown_table(("map key", "value", "from", "to", "told by the log"), rows, 1, aligned=True)
    return "\n".join([*c.pieces.notes, *sentences(c, tractor), "", table, "", "The map:", "", map_lines(c)]).rstrip()


def sentences(c: Calibration, tractor: TractorParameters) -> list[str]:
    """What the numbers mean for the owner."""
    found = [*_centre(c, tractor), *_scale(c, tractor), *_ages(c), *_places(c)]
    if (largest := degrees(c.largest_angle)) > tractor.steer_limit_deg:
        found.append(
            f"The wheels turn by up to {largest:.0f} deg, beyond tractor.steer_limit_deg = "
            f"{tractor.steer_limit_deg:g}: set that."
        )
    return [*found, *advice(c.pieces.kept, [key for key, each in c.found.items() if not each.identified])]


def map_lines(c: Calibration) -> str:
    """The whole map with what has been found, intervals as comments."""
    return map_text(c.calibrated, {key: " to ".join(each.ends) for key, each in c.found.items() if each.identified})


def map_text(m: LogMap, notes: dict[str, str]) -> str:
    """A map as TOML, with comments by `table.key`."""
    return annotated_toml(m.model_dump(mode="json", exclude_defaults=True, exclude_none=True), notes)


def numbers(c: Calibration) -> dict[str, Any]:
    """What `calibration.json` holds."""
    return {
        "identity": c.identity,
        "found": {key: each._asdict() for key, each in c.found.items()},
        "positive": c.positive,
        "windows": c.data.windows,
        "notes": list(c.pieces.notes),
    }


def write_calibration(c: Calibration, folder: Path) -> None:
    """Write `map.toml` and `calibration.json` into a folder of results."""
    with atomic(folder / "map.toml") as part:
        part.write_text(map_lines(c), encoding="utf-8")
    write_json(folder / "calibration.json", numbers(c))


def _centre(c: Calibration, tractor: TractorParameters) -> Iterator[str]:
    centre, given, off = c.found["steer.offset"], c.steer.offset, c.centre_error
    if "offset" not in c.steer.model_fields_set:
        yield f"The centre of the steering is about {centre.text}{_unit(c)}."
    elif not centre.excludes(given):
        yield f"The centre of the steering is right: {centre.text}{_unit(c)}."
    else:
        turned = c.heading_error if c.heading_error is not None else 0.0
        left = tan(off) * LOOKAHEAD_M**2 / (2 * tractor.wheelbase_m) - LOOKAHEAD_M * sin(turned)
        yield (
            f"Your centre is about {centre.text}{_unit(c)}, not {given:g}: the tractor drives {abs(100 * left):.0f} cm "
            f"to the {_side(left)} of its line, the wheels {abs(degrees(off)):.1f} deg to the {_side(off)} (pure "
            f"pursuit, look-ahead {LOOKAHEAD_M:g} m{', the error of the heading included' if turned else ''})."
        )
    first, *_, second = c.centres
    if degrees(abs(c.rough.scale * (second - first))) > MOVED_DEG:
        yield (
            f"But it moves: {first:.3g} in the first half of the drive, {second:.3g} in the second. If the sensor has "
            "slipped, calibrate what was driven before and after by itself (--from, --to)."
        )


def _scale(c: Calibration, tractor: TractorParameters) -> Iterator[str]:
    scale, given = c.found["steer.scale"], c.steer
    told = given.model_fields_set
    if c.positive != given.positive:
        rather = f", not to the {given.positive}" if "positive" in told else ""
        mirrored = c.pieces.kept[0].yaw_rate_source == "course"
        unless = []
        if mirrored:
            unless.append("[position] has east for north: with a gyro or a heading that shows")
        if not c.pieces.signed:
            unless.append("most of the drive was in reverse: [speed] has no sign")
        yield f"The readings grow to the {c.positive}{rather}{', unless ' if unless else ''}{', or '.join(unless)}."
    if given.unit in LIKE and LIKE[given.unit][0] < scale.value < LIKE[given.unit][1]:
        other = "rad" if given.unit == "deg" else "deg"
        yield f'If the readings are in {other}, the map should say so: unit = "{other}" in [steer].'
    if scale.excludes(given.scale):
        rather = f", not {given.scale:g}" if "scale" in told else ""
        yield f"One{_unit(c).rstrip('s')} turns the wheels by {scale.text} {given.unit}{rather}."
    wheelbase = f"{tractor.wheelbase_m:g} m"
    if "wheelbase_m" not in tractor.model_fields_set and tractor.wheelbase_m == COMPACT.wheelbase_m:
        wheelbase += ", the default,"
    yield (
        f"Scale and wheelbase cannot be told apart: {wheelbase} is taken as known, 1 % more of it is 1 % more scale; "
        "measure it."
    )


def _ages(c: Calibration) -> Iterator[str]:
    for part in ("heading", "position", "speed"):
        if (age := c.found.get(f"{part}.delay_s")) and age.identified and age.excludes(0.0):
            when = "old when it is written" if age.value > 0 else "ahead of the steering"
            yield f"The {part} is {age.text.lstrip('-')} s {when}."


def _places(c: Calibration) -> Iterator[str]:
    if c.heading_error is not None and c.found["heading.offset"].excludes(0.0):
        off = c.heading_error
        yield f"The heading points {abs(degrees(off)):.3g} deg to the {_side(off)} of where the tractor does."
    for key, what in PLACES.items():
        place = c.found.get(f"position.{key}")
        if place and place.identified and place.excludes(getattr(c.log_map.position, key)):
            yield f"The antenna is {place.text.lstrip('-')} m {what[place.value < 0]}, not as the map says."


def _side(angle: float) -> str:
    return "left" if angle > 0 else "right"


def _unit(c: Calibration) -> str:
    """The unit of the readings in words: one with a scale is no degree."""
    return f" {c.steer.unit}" if c.steer.scale == 1.0 and c.found["steer.scale"].value > 0.5 else " counts"
