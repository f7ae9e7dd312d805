"""Implementation of `agrobot-mj link`, which opens a channel, runs the scenario, and writes `link.parquet` and the
files of a run."""

import tomllib
from collections.abc import Callable
from contextlib import ExitStack
from math import nan
from pathlib import Path
from typing import Any, Literal, NamedTuple

import pyarrow.parquet as pq

from agrobot_mj.core.agopengps.traffic import SCENARIO, read_traffic
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.links.agopengps.board import LOOPBACK, Board
from agrobot_mj.extensions.links.agopengps.channels import Answered, Channel, RealTime, Replayed
from agrobot_mj.extensions.links.agopengps.link_check import CHECK_S, check_lines
from agrobot_mj.extensions.links.agopengps.link_metrics import health, link_metrics
from agrobot_mj.extensions.links.agopengps.session import LinkOptions, Session
from agrobot_mj.extensions.links.agopengps.udp import UdpSockets, address_of
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps
from agrobot_mj.extensions.links.running import run_session
from agrobot_mj.scenario.overrides import flat
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import Watcher
from agrobot_mj.simulation.stepping import Simulation
from agrobot_mj.simulation.storage import write_log

FREE = ("name", "title", "version", "expected_outcome", "expected_reason", "duration_s")
"""Scenario keys that may differ between a replay and the recorded run."""
LEAST_PACE = 0.05  # Minimum pace, which is simulated time divided by wall-clock time [-]


class LinkRun(NamedTuple):
    """Finished run that a host has steered over a link, with its log and session."""

    log: Log
    session: Session


def link(
    scenario: Scenario,
    folder: Path,
    options: LinkOptions,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
) -> Log:
    """Run a scenario steered by a host, and write the results to `folder`. Raises `ScenarioError` or `NoHostError`."""
    done = _run_connected(scenario, options, watchers, should_stop)
    table = done.session.traffic.table(done.session.started, scenario.portable()[0])
    traffic = {"link.parquet": lambda path: pq.write_table(table, path, compression="zstd")}
    write_log(done.log, folder, traffic, options.recorded)
    return done.log


def check(
    scenario: Scenario, options: LinkOptions, should_stop: Callable[[], bool] = lambda: False
) -> tuple[dict[str, Any], list[str]]:
    """Run a scenario steered by a host for `CHECK_S` seconds. Return the metrics of the link, and the results of the
    connection check as text. Raises `ScenarioError` or `NoHostError`."""
    log = _run_connected(scenario.changed({"duration_s": CHECK_S}), options, (), should_stop).log
    block = log.metrics["link"]
    return block, list(check_lines(scenario, log, block))


def _run_connected(
    scenario: Scenario, o: LinkOptions, watchers: tuple[Watcher, ...], should_stop: Callable[[], bool]
) -> LinkRun:
    """Open the channel to the host and run the scenario."""
    own = LOOPBACK
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
            channel = Answered(sockets) if o.pace == "answered" else RealTime(sockets, 1.0 / o.pace)
        return run_link(scenario, channel, o, watchers, should_stop, own)


def run_link(
    scenario: Scenario,
    channel: Channel,
    options: LinkOptions,
    watchers: tuple[Watcher, ...] = (),
    should_stop: Callable[[], bool] = lambda: False,
    address: tuple[int, int, int, int] = LOOPBACK,
) -> LinkRun:
    """Run a scenario with the guidance `agopengps` over a channel, without writing files.

    `address` is the IPv4 address of the boards, which a host receives when it scans the network. Raises `ScenarioError`
    for other guidance, and `NoHostError` if no host replies.
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
    there, here = dict(flat(_recorded_scenario(path))), dict(flat(tomllib.loads(scenario.portable()[0])))
    other = [key for key in there.keys() & here.keys() if there[key] != here[key] and key not in FREE]
    if other:
        key = min(other)
        more = f" (and {len(other) - 1} more)" if len(other) > 1 else ""
        raise ScenarioError(
            f"--replay {path}: the record has {key} = {there[key]!r}, but the scenario has {here[key]!r}{more}; "
            "replay the record with the scenario.toml and the overrides of its run"
        )


def pace_of(text: str) -> Literal["answered"] | float:
    """Convert text to a pace: `real_time`, `answered`, or a number [-]. Raises `ScenarioError` for other text."""
    if text == "answered":
        return "answered"
    try:
        pace = 1.0 if text == "real_time" else float(text)
    except ValueError:
        pace = nan
    if not LEAST_PACE <= pace <= 1.0:
        raise ScenarioError(f"--pace {text}: specify real_time, answered, or a number from {LEAST_PACE:g} to 1")
    return pace


def endpoint(text: str, option: str) -> tuple[str, int]:
    """Convert a string of the form `127.0.0.1:10110` to address and port. Raises `ScenarioError` for other strings."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdigit() or not 1 <= int(port) <= 65535:
        raise ScenarioError(f"{option} {text}: specify the address and port, for example 127.0.0.1:10110")
    return str(address_of(host, option)), int(port)


def _recorded_scenario(path: Path) -> dict[str, Any]:
    """Return the scenario in a `link.parquet` or in the `scenario.toml` next to it, or an empty mapping."""
    text = (pq.read_schema(path.absolute()).metadata or {}).get(SCENARIO)
    beside = path.absolute().with_name("scenario.toml")
    if text is None and beside.is_file():
        text = beside.read_bytes()
    try:
        return tomllib.loads((text or b"").decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError):
        return {}
