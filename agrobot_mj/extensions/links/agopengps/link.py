"""Implementation of `agrobot-mj link`: open the channel, run, and write `link.parquet` and the files of the run."""

import tomllib
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq

from agrobot_mj.core.agopengps.messages import SteerData
from agrobot_mj.core.agopengps.traffic import Datagram, read_traffic, recorded_scenario
from agrobot_mj.core.agopengps.wire import decode
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.links.agopengps.board import LOOPBACK, Board
from agrobot_mj.extensions.links.agopengps.channels import Answered, Channel, RealTime, Replayed
from agrobot_mj.extensions.links.agopengps.session import LinkOptions, Session
from agrobot_mj.extensions.links.agopengps.udp import UdpSockets, address_of
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps
from agrobot_mj.extensions.links.running import run_session
from agrobot_mj.metrics.base import rms
from agrobot_mj.scenario.overrides import flat
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import Watcher
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.simulation.storage import write_log

FREE = ("name", "title", "version", "expected_outcome", "expected_reason", "duration_s")
"""Scenario keys that may differ between a replay and its record."""


class LinkRun(NamedTuple):
    """Finished run over a link."""

    log: Log
    session: Session


def link(
    scenario: Scenario,
    folder: Path,
    options: LinkOptions,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> Log:
    """Run a scenario with a host and write into `folder`. Raises `ScenarioError`, or `NoHostError` without a host."""
    o, own = options, LOOPBACK
    _keys(scenario)
    with ExitStack() as stack:
        channel: Channel
        if o.replay is not None:
            channel = Replayed(read_traffic(o.replay))
            _check_recorded(o.replay, scenario)
        else:
            sockets = stack.enter_context(UdpSockets(o.address, o.port, o.host_port))
            own = sockets.address
            o.notify(f"boards on {o.address}:{o.port}, host expected on {o.address}:{o.host_port}")
            channel = Answered(sockets) if o.pace == "answered" else RealTime(sockets)
        done = run_link(scenario, channel, o, watchers, should_stop, own)
    table = done.session.traffic.table(done.session.started, scenario.portable()[0])
    traffic = {"link.parquet": lambda path: pq.write_table(table, path, compression="zstd")}
    write_log(done.log, folder, traffic, o.recorded)
    return done.log


def run_link(
    scenario: Scenario,
    channel: Channel,
    options: LinkOptions,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
    address: tuple[int, int, int, int] = LOOPBACK,
) -> LinkRun:
    """Run a scenario with guidance `agopengps` over a channel without writing files.

    `address` is the address of the boards, reported to a scanning host. Raises `ScenarioError` for any other guidance,
    and `NoHostError` if no host replies.
    """
    unit = scenario.sensors.imu.enabled or scenario.sensors.gyro.enabled
    board = Board(_keys(scenario), scenario.tractor.steer_limit, unit, address)
    session = Session(Simulation(scenario), board, channel, options)
    told = options.live or channel.pace is None
    log = run_session(session, lambda log: {"link": link_metrics(session, log)}, watchers, should_stop, told)
    for line in health(log.metrics["link"]):
        options.notify(line)
    return LinkRun(log, session)


def _keys(scenario: Scenario) -> AgOpenGps:
    if not isinstance(scenario.guidance, AgOpenGps):
        kind = scenario.guidance.kind
        raise ScenarioError(f'guidance.kind: "{kind}" is not supported by a link; set it to "agopengps"')
    return scenario.guidance


def _check_recorded(path: Path, scenario: Scenario) -> None:
    there, here = dict(flat(recorded_scenario(path))), dict(flat(tomllib.loads(scenario.portable()[0])))
    other = [key for key in there.keys() & here.keys() if there[key] != here[key] and key not in FREE]
    if other:
        key = min(other)
        more = f" (and {len(other) - 1} more)" if len(other) > 1 else ""
        raise ScenarioError(
            f"--replay {path}: the record has {key} = {there[key]!r}, but the scenario has {here[key]!r}{more}; "
            "replay it with the scenario.toml and the overrides of its run"
        )


def endpoint(text: str, option: str) -> tuple[str, int]:
    """Return address and port of a text such as `127.0.0.1:10110`. Raises `ScenarioError` for invalid text."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdigit() or not 1 <= int(port) <= 65535:
        raise ScenarioError(f"{option} {text}: write address and port, for example 127.0.0.1:10110")
    return str(address_of(host, option)), int(port)


POSITIONS = (b"$PANDA", b"$PAOGI")
"""First bytes of a position message for the host."""
SETTLED_M = 0.1
"""Distance from the host's line below which the tractor has settled [m]."""
LATE_S = 20.0
"""Time after the first engagement at which the late part of a run starts [s]."""
LEAST_PACE, LEAST_ANSWERED = 0.95, 0.9
"""Minimum real-time factor and minimum fraction of answered positions of a working link [-]."""


def latencies(record: list[Datagram]) -> list[float]:
    """Return the wall-clock time from each position to the next steering message [s]."""
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
    """Return the number of positions sent from the last one before the host's first steering message onwards."""
    heard = next((k for k, datagram in enumerate(record) if _steers(datagram)), None)
    return 0 if heard is None else any(map(_is_position, record[:heard])) + sum(map(_is_position, record[heard:]))


def _is_position(datagram: Datagram) -> bool:
    return datagram.direction == "out" and datagram.data.startswith(POSITIONS)


def _steers(datagram: Datagram) -> bool:
    return datagram.direction == "in" and isinstance(decode(datagram.data), SteerData)


def cross_track(log: Log) -> dict[str, float | None]:
    """Return cross-track metrics of the host while it steers: RMS, RMS of the late part [m], settling time [s].

    Times are measured from the first engagement. A value is None if the error has not settled or without samples.
    """
    engaged, off = log.column("link_engaged") > 0, log.column("link_cross_track")
    if not engaged.any():
        return dict.fromkeys(("cross_track_rms", "cross_track_late_rms", "cross_track_settled_s"))
    t = log.column("t") - log.column("t")[int(np.argmax(engaged))]
    known = engaged & ~np.isnan(off)
    beyond = np.flatnonzero(known & (np.abs(off) >= SETTLED_M))
    after = t[known & (t > (t[beyond[-1]] if len(beyond) else -1.0))]
    return {
        "cross_track_rms": rms(off[known]),
        "cross_track_late_rms": rms(off[known & (t > LATE_S)]),
        "cross_track_settled_s": float(after[0]) if len(after) else None,
    }


def health(block: dict[str, Any]) -> list[str]:
    """Return one line of text for each problem in the metrics of a link."""
    found = []
    if (pace := block.get("real_time_factor", 1.0)) < LEAST_PACE:
        found.append(f"the run was slow, {pace:.2f} x real time; for the host the tractor stops between messages")
    if (share := block["answered_fraction"]) is not None and share < LEAST_ANSWERED:
        found.append(f"the host answered only {share:.0%} of the positions; check the load of its computer")
    if block["latched_s"]:
        found.append(f"for {block['latched_s']:.1f} s the host reported active steering, but the board was latched")
    return found


def link_metrics(session: Session, log: Log) -> dict[str, Any]:
    """Return the block `link`. For a replayed session, wall-clock times are those of the live run."""
    channel = session.channel
    record = channel.record if isinstance(channel, Replayed) else session.traffic.kept
    tally, spec = session.state.tally, session.spec
    ticks = max(session.turn - max(session.started, 0), 1)
    answers, since = latencies(record), positions_since_heard(record)
    span = max((d.wall for d in record), default=0.0) - min((d.wall for d in record), default=0.0)
    return {
        "host": spec.host,
        "steer_by": spec.steer_by,
        "positions": sum(map(_is_position, record)),
        "steer_messages": tally.steer_data,
        "steer_messages_hz": tally.steer_data / span if span > 0 else None,
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
        "turns": pace.turns,
        "late_turns": pace.late,
        "worst_lateness_ms": pace.worst * 1e3,
        "slipped_s": pace.slipped,
        "real_time_factor": pace.turns * pace.period / max(pace.turns * pace.period + pace.slipped, 1e-9),
    }
