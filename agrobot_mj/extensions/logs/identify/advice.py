"""What to drive, so that a log tells what it does not tell yet."""

from collections.abc import Collection, Sequence
from math import degrees

import numpy as np

from agrobot_mj.core.signals import Array
from agrobot_mj.extensions.logs.recording import FieldRecording

FAST_M_S = 2.5
"""Speed from which on stiffnesses show beside the errors of scale and wheelbase. Estimate: K u^2 is some per cent."""
TWO_SPEEDS = 1.5
"""Ratio of the fast to the slow speeds of a log from which on it has two [-]."""
TIGHT = 0.15
"""Curvature from which on a bend is tight [1/m]: a radius of 7 m."""
QUICK_DEG_S = 10.0
"""Steering rate of quick steering [deg/s]: the 95th percentile of the log."""


def advice(recordings: Sequence[FieldRecording], missing: Collection[str]) -> list[str]:
    """Sentences on what to drive for the `missing` quantities, by their keys; none where none is missing."""
    u, rate, bend = (np.concatenate(each) for each in zip(*map(_driven, recordings), strict=True))
    slow, fast = np.percentile(np.abs(u), [10, 90])
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


def one_speed(recordings: Sequence[FieldRecording]) -> bool:
    """Whether the slow and the fast speeds of recordings are much the same."""
    slow, fast = np.percentile(np.abs(np.concatenate([_driven(each)[0] for each in recordings])), [10, 90])
    return bool(fast < TWO_SPEEDS * slow)


def _driven(recording: FieldRecording) -> tuple[Array, Array, Array]:
    """Speed [m/s], steering rate [deg/s] and yaw rate over speed [1/m] at even times of a recording."""
    t = np.arange(recording.start, recording.end, 0.1)
    u = np.interp(t, recording.speed.t, recording.speed.value)
    steer = np.interp(t, *recording.steer) if recording.steer else np.zeros(len(t))
    yaw_rate = np.interp(t, *recording.yaw_rate) if recording.yaw_rate else np.zeros(len(t))
    return u, degrees(1.0) * np.gradient(steer, 0.1), yaw_rate / np.where(np.abs(u) > 0.1, u, np.inf)
