"""Sentences about results of a log analysis: calibration, identification, replay and twin."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from math import atan, degrees, sin, tan
from typing import Any

import numpy as np

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.logs.annotated import annotated_toml
from agrobot_mj.extensions.logs.calibrate import Calibration
from agrobot_mj.extensions.logs.identify.vehicle import IdentifiedVehicle, told_apart
from agrobot_mj.extensions.logs.pieces import TWO_SPEEDS, excitation, slow_and_fast
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.result import ReplayResult
from agrobot_mj.extensions.logs.twin.twin import SCENARIO, Twin
from agrobot_mj.machine.tractor import COMPACT, TractorParameters

PLACES = {
    "ahead_m": ("ahead of the rear axle", "behind the rear axle"),
    "left_m": ("left of the middle", "right of the middle"),
}
"""Words for positive and negative values of the antenna position, by key."""
LIKE = {"deg": (40.0, 80.0), "rad": (1 / 80.0, 1 / 40.0)}
"""Ranges of the scale, by unit of the angles, in which the angles probably have the other unit."""
LOOKAHEAD_M = 2.0
"""Look-ahead distance of a pure-pursuit law for which the resulting lateral offset is reported [m]."""
MOVED_DEG = 1.0
"""Minimum error or change of the steering centre that is reported [deg]."""


FOLLOWED = 0.05
"""RMS speed residual per mean speed above which the plant does not follow the speed [-]."""
SAME_GAIN = 0.05
"""Minimum reported error of scale and wheelbase combined [-], above the accuracy of measurements by users."""
SLIPLESS = 0.5
"""Residual without slip divided by residual of the plant below which the plant is wrong, not the scale [-]."""
JUDGED_S = 10.0
"""Minimum duration for evaluating a yaw-rate gain [s]: one or two bends."""
WRONG_GAIN = 3.0
"""Yaw-rate gain above which the unit of a sensor is wrong, not its scale [-]."""
SAME_WAY_M, SAME_LENGTH, SAME_UNIT = 0.05, 0.01, 0.2
"""Minimum reported position error in a window [m], minimum reported relative error of the track length [-], and error
that only a wrong unit can explain, because no slip is as large [-]."""
FAST_M_S = 2.5
"""Minimum speed at which stiffnesses are identifiable [m/s]. Assumed value: K u^2 is a few per cent at this speed."""
TIGHT = 0.15
"""Minimum curvature of a tight bend [1/m]: a radius of 7 m."""
QUICK_DEG_S = 10.0
"""95th percentile of the steering rate above which steering counts as quick [deg/s]."""


def sentences(c: Calibration, tractor: TractorParameters) -> list[str]:
    """Return sentences that interpret a calibration."""
    found = [*_centre(c, tractor), *_scale(c, tractor), *_ages(c), *_places(c)]
    if (largest := degrees(c.largest_angle)) > tractor.steer_limit_deg:
        found.append(
            f"The wheels turn by up to {largest:.0f} deg, beyond tractor.steer_limit_deg = "
            f"{tractor.steer_limit_deg:g}: set that."
        )
    return [*found, *advice(c.pieces.kept, [key for key, each in c.found.items() if not each.identified])]


def map_lines(c: Calibration) -> str:
    """Return the calibrated map as TOML text, with the intervals of estimated values as comments."""
    notes = {key: " to ".join(each.ends) for key, each in c.found.items() if each.identified}
    return annotated_toml(c.calibrated.model_dump(mode="json", exclude_defaults=True, exclude_none=True), notes)


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
    if c.two_scales:
        right = c.found["steer.scale_right"]
        yield (
            f"The sensor reads differently to each side: one{_unit(c).rstrip('s')} turns the wheels by {scale.text} "
            f"{given.unit} to the left and by {right.text} to the right, about one centre."
        )
    elif scale.excludes(given.scale):
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
    """Return the unit of the readings as text: `counts` for scaled readings, otherwise the unit of the column."""
    return f" {c.steer.unit}" if c.steer.scale == 1.0 and c.found["steer.scale"].value > 0.5 else " counts"


def advice(recordings: Sequence[FieldRecording], missing: Collection[str]) -> list[str]:
    """Return sentences about manoeuvres that would identify `missing` quantities (keys); empty if none is missing."""
    (_, rate, bend), (slow, fast) = excitation(recordings), slow_and_fast(recordings)
    found = []
    if any("stiffness" in key for key in missing):
        if fast < FAST_M_S:
            found.append(
                f"Cornering stiffness needs speed, and this drive has {fast:.1f} m/s: drive two minutes at "
                f"{FAST_M_S:g} m/s or more, as fast as is safe, with bends to both sides."
            )
        elif (quick := float(np.percentile(np.abs(rate), 95))) < QUICK_DEG_S:
            found.append(
                f"To tell the axles apart steer quickly: {QUICK_DEG_S:g} deg/s and more in swings of a second or two; "
                f"this drive has {quick:.0f} deg/s."
            )
    if any("relaxation" in key for key in missing) and fast < TWO_SPEEDS * slow:
        found.append(
            f"A relaxation length looks like a delay at one speed ({fast:.1f} m/s): drive the same at twice the speed."
        )
    if "speed.delay_s" in missing and fast < TWO_SPEEDS * slow:
        found.append("The age of the speed shows where the speed changes: slow down and speed up a few times.")
    elif any(key.endswith(".delay_s") for key in missing):
        found.append("Ages show in bends and changes of the speed: swing to both sides, slowly and fast.")
    if any(key in ("position.ahead_m", "position.left_m") for key in missing):
        sides = [float(np.mean(side * bend > TIGHT)) for side in (1, -1)]
        where = "tight circles to both sides" if min(sides) < 0.05 else "tight circles at two speeds"
        found.append(f"The antenna's place shows in {where}; else measure it with a tape.")
    return found


def vehicle_sentences(found: IdentifiedVehicle, t: TractorParameters) -> Iterator[str]:
    """Yield sentences about the reliability of an identified vehicle."""
    if not told_apart(found.found):
        yield "The axles cannot be told apart in this log: take the understeer gradient, which both share."
    yield from advice(found.kept, [key for key, each in found.found.items() if not each.identified])
    if (b := found.found.get("backlash_deg")) and not b.identified:
        yield "No backlash is seen beyond the noise of the recorded angle."
    yield (
        f"On the rest of the log the fit explains {100 * found.explained:.2f} % and leaves "
        f"{found.residual_deg_s:.3f} rms; wheels without slip leave {found.kinematic_deg_s:.3f} (deg/s, or m)."
    )
    yield (
        f"Taken as known: {t.mass_kg:g} kg, {t.yaw_inertia_kg_m2:g} kg m2, wheelbase {t.wheelbase_m:g} m, "
        f"{100 * t.front_load_fraction:g} % in front, and the scale of the wheel angle, which `agrobot-mj twin --only "
        f"calibrate` checks; {found.geometry}; {found.windows} windows of 5 s."
    )
    if found.moved:
        each = [f"{what} makes them {front:.2f} and {rear:.2f} times" for what, (front, rear) in found.moved.items()]
        yield f"Not given, and not in the intervals of front and rear stiffness: {'; '.join(each)}."


def replay_sentences(found: ReplayResult, tractor: TractorParameters) -> Iterator[str]:
    """Yield lines with the results of a replay and warnings."""
    m = found.metrics
    yield from found.notes
    yield (f"{m['log']}: {m['duration_s']:.1f} s, {m['way_m']:.0f} m on the {m['plant']} plant, by {m['steered_by']}")
    cells = ((name, "-" if value is None else f"{value:.4g}", unit) for name, value, unit in replay_rows(m))
    yield markdown_table(("plant less recording", "value", "unit"), cells, 1, aligned=True)
    yield from doubts(found, tractor)


def replay_rows(m: Mapping[str, Any]) -> Iterator[tuple[str, float | None, str]]:
    """Yield rows of the table of a replay from its metrics: name, value, unit."""
    if rate := m["yaw_rate"]:
        slipless = rate["kinematic_rms_without_bias"]
        yield f"yaw rate by the {rate['source']}, residual rms", degrees(rate["rms_without_bias"]), "deg/s"
        yield "yaw rate, the same of wheels without slip", None if slipless is None else degrees(slipless), "deg/s"
        yield "yaw rate, bias", degrees(rate["bias"]), "deg/s"
        yield "yaw rate, recorded rms", degrees(rate["recorded_rms"]), "deg/s"
        yield "yaw rate, latency of the recording", rate["lag_s"], "s"
    if place := m["position"]:
        yield f"position in windows of {place['window_s']:g} s, rms", place["windows_rms"], "m"
        yield f"position in windows of {place['window_s']:g} s, 95th percentile", place["windows_p95"], "m"
        yield "position open loop, rms", place["rms"], "m"
        yield "position open loop, at the end of a piece", place["at_the_end"], "m"
    yield "speed, residual rms", m["speed_rms"], "m/s"


def doubts(found: ReplayResult, tractor: TractorParameters, scaled: bool = False) -> Iterator[str]:
    """Yield warnings about limits of the plant and errors of the map. `scaled` states whether the scale was fitted."""
    m = found.metrics
    angles = [np.abs(recording.steer.at(driven.t)) for recording, driven in found.pieces if recording.steer]
    if angles and (largest := degrees(max(each.max() for each in angles))) > tractor.steer_limit_deg:
        share = float(np.mean(np.concatenate(angles) > tractor.steer_limit))
        yield (
            f"The recorded angle reaches {largest:.0f} deg, the plant stops at tractor.steer_limit_deg = "
            f"{tractor.steer_limit_deg:g} ({100 * share:.1f} % of the time): set that"
        )
    mean = m["way_m"] / m["duration_s"] if m["duration_s"] else 0.0
    if m["speed_rms"] > FOLLOWED * mean:
        yield (
            f"The plant does not follow the recorded speed: {m['speed_rms']:.2f} m/s rms of {mean:.2f}; on "
            "plant.kind = bicycle it does"
        )
    yield from _way_doubts(m["position"])
    if (rate := m["yaw_rate"]) and rate["source"] == "heading" and mean:
        off = degrees(atan(tractor.wheelbase_m * rate["bias"] / mean))
        if abs(off) > MOVED_DEG:
            side = "right" if off > 0 else "left"
            yield (
                f"The plant turns by {degrees(rate['bias']):+.2f} deg/s more to the left than the recorded heading, "
                f"which has no bias: the wheels are {abs(off):.1f} deg further to the {side} than the map says; has "
                "the sensor moved (steer.offset)?"
            )
    if not (rate := m["yaw_rate"]) or rate["explained"] is None:
        return
    if rate["explained"] < 0 or (rate["gain"] or 0.0) > WRONG_GAIN:
        yield (
            "The plant's yaw rate explains nothing of the recorded one: check sign (positive) and unit of [steer], "
            f"[speed] and [{'heading' if rate['source'] == 'heading' else 'yaw_rate'}] in the map"
        )
    elif rate["explained"] > 0.5 and abs(rate["gain"] - 1.0) > SAME_GAIN and m["duration_s"] > JUDGED_S:
        yield f"The machine turns {rate['gain']:.2f} times as fast as the plant: {_why(rate, scaled)}"


def _why(rate: dict[str, Any], scaled: bool) -> str:
    """Return possible reasons for a difference between yaw rates."""
    off, slipless = rate["rms_without_bias"], rate["kinematic_rms_without_bias"]
    if slipless is not None and slipless < (1.0 if scaled else SLIPLESS) * off:
        return (
            f"wheels without slip at this scale and wheelbase do better, {degrees(slipless):.2f} instead of "
            f"{degrees(off):.2f} deg/s rms, so it is the plant, whose tyres slip and scrub in tight bends (the bicycle "
            "takes an angle for its tangent)"
        )
    if scaled:
        return "the scale of [steer] is calibrated, so the tyres are off"
    return (
        "the scale of [steer] or tractor.wheelbase_m is off, or at speed the tyres; the log cannot tell which: measure "
        "the wheelbase, then `agrobot-mj twin --only calibrate`"
    )


def _way_doubts(place: dict[str, Any] | None) -> Iterator[str]:
    if not place or place["windows_rms"] is None or place["windows_rms"] <= SAME_WAY_M:
        return
    off = place["windows_rms"]
    yield (
        f"The plant leaves the recorded way by {f'{100 * off:.0f} cm' if off < 1 else f'{off:.3g} m'} within "
        f"{place['window_s']:g} s, more than guidance errs: between laws believe no smaller difference"
    )
    if (off := abs(place["stretch"] - 1.0)) > SAME_LENGTH:
        unit = "check the unit of [speed] and the columns of [position] in the map"
        why = unit if off > SAME_UNIT else "[speed] is off by as much, or wheels slip otherwise than the plant's"
        yield f"The recorded way is {place['stretch']:.3f} times as long as the plant's: {why}"


def twin_sentences(t: Twin) -> list[str]:
    """Return sentences about the reliability of a twin, then about its properties."""
    m = t.held_out.metrics
    rate, place = m["yaw_rate"], m["position"]
    parts = []
    if rate and rate["explained"] is not None:
        parts.append(f"explains {100 * max(rate['explained'], 0.0):.0f} % of the yaw rate")
    if place and place["windows_rms"] is not None:
        parts.append(f"keeps within {100 * place['windows_rms']:.1f} cm rms of the way over {place['window_s']:g} s")
    missing = [key for key, each in t.vehicle.items() if not each.identified]
    undriven = f"No {SCENARIO}: no way forward was recorded, or none that this machine can steer."
    c = t.calibration
    return [
        *c.pieces.notes,
        f"On {m['duration_s']:.0f} s that it has not seen the twin {' and '.join(parts) or 'has nothing to show'}.",
        *doubts(t.held_out, t.scenario.tractor, scaled=True),
        *sentences(c, t.scenario.tractor),
        *advice(c.pieces.kept, missing),
        *([] if SCENARIO in t.texts else [undriven]),
    ]
