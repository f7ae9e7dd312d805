"""Errors of pure pursuit by look-ahead and speed. `python examples/agopengps_host/look_ahead.py` prints the table.

The table is on the page link.md. Each cell contains the overshoot, and the rms lateral offset in the last 20 s, of a
run on level ground. The run starts at a lateral offset of 1 m from the line of the host, which runs in the same
process.
"""

import sys
from collections.abc import Iterator

import numpy as np
from demo import LEVEL, TWO_ANTENNAS
from guide import Guide, GuideState
from host import parser, settings_of

from agrobot_mj import load_scenario
from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.links.agopengps.link import run_link
from agrobot_mj.extensions.links.agopengps.session import LinkOptions
from agrobot_mj.extensions.links.agopengps.udp import Incoming

ADDRESS = "127.0.0.1:9999"
SPEEDS = (1.0, 2.0, 3.0, 4.0)
"""Path speeds of the table columns [m/s]."""
LOOK_AHEADS = {
    "one antenna, default settings": "--hold 3",
    "one antenna, 6 m": "--hold 6 --multiplier 0",
    "one antenna, 4 s": "--look-ahead 4",
    "two antennas, default settings": "--hold 3",
    "two antennas, 3 m": "--hold 3 --multiplier 0",
    "two antennas, 2 s": "--look-ahead 2",
}
"""Command-line arguments of the host for each table row, by name of the row."""


class Direct:
    """Connection to a host in the same process, without sockets or clock. If `cut` is true, the connection is
    interrupted."""

    pace = None

    def __init__(self, guide: Guide) -> None:
        self.guide, self.state, self.turn, self.cut = guide, GuideState(), 0, False
        self.answers: list[bytes] = []

    def begin(self, turn: int) -> Iterator[Incoming]:
        """Start a tick. Return an empty iterator, because the host sends only replies."""
        self.turn = turn
        return iter(())

    def rest(self, turn: int, answered: object) -> Iterator[Incoming]:
        """Return the replies of the host since the last call."""
        answers, self.answers = self.answers, []
        return (Incoming(turn * TICK_S, ADDRESS, answer) for answer in answers)

    def send(self, data: bytes, target: object = None) -> tuple[float, str]:
        """Send a message to the host. Return the time of sending [s] and the address of the host."""
        if not self.cut and target is None:
            self.state, answers = self.guide.receive(self.state, data, self.turn * TICK_S)
            self.answers += answers
        return self.turn * TICK_S, ADDRESS


def cell(host: str, speed: float, overrides: dict[str, object]) -> str:
    """Simulate a run. Return a table cell with the overshoot and the rms lateral offset in the last 20 s [cm]."""
    keys = {"guidance.kind": "agopengps", "path.start_offset_m": 1.0, "path.speed_m_s": speed, "duration_s": 60.0}
    scenario = load_scenario(LEVEL, {**keys, "terrain.half_size_m": 600.0, **overrides})
    log = run_link(scenario, Direct(Guide(settings_of(parser().parse_args(host.split())))), LinkOptions()).log
    t, off = log.column("t"), log.column("rear_y") * 100
    return f"{max(-off.min(), 0):.0f} / {np.sqrt(np.mean(off[t > t[-1] - 20] ** 2)):.1f}"


def main() -> None:
    """Simulate all runs and print the table."""
    rows = []
    for name, host in LOOK_AHEADS.items():
        antennas = TWO_ANTENNAS if name.startswith("two") else {}
        rows.append((name, f"`{host}`", *(cell(host, speed, antennas) for speed in SPEEDS)))
        print(*rows[-1], file=sys.stderr)
    print(markdown_table(("look-ahead", "host", *(f"{speed:g} m/s" for speed in SPEEDS)), rows))


if __name__ == "__main__":
    main()
