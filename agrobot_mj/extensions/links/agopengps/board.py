"""The steer module: datagrams in, answers and steering out; no sockets, no clock of its own.

The board steers while the host's messages come with the "engaged" bit of its dialect. When they cease for the
watchdog's time it lets go. After the time of the latch, and at power-up, it stays released until a message without that
bit was seen: a host that comes back is often still engaged and would ask for full lock. The set point lives while not
engaged, so only the bit counts.

A datagram identical to the one before it and less than 1 ms younger is the same one on another route.

Angles in rad, left positive, except inside the board's own arithmetic, which is in degrees, right positive, as on the
wire. The motor's PWM (-255 to 255, left positive here) becomes the voltage of our valve. The offset of message 252 is
added to the sensor's reading by AgOpenGPS boards, since that program's zero button sends the offset it has less the
counts of the angle shown; a module of AgOpenWeb takes it away, whose zero button adds them.
"""

from math import degrees, inf, nan, radians
from typing import NamedTuple

from agrobot_mj.control.pid import clip
from agrobot_mj.core.agopengps.layouts import cross_track_of
from agrobot_mj.core.agopengps.messages import (
    IMU,
    STEER,
    Hello,
    HelloReply,
    Message,
    Scan,
    ScanReply,
    SteerConfig,
    SteerData,
    SteerSettings,
    SteerState,
)
from agrobot_mj.core.agopengps.wire import Rejected, Unknown, decode, encode
from agrobot_mj.core.signals import NEUTRAL_V
from agrobot_mj.extensions.links.agopengps_guidance import Actuation, AgOpenGps

FULL_PWM = 255
"""Full output of the motor driver [PWM counts]."""
SOFT_ZONE_DEG = 3.0
"""Error below which the limit of the PWM falls in proportion [deg]. As AgOpenGPS boards."""
LOW_OVER_MIN = 1.2
"""Limit at zero error over the least PWM [-]. As AgOpenGPS boards."""
OFFSET_SIGN = {"agopengps": 1, "agopenweb": -1}
"""Sign with which the offset is added to the reading of the sensor, by dialect."""
INVERT_SENSOR, INVERT_MOTOR = 0x01, 0x04
"""Bits of `SteerConfig.set0`."""


def counts_of(steer: float, per_degree: int, config: SteerConfig) -> float:
    """Reading of the sensor [counts] at a steering angle, with its true scale [counts/deg]."""
    counts = -degrees(steer) * per_degree
    return -counts if config.set0 & INVERT_SENSOR else counts


def angle_of(counts: float, settings: SteerSettings, host: str) -> float:
    """Steering angle [rad] that a board of this dialect believes at a reading [counts]."""
    angle = (counts + OFFSET_SIGN[host] * settings.offset) / max(settings.counts_per_degree, 1)
    if angle < 0:
        angle *= settings.ackermann / 100
    return -radians(angle)


def true_angle(believed: float, per_degree: int, settings: SteerSettings, config: SteerConfig, host: str) -> float:
    """Steering angle [rad] at which the board believes `believed`: the inverse of `counts_of` and `angle_of`."""
    angle = -degrees(believed)
    if angle < 0:
        angle *= 100 / max(settings.ackermann, 1)
    counts = angle * max(settings.counts_per_degree, 1) - OFFSET_SIGN[host] * settings.offset
    steer = -radians(counts / per_degree)
    return -steer if config.set0 & INVERT_SENSOR else steer


def pwm_of(error: float, settings: SteerSettings) -> int:
    """PWM towards the set point at an error [rad], set point less believed angle.

    Proportional plus the least PWM, limited between the low and the high PWM by the size of the error.
    """
    size = abs(degrees(error))
    drive = int(settings.kp * size)
    if drive == 0:
        return 0
    low = LOW_OVER_MIN * settings.min_pwm
    share = min(size / SOFT_ZONE_DEG, 1.0)
    limit = low + share * (settings.high_pwm - low)
    pwm = int(max(min(drive + settings.min_pwm, limit, FULL_PWM), 0))
    return pwm if error > 0 else -pwm


def voltage_of(pwm: int, config: SteerConfig) -> float:
    """Valve voltage [V] of a PWM; above neutral steers left."""
    sign = -1 if config.set0 & INVERT_MOTOR else 1
    return NEUTRAL_V + sign * NEUTRAL_V * pwm / FULL_PWM


ENGAGED_BIT = {"agopengps": 0x01, "agopenweb": 0x04}
"""Bit of `SteerData.status` that says the host steers, by dialect."""
REPEAT_S = 0.001
"""Time within which an identical datagram counts as a duplicate [s]."""
FALLBACK_S = 0.1
"""Without a message from the host the board reports at this interval [s]."""
LOOPBACK = (127, 0, 0, 1)


class Tally(NamedTuple):
    """What the board has counted."""

    steer_data: int = 0
    """Steering messages."""
    hellos: int = 0
    """Signs of life of the program that carries the messages."""
    others: int = 0
    """Other messages of the host."""
    unknown: int = 0
    """Valid frames that are not for a steer module."""
    repeats: int = 0
    """Identical datagrams on another route."""
    rejected: tuple[tuple[str, int], ...] = ()
    """Datagrams that are no valid frame: reason and number."""
    engagements: int = 0
    """Changes from released to steering."""
    lost: int = 0
    """Outages of the host."""


class BoardState(NamedTuple):
    """What the board remembers."""

    settings: SteerSettings
    config: SteerConfig = SteerConfig(0)
    asked: SteerData | None = None
    """Last steering message."""
    heard_at: float = -inf
    """Arrival time of that message, by the board's clock [s]."""
    latched: bool = True
    """Whether the board is latched: no steering before a message without the engaged bit."""
    silent: bool = True
    """Whether the watchdog has run out."""
    engaged: bool = False
    """Whether it steered in the last tick."""
    steer: float = 0.0
    """Measured steering angle, true scale, left positive [rad]."""
    pwm: int = 0
    """Drive of the board's own law, left positive [PWM counts]."""
    reported_at: float = -inf
    """Time of the last report [s]."""
    last: tuple[bytes, float] = (b"", -inf)
    """Last datagram and its wall time [s]."""
    tally: Tally = Tally()


class Board(NamedTuple):
    """A steer module with the keys of a scenario."""

    spec: AgOpenGps
    limit: float
    """Largest steering angle, either way [rad]."""
    inertial_unit: bool = False
    """Whether an inertial unit answers the host's hello, too."""
    address: tuple[int, int, int, int] = LOOPBACK
    """Address that a scanning host is given."""

    def init(self) -> BoardState:
        """Power-up."""
        b = self.spec.board
        offsets = b.counts_per_degree, b.offset, b.ackermann_percent
        return BoardState(SteerSettings(b.kp, b.high_pwm, b.min_pwm, b.min_pwm, *offsets))

    def receive(
        self, state: BoardState, datagram: bytes, t: float, wall: float, quiet: bool = False
    ) -> tuple[BoardState, tuple[bytes, ...]]:
        """Take a datagram at the board's time `t` and wall time `wall` [s]; returns the answers to the host.

        `quiet`: too close before a position to report the steering state; hosts would lose the position.
        """
        if datagram == state.last[0] and wall - state.last[1] < REPEAT_S:
            return state._replace(tally=state.tally._replace(repeats=state.tally.repeats + 1)), ()
        state = self._watch(state._replace(last=(datagram, wall)), t)
        message, tally = decode(datagram), state.tally
        if isinstance(message, Rejected):
            counts = dict(tally.rejected)
            counts[message.reason] = counts.get(message.reason, 0) + 1
            return state._replace(tally=tally._replace(rejected=tuple(sorted(counts.items())))), ()
        if isinstance(message, Unknown):
            return state._replace(tally=tally._replace(unknown=tally.unknown + 1)), ()
        if isinstance(message, SteerData):
            state = self._take(state, message, t)
            return (state, ()) if quiet else self.report(state, t)
        hello = isinstance(message, Hello)
        state = state._replace(tally=tally._replace(hellos=tally.hellos + hello, others=tally.others + (not hello)))
        if isinstance(message, SteerSettings):
            return state._replace(settings=message), ()
        if isinstance(message, SteerConfig):
            return state._replace(config=message), ()
        return state, tuple(map(encode, self._answers(state, message, t)))

    def tick(self, state: BoardState, t: float, steer: float) -> tuple[BoardState, Actuation]:
        """Steer at the board's time `t` [s], with the measured steering angle [rad]."""
        state, spec = self._watch(state._replace(steer=steer), t), self.spec
        asked = state.asked
        engaged = asked is not None and not state.latched and not state.silent and self._wants(asked)
        wish = nan if asked is None else clip(asked.steer, -self.limit, self.limit)
        pwm = pwm_of(wish - self._believed(state), state.settings) if engaged else 0
        tally = state.tally._replace(engagements=state.tally.engagements + (engaged and not state.engaged))
        state = state._replace(engaged=engaged, pwm=pwm, tally=tally)
        off = nan if asked is None or state.silent else cross_track_of(asked, spec.host)
        if not engaged:
            return state, Actuation(False, 0.0, NEUTRAL_V if spec.released == "hold" else None, wish, off)
        if spec.steer_by == "pwm":
            return state, Actuation(True, wish, voltage_of(pwm, state.config), wish, off)
        wanted = true_angle(wish, spec.sensor_counts_per_degree, state.settings, state.config, spec.host)
        return state, Actuation(True, clip(wanted, -self.limit, self.limit), None, wish, off)

    def refuses(self, state: BoardState) -> bool:
        """Whether the host believes that it steers, but the board is latched."""
        return state.latched and not state.silent and state.asked is not None and self._wants(state.asked)

    def report(self, state: BoardState, t: float) -> tuple[BoardState, tuple[bytes, ...]]:
        """The steering state for the host at the board's time `t` [s]."""
        answer = SteerState(self._believed(state), switches=self._switches(t), pwm=abs(state.pwm))
        return state._replace(reported_at=t), (encode(answer),)

    def report_if_due(self, state: BoardState, t: float) -> tuple[BoardState, tuple[bytes, ...]]:
        """Result of `report` if the host has sent no message for a while, else nothing."""
        due = t - state.reported_at > FALLBACK_S - 1e-6
        return self.report(state, t) if due else (state, ())

    def _watch(self, state: BoardState, t: float) -> BoardState:
        """Let go after the time of the watchdog, and latch after that of the latch."""
        silence = t - state.heard_at
        if not state.silent and silence > self.spec.watchdog_s:
            lost = state.tally._replace(lost=state.tally.lost + 1)
            state = state._replace(silent=True, tally=lost)
        if state.silent and not state.latched and self.spec.latch_s != "never" and silence > self.spec.latch_s:
            state = state._replace(latched=True)
        return state

    def _take(self, state: BoardState, message: SteerData, t: float) -> BoardState:
        tally = state.tally._replace(steer_data=state.tally.steer_data + 1)
        latched = state.latched and self._wants(message)
        return state._replace(asked=message, heard_at=t, silent=False, latched=latched, tally=tally)

    def _wants(self, message: SteerData) -> bool:
        return bool(message.status & ENGAGED_BIT[self.spec.host])

    def _answers(self, state: BoardState, message: Message, t: float) -> tuple[Message, ...]:
        if isinstance(message, Hello):
            counts = round(counts_of(state.steer, self.spec.sensor_counts_per_degree, state.config))
            steer = HelloReply(STEER, self._believed(state), counts, self._switches(t))
            return (steer, HelloReply(IMU)) if self.inertial_unit else (steer,)
        if isinstance(message, Scan):
            a = self.address
            return (ScanReply(STEER, a, (a[0], a[1], a[2])),)
        return ()

    def _believed(self, state: BoardState) -> float:
        counts = counts_of(state.steer, self.spec.sensor_counts_per_degree, state.config)
        return angle_of(counts, state.settings, self.spec.host)

    def _switches(self, t: float) -> int:
        """Work switch off, steer switch on from `engage_at_s`; its bit is active low except in AgOpenWeb."""
        on = self.spec.engage_at_s is None or t >= self.spec.engage_at_s
        return 0x01 | (0x02 if on == (self.spec.host == "agopenweb") else 0x00)
