"""A replay in a few lines, and what about it should make the reader doubt."""

from collections.abc import Iterator
from math import degrees
from typing import Any

import numpy as np

from agrobot_mj.extensions.logs.replay.result import ReplayResult
from agrobot_mj.machine.tractor import TractorParameters

FOLLOWED = 0.05
"""Residual of the speed over the mean speed beyond which the plant does not follow it [-]."""
SAME_GAIN = 0.05
"""Error of scale and wheelbase together beyond which they are told [-]: what owners measure to."""
SLIPLESS = 0.5
"""Residual of wheels without slip over that of the plant below which no scale is to blame, but the plant [-]."""
JUDGED_S = 10.0
"""Time from which on a gain is judged [s]: a bend or two."""
WRONG_GAIN = 3.0
"""Gain beyond which no scale of a sensor is off, but a unit [-]."""
SAME_WAY_M, SAME_LENGTH, SAME_UNIT = 0.05, 0.01, 0.2
"""Error of the way in a window that is doubtful [m], and of its length [-]: what guidance itself errs by, slip, and
what no slip is."""


def summary(found: ReplayResult, tractor: TractorParameters) -> str:
    """The numbers in a few lines."""
    m = found.metrics
    lines = [*found.notes]
    lines.append(
        f"{m['log']}: {m['duration_s']:.1f} s, {m['way_m']:.0f} m on the {m['plant']} plant, by {m['steered_by']}"
    )
    if rate := m["yaw_rate"]:
        slipless = rate["kinematic_rms_without_bias"]
        beside = f" (without slip {degrees(slipless):.3f})" if slipless is not None else ""
        lines.append(
            f"yaw rate ({rate['source']}): residual {degrees(rate['rms_without_bias']):.3f} deg/s rms{beside}, "
            f"bias {degrees(rate['bias']):+.3f} deg/s, recorded {rate['lag_s']:+.3f} s after the plant"
        )
    if place := m["position"]:
        shape = "-" if place["windows_rms"] is None else f"{place['windows_rms']:.3f} m"
        lines.append(
            f"position: {shape} rms in windows of {place['window_s']:g} s; open loop {place['rms']:.2f} m rms, "
            f"{place['at_the_end']:.2f} m at the end"
        )
    return "\n".join([*lines, *doubts(found, tractor)])


def doubts(found: ReplayResult, tractor: TractorParameters, scaled: bool = False) -> Iterator[str]:
    """What the plant could not do, and what the map may have wrong; `scaled` if the steering has a fitted scale."""
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
    """Why the yaw rates may differ."""
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
        "the wheelbase, then `agrobot-mj calibrate`"
    )


def _way_doubts(place: dict[str, Any] | None) -> Iterator[str]:
    """What the position says, whatever share of the yaw rate is explained: that counts bends, not where they lead."""
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
