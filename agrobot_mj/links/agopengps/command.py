"""What `agrobot-mj link` does: open the channel, run, write the run's files and `link.parquet`."""

import tomllib
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Literal, NamedTuple

import pyarrow.parquet as pq

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.links.agopengps.board import LOOPBACK
from agrobot_mj.links.agopengps.channels import Answered, Channel, RealTime, Replayed
from agrobot_mj.links.agopengps.run import keys_of, run_link
from agrobot_mj.links.agopengps.session import NoHostError, Options, Start
from agrobot_mj.links.agopengps.traffic import Datagram, read_traffic, recorded_scenario
from agrobot_mj.links.agopengps.udp import BOARD_PORT, HOST_PORT, UdpSockets, address_of
from agrobot_mj.scenario.overrides import flat
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import Watcher
from agrobot_mj.simulation.storage import write_log

Pacing = Literal["real_time", "answered"]
"""The wall clock paces the run, or the host by its answers."""
HIGHEST_PORT = 65535
FREE = ("name", "title", "version", "expected_outcome", "expected_reason", "duration_s")
"""Keys in which a replay may differ from its record."""
__all__ = ["Arguments", "NoHostError", "link"]


class Arguments(NamedTuple):
    """What the command line says beside the scenario."""

    address: str = "127.0.0.1"
    """Address of the host."""
    port: int = BOARD_PORT
    """Own port."""
    host_port: int = HOST_PORT
    """Port of the host."""
    replay: Path | None = None
    """Record to drive from, in place of a host."""
    start: Start = "heard"
    wait_s: float = 60.0
    """Longest wait for the start [s]."""
    nmea: str | None = None
    """`address:port` for GGA, RMC and VTG."""
    pace: Pacing = "real_time"
    live: bool = False
    """Watchers are told as the run goes."""
    recorded: bool = True
    """Whether a watcher writes the recording."""


def link(
    scenario: Scenario,
    folder: Path,
    arguments: Arguments,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
    notify: Callable[[str], None] = lambda text: None,
) -> Log:
    """Run a scenario with a host; writes into `folder`. Raises `ScenarioError`, `NoHostError` where none answers."""
    a, own = arguments, LOOPBACK
    keys_of(scenario)
    record = _recorded(a.replay, scenario) if a.replay else None
    options = Options(a.start, a.wait_s, endpoint(a.nmea, "--nmea") if a.nmea else None, notify)
    with ExitStack() as stack:
        channel: Channel
        if record is not None:
            channel = Replayed(record)
        else:
            for option, port in (("--port", a.port), ("--host-port", a.host_port)):
                _check_port(option, port)
            sockets = stack.enter_context(UdpSockets(a.address, a.port, a.host_port))
            own = sockets.address
            notify(f"boards on {a.address}:{a.port}, host expected on {a.address}:{a.host_port}")
            channel = Answered(sockets) if a.pace == "answered" else RealTime(sockets)
        done = run_link(scenario, channel, options, watchers, should_stop, record, a.live, own)
    table = done.session.traffic.table(done.session.started, scenario.portable()[0])
    traffic = {"link.parquet": lambda path: pq.write_table(table, path, compression="zstd")}
    write_log(done.log, folder, traffic, a.recorded)
    return done.log


def _recorded(path: Path, scenario: Scenario) -> list[Datagram]:
    """The record to replay. Raises `ScenarioError` where it is none, or that of another scenario."""
    record = read_traffic(path)
    there, here = dict(flat(recorded_scenario(path))), dict(flat(tomllib.loads(scenario.portable()[0])))
    other = [key for key in there.keys() & here.keys() if there[key] != here[key] and key not in FREE]
    if other:
        key = min(other)
        more = f" (and {len(other) - 1} more)" if len(other) > 1 else ""
        raise ScenarioError(
            f"--replay {path}: recorded with {key} = {there[key]!r}, here it is {here[key]!r}{more}; "
            "replay it with the scenario.toml and the keys of its run"
        )
    return record


def endpoint(text: str, option: str) -> tuple[str, int]:
    """Address and port of `127.0.0.1:10110`. Raises `ScenarioError`."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdigit():
        raise ScenarioError(f"{option} {text}: write it as 127.0.0.1:10110")
    _check_port(option, int(port))
    return str(address_of(host, option)), int(port)


def _check_port(option: str, port: int) -> None:
    if not 1 <= port <= HIGHEST_PORT:
        raise ScenarioError(f"{option}: must be between 1 and {HIGHEST_PORT}, got {port}")
