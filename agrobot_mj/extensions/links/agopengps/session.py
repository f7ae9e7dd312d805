"""Run with an external guidance program that steers the tractor through simulated boards.

The link works in cycles of one tick (50 ms): measure, send the position, process the messages of the host, steer, step.
Before the start, the tractor is at rest, and positions are sent until the host replies (or engages), because hosts need
time to detect a module. A message that arrives within 25 ms after the position acts in the same tick, a later message
in the next tick.

The GNSS and IMU board converts measurements of the simulated sensors to position sentences. The position is the
receiver solution at the antenna, with noise, latency and losses. Like a real board, the simulated board sends no
sentence without a solution. Roll and pitch come from the inertial unit if enabled. With one antenna, the heading is the
integral of the gyro, if enabled, from the true initial heading. With two antennas (`paogi`), the heading comes from the
receiver, and the last heading is repeated during a loss. Before the first heading, the board sends the sentence of a
single antenna.
"""

from collections.abc import Callable
from math import atan2, hypot, isnan, nan
from pathlib import Path
from typing import Literal, NamedTuple

from agrobot_mj.core.agopengps.position import BoardAttitude, panda, paogi
from agrobot_mj.core.agopengps.traffic import Datagram, Traffic
from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.core.nmea import DGPS_FIX, NO_FIX, RTK_FIX, RTK_FLOAT, Solution, gga, rmc, vtg
from agrobot_mj.core.signals import TICK_S, Measurement, Quality, Truth
from agrobot_mj.extensions.links.agopengps.board import Board, BoardState
from agrobot_mj.extensions.links.agopengps.channels import Channel
from agrobot_mj.extensions.links.agopengps.udp import BOARD_PORT, HOST_PORT, Incoming
from agrobot_mj.extensions.links.agopengps_guidance import Actuation, AgOpenGps
from agrobot_mj.extensions.links.running import NotBegunError, gyro_heading
from agrobot_mj.simulation.stepping import Simulation

QUALITIES = {Quality.NONE: NO_FIX, Quality.DGPS: DGPS_FIX, Quality.FLOAT: RTK_FLOAT, Quality.FIX: RTK_FIX}
"""Quality number of the NMEA sentence GGA for each receiver solution."""


class ReceiverState(NamedTuple):
    """State of the simulated GNSS and IMU board between two ticks."""

    yaw: float = nan  # Heading integrated from the gyro [rad], or NaN before the first measurement
    heading: float = nan  # Last heading from two antennas [rad], or NaN before the first heading
    solution: Solution | None = None
    fresh: bool = False  # Whether the last measurement contained a solution
    attitude: BoardAttitude = BoardAttitude()  # Attitude in the last measurement


class Receiver(NamedTuple):
    """Simulated GNSS and IMU board with the settings of a scenario."""

    spec: AgOpenGps

    def measure(self, state: ReceiverState, m: Measurement, truth: Truth, dt: float) -> ReceiverState:
        """Return the state of the board after the measurements of a tick of `dt` [s]. The heading integrated from the
        gyro starts at the true heading."""
        yaw = gyro_heading(state.yaw, m.gyro, truth.yaw, dt)
        heading = m.fix.heading if m.fix is not None and not isnan(m.fix.heading) else state.heading
        attitude = BoardAttitude(heading if self.spec.position == "paogi" else yaw, m.roll, m.pitch, m.gyro)
        solution = self._solution(m) or state.solution
        return ReceiverState(yaw, heading, solution, m.fix is not None, attitude)

    def sentence(self, state: ReceiverState, t: float) -> bytes | None:
        """Return the position sentence at time `t` [s], or None if there is no new solution."""
        if state.solution is None or not state.fresh:
            return None
        write = paogi if self.spec.position == "paogi" and not isnan(state.heading) else panda
        return write(state.solution._replace(t=t), state.attitude)

    def nmea(self, state: ReceiverState, t: float) -> tuple[bytes, ...]:
        """Return the NMEA sentences GGA, RMC and VTG at time `t` [s], marked as invalid unless the solution is new. The
        result is empty before the first solution."""
        if state.solution is None:
            return ()
        s = state.solution._replace(t=t, quality=state.solution.quality if state.fresh else NO_FIX)
        return gga(s), rmc(s), vtg(s)

    def _solution(self, m: Measurement) -> Solution | None:
        if m.fix is None:
            return None
        origin = Origin(self.spec.origin_lat_deg, self.spec.origin_lon_deg)
        latitude, longitude = to_geodetic(origin, m.fix.x, m.fix.y)
        motion = hypot(m.fix.vx, m.fix.vy), atan2(m.fix.vy, m.fix.vx)
        return Solution(m.t, latitude, longitude, m.fix.z, *motion, QUALITIES[m.quality])


PROGRAMS = {"agopengps": ("AgIO", "its guidance program"), "agopenweb": ("AgOpenWeb", "its guidance")}
"""Names, by dialect, of the program that sends hello messages and of the program that sends steering messages."""
PATIENCE_S = 5.0  # Waiting time after which a message with the name of the missing program is printed [s]


class NoHostError(NotBegunError):
    """Exception for a guidance program that does not reply in time."""


class LinkOptions(NamedTuple):
    """Options of a run over a link, in addition to the scenario."""

    address: str = "127.0.0.1"
    port: int = BOARD_PORT
    host_port: int = HOST_PORT
    replay: Path | None = None  # Recorded session to replay instead of a host, or None for a host
    start: Literal["heard", "engaged", "now"] = "heard"
    """Event that starts the clock of the run: first host message, engagement of the host, or opening of the link."""
    wait_s: float = 60.0  # Maximum time to wait for the start event [s]
    nmea: tuple[str, int] | None = None
    """Address and port for additional NMEA sentences (GGA, RMC, VTG), or None to send no additional sentences."""
    pace: Literal["answered"] | float = 1.0
    """Simulated time divided by wall-clock time [-], at most 1, or `answered` for a pace set by the host's replies."""
    live: bool = False  # Whether observers receive rows during the run, and not only at its end
    recorded: bool = True
    notify: Callable[[str], None] = lambda text: None


class Session:
    """Run with a guidance program over a channel. The method `run` may only be called once."""

    def __init__(self, sim: Simulation, board: Board, channel: Channel, options: LinkOptions) -> None:
        self.sim, self.board, self.channel, self.options = sim, board, channel, options
        self.spec: AgOpenGps = board.spec
        self.traffic = Traffic()
        self.receiver, self.state = Receiver(self.spec), board.init()
        self.received = ReceiverState()
        self.turn, self.started, self.engaged_ticks, self.latched_ticks = 0, -1, 0, 0
        self.ended: str | None = None
        """Outcome of the run determined by the link, or None if the simulation determines the outcome."""

    @property
    def now(self) -> float:
        """Board time: simulated time since the link was opened [s]."""
        return self.turn * TICK_S

    def run(self, should_stop: Callable[[], bool] = lambda: False, tell: Callable[[], None] = lambda: None) -> None:
        """Simulate to the end and call `tell` after each tick. Raises `NoHostError` if no host replies in time."""
        measured = self._measure(self.sim.reset())
        while not self.sim.done and not should_stop():
            before = self.state
            actuation = self._turn(measured)
            waits = self.started < 0 and not self._starts(actuation)
            self._tell(before)
            self.turn += 1
            if waits:
                continue
            measured = self._measure(self.sim.drive(actuation))
            tell()
            self.engaged_ticks += actuation.engaged
            self.latched_ticks += self.board.refuses(self.state)
            if self._host_is_gone():
                self.ended = "host_lost"
                return
        if self.started < 0:
            raise NoHostError(f"interrupted before the first reply from a guidance program{self._missing()}")
        if not self.sim.done:
            return
        if self.state.silent and self.state.tally.lost:
            self.ended = "host_lost"
        elif self.board.refuses(self.state):
            self.ended = "latched"
        elif not self.engaged_ticks:
            self.ended = "not_engaged"

    def _measure(self, measured: Measurement) -> Measurement:
        self.received = self.receiver.measure(self.received, measured, self.sim.truth, TICK_S)
        return measured

    def _turn(self, measured: Measurement) -> Actuation:
        for incoming in self.channel.begin(self.turn):
            self._take(incoming)
        heard = self.state.tally.steer_data
        positioned = self._position_is_due() and self._position()
        for incoming in self.channel.rest(self.turn, lambda: not positioned or self.state.tally.steer_data > heard):
            self._take(incoming)
        self.state, actuation = self.board.tick(self.state, self.now, measured.steer)
        self.state, report = self.board.report_if_due(self.state, self.now)
        for answer in report:
            self._send(answer)
        return actuation

    def _tell(self, before: BoardState) -> None:
        after, refuses = self.state, self.board.refuses
        when = f"{(self.turn - self.started) * TICK_S:.1f} s" if self.started >= 0 else "before the run"
        if refuses(after) and not refuses(before):
            back = "is back" if after.tally.lost else "is engaged already"
            self.options.notify(
                f"{when}: the host {back}, but the board is latched; switch its autosteer button off and on"
            )
        elif after.tally.lost != before.tally.lost and not after.engaged:
            self.options.notify(f"{when}: the host is silent{'; the board has disengaged' if before.engaged else ''}")
        elif after.engaged != before.engaged:
            self.options.notify(f"{when}: the host {'has engaged' if after.engaged else 'has disengaged'}")

    def _position_is_due(self) -> bool:
        return self.turn % round(1 / (self.spec.position_rate_hz * TICK_S)) == 0

    def _position(self) -> bool:
        sentence = self.receiver.sentence(self.received, self.now)
        if sentence is not None:
            self._send(sentence)
        if self.options.nmea is not None:
            for each in self.receiver.nmea(self.received, self.now):
                self._send(each, self.options.nmea)
        return sentence is not None

    def _take(self, incoming: Incoming) -> None:
        self.traffic.add(Datagram(self.turn, incoming.wall, "in", incoming.address, incoming.data))
        self.state, answers = self.board.receive(self.state, incoming.data, self.now, incoming.wall, incoming.quiet)
        for answer in answers:
            self._send(answer)

    def _send(self, data: bytes, target: tuple[str, int] | None = None) -> None:
        wall, address = self.channel.send(data, target)
        self.traffic.add(Datagram(self.turn, wall, "out", address, data))

    def _starts(self, actuation: Actuation) -> bool:
        heard = self.state.tally.steer_data > 0
        ready = {"now": True, "heard": heard, "engaged": actuation.engaged}[self.options.start]
        if ready and self._position_is_due():
            self.started = self.turn
            self.options.notify(f"the run starts, {self.now:.1f} s after the link")
            return True
        if self.now > self.options.wait_s:
            what = "has engaged" if heard else "has answered"
            raise NoHostError(
                f"no guidance program {what} within {self.options.wait_s:g} s{self._missing()}; "
                "see docs/extensions/links/link.md for its settings"
            )
        if self.turn == round(PATIENCE_S / TICK_S):
            self.options.notify(f"waiting for a guidance program{self._missing()}")
        return False

    def _missing(self) -> str:
        tally, (carrier, program) = self.state.tally, PROGRAMS[self.spec.host]
        if tally.steer_data:
            return f": {program} answers, but has not engaged"
        if tally.hellos:
            heard = f"{carrier} answers ({tally.hellos} hellos)"
            return f": {heard}, but {program} does not; open {program} and switch its simulator off"
        return ""

    def _host_is_gone(self) -> bool:
        silence = self.now - self.state.heard_at
        return self.state.tally.lost > 0 and self.state.silent and silence > self.spec.give_up_s
