"""Sentences about results of a log analysis: calibration, identification, replay and twin."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from math import degrees, sin, tan
from typing import Any

import numpy as np

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.logs.annotated import annotated_toml
from agrobot_mj.extensions.logs.calibrate import Calibration
from agrobot_mj.extensions.logs.identify.vehicle import IdentifiedVehicle, told_apart
from agrobot_mj.extensions.logs.pieces import TWO_SPEEDS, excitation, slow_and_fast
from agrobot_mj.extensions.logs.recording import FieldRecording
from agrobot_mj.extensions.logs.replay.result import ReplayResult
from agrobot_mj.extensions.logs.steering import MOVED_DEG, centres_differ
from agrobot_mj.extensions.logs.twin.twin import SCENARIO, Twin
from agrobot_mj.machine.tractor import COMPACT, TractorParameters

PLACES = {
    "ahead_m": ("ahead of the rear axle", "behind the rear axle"),
    "left_m": ("left of the middle", "right of the middle"),
}
"""Texts for positive and negative coordinates of the antenna, by map key."""
LIKE = {"deg": (40.0, 80.0), "rad": (1 / 80.0, 1 / 40.0)}
"""Range of the steering scale that indicates a wrong angle unit [-], by the unit in the column map."""
LOOKAHEAD_M = 2.0
"""Look-ahead distance of the pure-pursuit law for which the lateral offset due to sensor errors is reported [m]."""
FOLLOWED = 0.05
"""RMS speed residual, divided by the mean speed, above which the plant does not follow the recorded speed [-]."""
SAME_GAIN = 0.05
"""Relative error of the yaw-rate gain above which the error is reported [-], chosen larger than the relative error of
a measured wheelbase."""
SLIPLESS = 0.5
"""Residual of a model without slip, divided by the residual of the plant, below which the plant is reported as the
cause of the difference [-]."""
JUDGED_S = 10.0  # Minimum duration for evaluating a yaw-rate gain [s]: one or two bends
WRONG_GAIN = 3.0  # Yaw-rate gain above which the unit of a sensor is wrong, not its scale [-]
SAME_WAY_M, SAME_LENGTH, SAME_UNIT = 0.05, 0.01, 0.2
"""Limits above which errors are reported: position error in a window [m], and relative error of the track length [-]. A
track-length error above the third limit indicates a wrong unit [-]."""
FAST_M_S = 2.5
"""Minimum speed for identifying stiffnesses [m/s]. Assumed value, at which the understeer gradient times the squared
speed is a few per cent of the wheelbase."""
TIGHT = 0.15  # Minimum curvature of a tight bend [1/m]: a radius of 7 m
QUICK_DEG_S = 10.0  # 95th percentile of the steering rate above which steering counts as quick [deg/s]


def sentences(c: Calibration, tractor: TractorParameters) -> list[str]:
    """Return sentences about the results of a calibration."""
    found = [*_centre(c, tractor), *_scale(c, tractor), *_ages(c), *_places(c)]
    if (largest := degrees(c.largest_angle)) > tractor.steer_limit_deg:
        found.append(
            f"The steering angle reaches {largest:.0f} deg, but tractor.steer_limit_deg is "
            f"{tractor.steer_limit_deg:g}; increase the limit."
        )
    if centres_differ(c.centres, c.rough):
        return found
    return [*found, *advice(c.pieces.kept, [key for key, each in c.found.items() if not each.identified])]


def map_lines(c: Calibration) -> str:
    """Return the calibrated column map as TOML text, with the intervals of estimated values as comments."""
    notes = {key: " to ".join(each.ends) for key, each in c.found.items() if each.identified}
    data = c.calibrated.model_dump(mode="json", exclude_defaults=True, exclude_none=True)
    for table, _, name in (key.partition(".") for key in notes):
        data[table].setdefault(name, getattr(getattr(c.calibrated, table), name))  # a value may be the default
    return annotated_toml(data, notes)


def _centre(c: Calibration, tractor: TractorParameters) -> Iterator[str]:
    centre, given, off = c.found["steer.offset"], c.steer.offset, c.centre_error
    if centres_differ(c.centres, c.rough):
        first, second = (each.value for each in c.centres)
        yield (
            f"The steering centre changes from {first:.3g} in the first half of the drive to {second:.3g} in the "
            "second. If the sensor has slipped, calibrate the time before and the time after separately (--from, --to)."
        )
    elif "offset" not in c.steer.model_fields_set:
        yield f"The steering centre is about {centre.text}{_unit(c)}."
    elif not centre.excludes(given):
        low, high = centre.ends
        text = f"{centre.text}{_unit(c)} ({low} to {high})"
        yield f"The steering centre of {given:g} in the map agrees with the log: {text}."
    else:
        turned = c.heading_error if c.heading_error is not None else 0.0
        left = tan(off) * LOOKAHEAD_M**2 / (2 * tractor.wheelbase_m) - LOOKAHEAD_M * sin(turned)
        yield (
            f"The steering centre is about {centre.text}{_unit(c)}, but the map has {given:g}. The wheels point "
            f"{abs(degrees(off)):.1f} deg further to the {_side(off)} than in the map, so that pure pursuit with a "
            f"look-ahead distance of {LOOKAHEAD_M:g} m drives {abs(100 * left):.0f} cm to the {_side(left)} of its line"
            f"{' (with the heading error)' if turned else ''}."
        )


def _scale(c: Calibration, tractor: TractorParameters) -> Iterator[str]:
    scale, given = c.found["steer.scale"], c.steer
    told = given.model_fields_set
    if c.positive != given.positive:
        rather = f", but the map has {given.positive}" if "positive" in told else ""
        mirrored = c.pieces.kept[0].yaw_rate_source == "course"
        unless = []
        if mirrored:
            unless.append(
                "the east and north columns of [position] are swapped, which only a gyro or a heading can show"
            )
        if not c.pieces.signed:
            unless.append("most of the drive was in reverse, since [speed] has no sign")
        yield (
            f"The steering readings increase to the {c.positive}{rather}{', unless ' if unless else ''}"
            f"{', or '.join(unless)}."
        )
    if given.unit in LIKE and LIKE[given.unit][0] < scale.value < LIKE[given.unit][1]:
        other = "rad" if given.unit == "deg" else "deg"
        yield f'The readings seem to be in {other}; if so, set unit = "{other}" in [steer] of the map.'
    if c.two_scales:
        right = c.found["steer.scale_right"]
        yield (
            f"The steering sensor has two scales: one{_unit(c).rstrip('s')} corresponds to {scale.text} {given.unit} "
            f"on the left of the centre and to {right.text} on the right."
        )
    elif scale.excludes(given.scale):
        rather = f", but the map has {given.scale:g}" if "scale" in told else ""
        yield f"One{_unit(c).rstrip('s')} corresponds to a wheel angle of {scale.text} {given.unit}{rather}."
    wheelbase = f"{tractor.wheelbase_m:g} m."
    if "wheelbase_m" not in tractor.model_fields_set and tractor.wheelbase_m == COMPACT.wheelbase_m:
        wheelbase = f"{tractor.wheelbase_m:g} m (default)."
    yield (
        f"A log cannot separate the scale from the wheelbase: the scale is proportional to the assumed wheelbase of "
        f"{wheelbase} Measure the wheelbase."
    )


def _ages(c: Calibration) -> Iterator[str]:
    for part in ("heading", "position", "speed"):
        if (age := c.found.get(f"{part}.delay_s")) and age.identified and age.excludes(0.0):
            when = "later than the steering angle" if age.value > 0 else "earlier than the steering angle"
            yield f"The {part} is logged {age.text.lstrip('-')} s {when}."


def _places(c: Calibration) -> Iterator[str]:
    if c.heading_error is not None and c.found["heading.offset"].excludes(0.0):
        off = c.heading_error
        yield f"The logged heading points {abs(degrees(off)):.3g} deg to the {_side(off)} of the true heading."
    for key, what in PLACES.items():
        place = c.found.get(f"position.{key}")
        if place and place.identified and place.excludes(getattr(c.log_map.position, key)):
            yield f"The antenna is {place.text.lstrip('-')} m {what[place.value < 0]}, which differs from the map."


def _side(angle: float) -> str:
    return "left" if angle > 0 else "right"


def _unit(c: Calibration) -> str:
    """Return the unit of raw sensor values as text: `counts` for scaled values, otherwise the unit of the column."""
    return f" {c.steer.unit}" if c.steer.scale == 1.0 and c.found["steer.scale"].value > 0.5 else " counts"


def advice(recordings: Sequence[FieldRecording], missing: Collection[str]) -> list[str]:
    """Return sentences about manoeuvres that identify the quantities with the keys `missing`, or an empty list."""
    (_, rate, bend), (slow, fast) = excitation(recordings), slow_and_fast(recordings)
    found = []
    if any("stiffness" in key for key in missing):
        if fast < FAST_M_S:
            found.append(
                f"The cornering stiffness requires a higher speed than the {fast:.1f} m/s of this drive: drive for two "
                f"minutes at {FAST_M_S:g} m/s or more, as fast as is safe, with bends in both directions."
            )
        elif (quick := float(np.percentile(np.abs(rate), 95))) < QUICK_DEG_S:
            found.append(
                f"To separate front and rear stiffness, steer at {QUICK_DEG_S:g} deg/s or more, back and forth every "
                f"one or two seconds; this drive has {quick:.0f} deg/s."
            )
    if any("relaxation" in key for key in missing) and fast < TWO_SPEEDS * slow:
        found.append(
            f"At a single speed ({fast:.1f} m/s) a relaxation length looks like a delay: repeat the drive at twice the "
            "speed."
        )
    if "speed.delay_s" in missing and fast < TWO_SPEEDS * slow:
        found.append("The delay of the speed requires changes of the speed: brake and accelerate a few times.")
    elif any(key.endswith(".delay_s") for key in missing):
        found.append("Delays require bends and changes of the speed: steer to both sides, slowly and fast.")
    if any(key in ("position.ahead_m", "position.left_m") for key in missing):
        sides = [float(np.mean(side * bend > TIGHT)) for side in (1, -1)]
        where = "tight circles in both directions" if min(sides) < 0.05 else "tight circles at two speeds"
        found.append(f"The antenna position requires {where}; otherwise measure it with a tape.")
    return found


def vehicle_sentences(found: IdentifiedVehicle, t: TractorParameters) -> Iterator[str]:
    """Yield sentences about the reliability of an identified vehicle and about its assumptions."""
    if not told_apart(found.found):
        yield "This log cannot separate front and rear stiffness; use the understeer gradient, which combines both."
    yield from advice(found.kept, [key for key, each in found.found.items() if not each.identified])
    if (b := found.found.get("backlash_deg")) and not b.identified:
        yield "The backlash is not larger than the noise of the recorded angle."
    yield (
        f"In the test part of the log, the fit explains {100 * found.explained:.2f} % with a residual of "
        f"{found.residual_deg_s:.3f} rms; a model without slip has {found.kinematic_deg_s:.3f} (deg/s, or m)."
    )
    yield (
        f"Assumed: mass {t.mass_kg:g} kg, yaw inertia {t.yaw_inertia_kg_m2:g} kg m2, wheelbase {t.wheelbase_m:g} m, "
        f"{100 * t.front_load_fraction:g} % of the weight on the front axle, {found.geometry}, and the scale of the "
        f"wheel angle (checked by `agrobot-mj twin --only calibrate`). The fit used {found.windows} windows of 5 s."
    )
    if found.moved:
        each = [f"{what} by {front:.2f} and {rear:.2f}" for what, (front, rear) in found.moved.items()]
        yield (
            "The intervals of front and rear stiffness do not include assumed values; these multiply the stiffnesses: "
            f"{'; '.join(each)}."
        )


def replay_sentences(found: ReplayResult, tractor: TractorParameters) -> Iterator[str]:
    """Yield lines with the results of a replay and warnings."""
    m = found.metrics
    yield from found.notes
    yield (f"{m['log']}: {m['duration_s']:.1f} s, {m['way_m']:.0f} m on the {m['plant']} plant, by {m['steered_by']}")
    cells = ((name, "-" if value is None else f"{value:.4g}", unit) for name, value, unit in replay_rows(m))
    yield markdown_table(("plant minus recording", "value", "unit"), cells, 1, aligned=True)
    yield from doubts(found, tractor)


def replay_rows(m: Mapping[str, Any]) -> Iterator[tuple[str, float | None, str]]:
    """Yield table rows with the metrics of a replay: name, value, unit."""
    if rate := m["yaw_rate"]:
        slipless = rate["kinematic_rms_without_bias"]
        yield f"yaw rate by the {rate['source']}, residual rms", degrees(rate["rms_without_bias"]), "deg/s"
        yield "yaw rate of a model without slip, residual rms", None if slipless is None else degrees(slipless), "deg/s"
        yield "yaw rate, bias", degrees(rate["bias"]), "deg/s"
        yield "yaw rate, recorded rms", degrees(rate["recorded_rms"]), "deg/s"
        yield "yaw rate, latency of the recording", rate["lag_s"], "s"
    if place := m["position"]:
        yield f"position in windows of {place['window_s']:g} s, rms", place["windows_rms"], "m"
        yield f"position in windows of {place['window_s']:g} s, 95th percentile", place["windows_p95"], "m"
        yield "position open loop, rms", place["rms"], "m"
        yield "position open loop, at the end of a segment", place["at_the_end"], "m"
    yield "speed, residual rms", m["speed_rms"], "m/s"


def doubts(found: ReplayResult, tractor: TractorParameters, scaled: bool = False) -> Iterator[str]:
    """Yield warnings about limits of the plant and errors of the column map. `scaled` states whether the scale of
    [steer] is calibrated."""
    m = found.metrics
    angles = [np.abs(recording.steer.at(driven.t)) for recording, driven in found.pieces if recording.steer]
    if angles and (largest := degrees(max(each.max() for each in angles))) > tractor.steer_limit_deg:
        share = float(np.mean(np.concatenate(angles) > tractor.steer_limit))
        yield (
            f"The recorded angle exceeds tractor.steer_limit_deg = {tractor.steer_limit_deg:g} for {100 * share:.1f} % "
            f"of the time and reaches {largest:.0f} deg; increase the limit"
        )
    mean = m["way_m"] / m["duration_s"] if m["duration_s"] else 0.0
    if m["speed_rms"] > FOLLOWED * mean:
        yield (
            f"The plant does not follow the recorded speed: the residual is {m['speed_rms']:.2f} m/s rms at a mean of "
            f"{mean:.2f} m/s; plant.kind = bicycle follows it exactly"
        )
    yield from _way_doubts(m["position"])
    if (rate := m["yaw_rate"]) and rate["source"] == "heading":
        off = degrees(rate["steer_error"])
        if abs(off) > MOVED_DEG:
            side = "right" if off > 0 else "left"
            yield (
                f"The yaw rate of the plant minus the rate of the recorded heading is {degrees(rate['bias']):+.2f} "
                f"deg/s on average. A heading has no bias, so the wheels are probably {abs(off):.1f} deg further to "
                f"the {side} than in the map: check whether the steering sensor has moved (steer.offset)"
            )
    if not (rate := m["yaw_rate"]) or rate["explained"] is None:
        return
    if rate["explained"] < 0 or (rate["gain"] or 0.0) > WRONG_GAIN:
        yield (
            "The yaw rate of the plant does not explain the recorded yaw rate: check sign (positive) and unit of "
            f"[steer], [speed] and [{'heading' if rate['source'] == 'heading' else 'yaw_rate'}] in the map"
        )
    elif rate["explained"] > 0.5 and abs(rate["gain"] - 1.0) > SAME_GAIN and m["duration_s"] > JUDGED_S:
        yield f"The machine turns {rate['gain']:.2f} times as fast as the plant: {_why(rate, scaled)}"


def _why(rate: dict[str, Any], scaled: bool) -> str:
    """Return possible causes of a difference between the yaw rates of plant and recording. `scaled` states whether the
    scale of [steer] is calibrated."""
    off, slipless = rate["rms_without_bias"], rate["kinematic_rms_without_bias"]
    if slipless is not None and slipless < (1.0 if scaled else SLIPLESS) * off:
        return (
            f"a model without slip has a smaller residual, {degrees(slipless):.2f} instead of {degrees(off):.2f} deg/s "
            "rms, so the cause is probably the plant: its tyres slip and scrub in tight bends (plant.kind = bicycle "
            "uses the angle in place of its tangent)"
        )
    if scaled:
        return "the scale of [steer] is calibrated, so the tyre parameters are probably wrong"
    return (
        "the scale of [steer], tractor.wheelbase_m or, at high speed, the tyre parameters are wrong; measure the "
        "wheelbase, then run `agrobot-mj twin --only calibrate`"
    )


def _way_doubts(place: dict[str, Any] | None) -> Iterator[str]:
    if not place or place["windows_rms"] is None or place["windows_rms"] <= SAME_WAY_M:
        return
    off = place["windows_rms"]
    yield (
        f"The plant deviates from the recorded track by {f'{100 * off:.0f} cm' if off < 1 else f'{off:.3g} m'} within "
        f"{place['window_s']:g} s, more than a typical guidance error; smaller differences between laws mean nothing"
    )
    if (off := abs(place["stretch"] - 1.0)) > SAME_LENGTH:
        unit = "check the unit of [speed] and the columns of [position] in the map"
        why = (
            unit if off > SAME_UNIT else "the scale of [speed] is wrong, or the slip differs from the slip of the plant"
        )
        yield f"The recorded track is {place['stretch']:.3f} times as long as the track of the plant: {why}"


def twin_sentences(t: Twin) -> list[str]:
    """Return sentences about the reliability and the properties of a digital twin."""
    m = t.held_out.metrics
    rate, place = m["yaw_rate"], m["position"]
    parts = []
    if rate and rate["explained"] is not None:
        parts.append(f"explains {100 * max(rate['explained'], 0.0):.0f} % of the yaw rate")
    if place and place["windows_rms"] is not None:
        error = f"{100 * place['windows_rms']:.1f} cm rms after {place['window_s']:g} s"
        parts.append(f"predicts the position with an error of {error}")
    missing = [key for key, each in t.vehicle.items() if not each.identified]
    undriven = f"No {SCENARIO} was written, because the log has no forward track that this machine can follow."
    c = t.calibration
    return [
        *c.pieces.notes,
        f"On {m['duration_s']:.0f} s of unseen data the twin {' and '.join(parts) or 'has nothing to predict'}.",
        *doubts(t.held_out, t.scenario.tractor, scaled=True),
        *sentences(c, t.scenario.tractor),
        *advice(c.pieces.kept, missing),
        *([] if SCENARIO in t.texts else [undriven]),
    ]
