"""Metrics block `link`, computed from the datagrams of a link, the log, and the final state of the board."""

from typing import Any

import numpy as np

from agrobot_mj.core.agopengps.messages import SteerData
from agrobot_mj.core.agopengps.traffic import Datagram
from agrobot_mj.core.agopengps.wire import decode
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.links.agopengps.channels import Channel, Replayed
from agrobot_mj.extensions.links.agopengps.session import Session
from agrobot_mj.metrics.base import rms
from agrobot_mj.metrics.crosstrack import cross_track as path_offset
from agrobot_mj.simulation.log import Log

POSITIONS = (b"$PANDA", b"$PAOGI")  # First bytes of position messages sent to the host
SETTLED_M = 0.1  # Distance from the line of the host below which the tractor has settled [m]
LATE_S = 20.0  # Time from the first engagement to the start of the late part of a run [s]
SHIFT_M = 0.1
"""Maximum mean difference between true and reported cross-track error without a warning [m]. Assumed value: five times
the resolution in messages of AgOpenGPS."""
LEAST_PACE, LEAST_ANSWERED = 0.95, 0.9
"""Minimum real-time factor and minimum fraction of answered positions for a link without warnings [-]."""


def latencies(record: list[Datagram]) -> list[float]:
    """Return the wall-clock times [s] from each position to the following steering message."""
    found: list[float] = []
    sent: float | None = None
    for datagram in record:
        if _is_position(datagram):
            sent = datagram.wall
        elif sent is not None and _steers(datagram):
            found.append(datagram.wall - sent)
            sent = None
    return found


def positions_since_heard(record: list[Datagram]) -> int:
    """Return the number of positions that the host could answer: the last position before its first steering message,
    and all later positions."""
    heard = next((k for k, datagram in enumerate(record) if _steers(datagram)), None)
    return 0 if heard is None else any(map(_is_position, record[:heard])) + sum(map(_is_position, record[heard:]))


def steering_rate(record: list[Datagram]) -> float | None:
    """Return the mean number of steering messages per wall time [1/s] from the first to the last steering message, or
    None for fewer than two messages."""
    times = [datagram.wall for datagram in record if _steers(datagram)]
    span = times[-1] - times[0] if times else 0.0
    return (len(times) - 1) / span if span > 0 else None


def _is_position(datagram: Datagram) -> bool:
    return datagram.direction == "out" and datagram.data.startswith(POSITIONS)


def _steers(datagram: Datagram) -> bool:
    return datagram.direction == "in" and isinstance(decode(datagram.data), SteerData)


def cross_track(log: Log) -> dict[str, float | None]:
    """Return metrics of the cross-track error that the host reports while it steers.

    The metrics are the RMS of this error [m], its RMS in the late part of the run [m], the settling time [s], and the
    mean of true minus reported error in the late part [m]. Errors are positive to the left. Times start at the first
    engagement. Metrics are None without samples, or if the error has not settled.
    """
    engaged, off = log.column("link_engaged") > 0, log.column("link_cross_track")
    if not engaged.any():
        return dict.fromkeys(("cross_track_rms", "cross_track_late_rms", "cross_track_settled_s", "cross_track_offset"))
    true = path_offset(log.scenario.path, log.column("t"), log.column("rear_x"), log.column("rear_y"))
    t = log.column("t") - log.column("t")[int(np.argmax(engaged))]
    known = engaged & ~np.isnan(off)
    beyond = np.flatnonzero(known & (np.abs(off) >= SETTLED_M))
    after = t[known & (t > (t[beyond[-1]] if len(beyond) else -1.0))]
    shift = (true - off)[known & (t > LATE_S) & ~np.isnan(true)]
    return {
        "cross_track_rms": rms(off[known]),
        "cross_track_late_rms": rms(off[known & (t > LATE_S)]),
        "cross_track_settled_s": float(after[0]) if len(after) else None,
        "cross_track_offset": float(shift.mean()) if len(shift) else None,
    }


def health(block: dict[str, Any]) -> list[str]:
    """Return a warning text for each metric of the link that is outside its limits. `block` contains the metrics."""
    found = []
    asked = block.get("pace", 1.0)
    if (pace := block.get("real_time_factor", asked)) < LEAST_PACE * asked:
        found.append(f"the run was slow ({pace:.2f} x real time), so the host receives positions at long intervals")
    if (share := block["answered_fraction"]) is not None and share < LEAST_ANSWERED:
        found.append(
            f"the host answered only {100 * share:.0f} % of the positions; check the load of its computer, or use "
            f"--pace {asked / 2:g}"
        )
    if block["latched_s"]:
        found.append(f"for {block['latched_s']:.1f} s the host reported active steering, but the board was latched")
    if (shift := block.get("cross_track_offset")) is not None and abs(shift) > SHIFT_M:
        side = "left" if shift > 0 else "right"
        found.append(
            f"the rear axle is {100 * abs(shift):.0f} cm {side} of its position in the host; compare the host's line, "
            "roll correction and antenna position with the scenario"
        )
    return found


def link_metrics(session: Session, log: Log) -> dict[str, Any]:
    """Return the metrics block `link`. The wall-clock times of a replayed session come from the recorded run."""
    channel = session.channel
    record = channel.record if isinstance(channel, Replayed) else session.traffic.kept
    tally, spec = session.state.tally, session.spec
    ticks = max(session.turn - max(session.started, 0), 1)
    answers, since = latencies(record), positions_since_heard(record)
    return {
        "host": spec.host,
        "steer_by": spec.steer_by,
        "positions": sum(map(_is_position, record)),
        "steer_messages": tally.steer_data,
        "steer_messages_hz": steering_rate(record),
        "answered_fraction": min(len(answers) / since, 1.0) if since else None,
        **_latency_ms(answers),
        **cross_track(log),
        "engaged_s": session.engaged_ticks * TICK_S,
        "engaged_fraction": session.engaged_ticks / ticks,
        "latched_s": session.latched_ticks * TICK_S,
        "engagements": tally.engagements,
        "outages": tally.lost,
        "silent_at_end": session.state.silent,
        "waited_s": max(session.started, 0) * TICK_S,
        "hellos": tally.hellos,
        "other_messages": tally.others,
        "unknown_messages": tally.unknown,
        "repeated_datagrams": tally.repeats,
        "rejected_datagrams": dict(tally.rejected),
        "not_recorded": session.traffic.dropped,
        **_pace(channel),
    }


def _latency_ms(values: list[float]) -> dict[str, float | None]:
    names = {"latency_ms_median": 50, "latency_ms_p95": 95, "latency_ms_worst": 100}
    return {name: float(np.percentile(values, p)) * 1e3 if values else None for name, p in names.items()}


def _pace(channel: Channel) -> dict[str, float | int]:
    if channel.pace is None:
        return {}
    pace = channel.pace
    return {
        "pace": TICK_S / pace.period,
        "turns": pace.turns,
        "late_turns": pace.late,
        "worst_lateness_ms": pace.worst * 1e3,
        "slipped_s": pace.slipped,
        "real_time_factor": pace.turns * TICK_S / max(pace.turns * pace.period + pace.slipped, 1e-9),
    }
