"""The block `link` of the metrics: pure functions of a link's record and of its board's last state."""

from typing import Any

import numpy as np

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.links.agopengps.channels import Channel
from agrobot_mj.links.agopengps.messages import SteerData
from agrobot_mj.links.agopengps.session import Session
from agrobot_mj.links.agopengps.traffic import Datagram
from agrobot_mj.links.agopengps.wire import decode

POSITIONS = (b"$PANDA", b"$PAOGI")
"""Beginnings of a position for the host."""


def latencies(record: list[Datagram]) -> list[float]:
    """Wall time from each position to the first steering message after it [s]."""
    found: list[float] = []
    sent: float | None = None
    for datagram in record:
        if datagram.direction == "out" and datagram.data.startswith(POSITIONS):
            sent = datagram.wall
        elif sent is not None and datagram.direction == "in" and isinstance(decode(datagram.data), SteerData):
            found.append(datagram.wall - sent)
            sent = None
    return found


def link_metrics(session: Session, record: list[Datagram]) -> dict[str, Any]:
    """The block; `record` is that of the live run also where the session replays it."""
    tally, spec = session.state.tally, session.spec
    ticks = max(session.turn - max(session.started, 0), 1)
    positions = sum(d.direction == "out" and d.data.startswith(POSITIONS) for d in record)
    span = max((d.wall for d in record), default=0.0) - min((d.wall for d in record), default=0.0)
    return {
        "host": spec.host,
        "steer_by": spec.steer_by,
        "positions": positions,
        "steer_messages": tally.steer_data,
        "steer_messages_hz": tally.steer_data / span if span > 0 else None,
        **_latency_ms(latencies(record)),
        "engaged_s": session.engaged_ticks * TICK_S,
        "engaged_fraction": session.engaged_ticks / ticks,
        "engagements": tally.engagements,
        "outages": tally.lost,
        "silent_at_end": session.state.silent,
        "waited_s": max(session.started, 0) * TICK_S,
        "other_messages": tally.others,
        "unknown_messages": tally.unknown,
        "repeated_datagrams": tally.repeats,
        "rejected_datagrams": dict(tally.rejected),
        "not_recorded": session.traffic.dropped,
        **_pace(session.channel),
    }


def _latency_ms(values: list[float]) -> dict[str, float | None]:
    names = {"latency_ms_median": 50, "latency_ms_p95": 95, "latency_ms_worst": 100}
    return {name: float(np.percentile(values, p)) * 1e3 if values else None for name, p in names.items()}


def _pace(channel: Channel) -> dict[str, float | int]:
    if channel.pace is None:
        return {}
    pace = channel.pace
    return {
        "turns": pace.turns,
        "late_turns": pace.late,
        "worst_lateness_ms": pace.worst * 1e3,
        "slipped_s": pace.slipped,
    }
