"""Run the small guidance host on this computer: `python examples/agopengps_host/host.py --help`.

The host listens on the UDP port of AgOpenGPS programs and steers along one straight line. It ends a few seconds after
the last position, or after --duration.
"""

import argparse
import sys
import time
from math import radians

from guide import AbLine, Guide, GuideState, HostSettings

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geodesy import Origin
from agrobot_mj.extensions.links.agopengps.udp import BOARD_PORT, HOST_PORT, UdpSockets

IDLE_S = 5.0
"""Default time without positions after which the host exits [s]."""
SLICE_S = 0.2
"""Period of the exit checks [s]."""


def parser() -> argparse.ArgumentParser:
    """Return the command-line parser."""
    d = HostSettings()
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("--law", choices=("pure_pursuit", "stanley"), default=d.law)
    p.add_argument("--line", type=float, nargs=3, default=d.line, metavar=("X", "Y", "HEADING_DEG"))
    p.add_argument("--origin", type=float, nargs=2, default=d.origin)
    p.add_argument("--wheelbase", type=float, default=d.wheelbase, help="[m]")
    p.add_argument("--antenna-height", type=float, default=d.antenna_height, help="[m]")
    p.add_argument("--look-ahead", type=float, default=d.look_ahead, help="[s]")
    p.add_argument("--hold", type=float, default=d.hold, help="[m], in place of --look-ahead")
    p.add_argument("--multiplier", type=float, default=d.multiplier, help="of --hold and the speed [km/h / 20]")
    p.add_argument("--integral", type=float, default=d.integral, help="[rad/(m s)]")
    p.add_argument("--side-hill", type=float, default=d.side_hill, help="steering per roll [-]")
    p.add_argument("--engage-after", type=float, default=d.engage_after, help="[s] after the heading is known")
    p.add_argument("--dialect", choices=("agopengps", "agopenweb"), default=d.dialect)
    p.add_argument("--board", type=int, nargs=3, metavar=("KP", "HIGH_PWM", "MIN_PWM"), help="settings for the board")
    p.add_argument("--port", type=int, default=HOST_PORT, help="own port")
    p.add_argument("--board-port", type=int, default=BOARD_PORT)
    p.add_argument("--duration", type=float, default=3600.0, help="maximum duration [s]")
    p.add_argument("--idle", type=float, default=IDLE_S, help="end this long after the last position [s]")
    return p


def settings_of(a: argparse.Namespace) -> HostSettings:
    """Return the settings of the host from parsed command-line arguments."""
    x, y, heading_deg = a.line
    given = {name: value for name, value in vars(a).items() if name in HostSettings._fields}
    return HostSettings(**given)._replace(line=AbLine(x, y, radians(heading_deg)), origin=Origin(*a.origin))


def serve(guide: Guide, sockets: UdpSockets, duration: float, idle: float) -> GuideState:
    """Reply to position messages, and return the last state of the guidance program. The function returns after
    `duration` [s], or `idle` [s] after the last position.
    """
    state, end, heard = GuideState(), time.perf_counter() + duration, float("inf")
    while (now := time.perf_counter()) < min(end, heard + idle):
        for received in sockets.receive(now + SLICE_S):
            before = state.t
            state, answers = guide.receive(state, received.data, received.wall)
            heard = received.wall if state.t != before else heard
            for answer in answers:
                sockets.send(answer)
    return state


def main(arguments: list[str] | None = None) -> int:
    """Run the host with command-line arguments, and return the exit status."""
    a = parser().parse_args(arguments)
    try:
        with UdpSockets("127.0.0.1", a.port, a.board_port) as sockets:
            print(f"host on 127.0.0.1:{a.port}, boards on 127.0.0.1:{a.board_port}", file=sys.stderr, flush=True)
            state = serve(Guide(settings_of(a)), sockets, a.duration, a.idle)
    except ScenarioError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 0
    print(f"host: {'engaged at the end' if state.engaged else 'not engaged at the end'}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
