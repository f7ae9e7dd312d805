"""Steer module (board): converts datagrams of the host to replies and a steering output, without sockets and clocks.

The board steers while messages of the host arrive with the "engaged" bit of its dialect. After the watchdog time
without messages, the board releases the steering. At power-up and after the latch time without messages, the board is
latched: it does not steer until a message without the engaged bit has arrived. A host that reconnects is often still
engaged and would otherwise command full lock. The setpoint in a message is valid even if the bit is not set.

A datagram identical to the previous datagram and received within 1 ms is a duplicate from another network interface.

Angles in arguments and results are in rad, positive to the left. In the board and in messages, angles are in degrees,
positive to the right. The motor PWM (-255 to 255, positive to the left) becomes the voltage of the simulated valve.

AgOpenGPS boards add the offset of message 252 to the sensor counts. The zero button of AgOpenGPS sends the stored
offset minus the counts of the displayed angle. AgOpenWeb modules subtract the offset, and their host sends the stored
offset plus these counts.
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

FULL_PWM = 255  # Maximum output of the motor driver [PWM counts]
SOFT_ZONE_DEG = 3.0
"""Steering error below which the PWM limit increases linearly with the error [deg], as in AgOpenGPS boards."""
LOW_OVER_MIN = 1.2  # PWM limit at zero steering error divided by the minimum PWM [-], as in AgOpenGPS boards
OFFSET_SIGN = {"agopengps": 1, "agopenweb": -1}
"""Sign of the offset that a board adds to the sensor counts, by message dialect of the host."""
INVERT_SENSOR, INVERT_MOTOR = 0x01, 0x04  # Bits of `SteerConfig.set0`: inverted sensor, inverted motor


def counts_of(steer: float, per_degree: int, config: SteerConfig) -> float:
    """Return the counts of the angle sensor at a steering angle [rad]. `per_degree` is the true sensor scale
    [counts/deg]."""
    counts = -degrees(steer) * per_degree
    return -counts if config.set0 & INVERT_SENSOR else counts


def angle_of(counts: float, settings: SteerSettings, host: str) -> float:
    """Return the steering angle [rad] that a board of the dialect `host` computes from sensor counts."""
    angle = (counts + OFFSET_SIGN[host] * settings.offset) / max(settings.counts_per_degree, 1)
    if angle < 0:
        angle *= settings.ackermann / 100
    return -radians(angle)


def true_angle(believed: float, per_degree: int, settings: SteerSettings, config: SteerConfig, host: str) -> float:
    """Return the true steering angle at which the board computes the angle `believed` [rad]. This is the inverse of
    `angle_of`."""
    angle = -degrees(believed)
    if angle < 0:
        angle *= 100 / max(settings.ackermann, 1)
    counts = angle * max(settings.counts_per_degree, 1) - OFFSET_SIGN[host] * settings.offset
    steer = -radians(counts / per_degree)
    return -steer if config.set0 & INVERT_SENSOR else steer


def pwm_of(error: float, settings: SteerSettings) -> int:
    """Return the motor PWM, positive to the left, for a steering error [rad]: setpoint minus angle computed by the
    board."""
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
    """Return the valve voltage for a motor PWM [V]. Voltages above neutral steer to the left."""
    sign = -1 if config.set0 & INVERT_MOTOR else 1
    return NEUTRAL_V + sign * NEUTRAL_V * pwm / FULL_PWM


ENGAGED_BIT = {"agopengps": 0x01, "agopenweb": 0x04}
"""Bit of `SteerData.status` that the host sets while it steers, by dialect."""
REPEAT_S = 0.001  # Maximum time between identical datagrams that are treated as duplicates [s]
FALLBACK_S = 0.1  # Interval at which the board reports its state while the host sends no messages [s]
LOOPBACK = (127, 0, 0, 1)


class Tally(NamedTuple):
    """Counters of the messages that a board has received, and of its changes of state."""

    steer_data: int = 0
    hellos: int = 0  # Number of hello messages of the communication program
    others: int = 0
    unknown: int = 0
    repeats: int = 0
    rejected: tuple[tuple[str, int], ...] = ()
    engagements: int = 0  # Number of times at which the board started steering
    lost: int = 0  # Number of times at which messages of the host stopped arriving


class BoardState(NamedTuple):
    """State of the simulated steer module between two ticks."""

    settings: SteerSettings
    config: SteerConfig = SteerConfig(0)
    asked: SteerData | None = None  # Last steering message of the host, or None before the first message
    heard_at: float = -inf  # Arrival time of the last steering message in board time [s]
    latched: bool = True
    """Whether the board is latched. A latched board steers only after a message without the engaged bit has arrived."""
    silent: bool = True  # Whether the watchdog time has passed since the last message of the host
    engaged: bool = False
    steer: float = 0.0  # Steering angle measured in the last tick [rad], left positive
    pwm: int = 0  # Motor output computed by the proportional law of the board [PWM counts], left positive
    reported_at: float = -inf  # Time of the last report [s]
    last: tuple[bytes, float] = (b"", -inf)  # Last datagram, and wall-clock time of its arrival [s]
    tally: Tally = Tally()


class Board(NamedTuple):
    """Simulated steer module with the settings of a scenario."""

    spec: AgOpenGps
    limit: float  # Maximum absolute steering angle [rad]
    inertial_unit: bool = False  # Whether an inertial unit also replies to hello messages of the host
    address: tuple[int, int, int, int] = LOOPBACK  # IPv4 address that a host receives when it scans the network

    def init(self) -> BoardState:
        """Return the board state at power-up."""
        b = self.spec.board
        offsets = b.counts_per_degree, b.offset, b.ackermann_percent
        return BoardState(SteerSettings(b.kp, b.high_pwm, b.min_pwm, b.min_pwm, *offsets))

    def receive(
        self, state: BoardState, datagram: bytes, t: float, wall: float, quiet: bool = False
    ) -> tuple[BoardState, tuple[bytes, ...]]:
        """Process a datagram at board time `t` [s] and wall-clock time `wall` [s]. Return the state and the replies.

        If `quiet`, the steering state is not sent, because hosts would lose the position sent shortly afterwards.
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
        """Return the state and the steering output at board time `t` [s] for a measured angle `steer` [rad]."""
        state, spec = self._watch(state._replace(steer=steer), t), self.spec
        asked = state.asked
        engaged = asked is not None and not state.latched and not state.silent and self._wants(asked)
        wish = nan if asked is None else clip(asked.steer, -self.limit, self.limit)
        pwm = pwm_of(wish - self._attitude(state), state.settings) if engaged else 0
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
        """Return whether the board does not steer because it is latched, although the host (guidance program) is
        engaged."""
        return state.latched and not state.silent and state.asked is not None and self._wants(state.asked)

    def report(self, state: BoardState, t: float) -> tuple[BoardState, tuple[bytes, ...]]:
        """Return the new board state and an encoded message with angle, switches and PWM. `t` is the board time [s]."""
        answer = SteerState(self._attitude(state), switches=self._switches(t), pwm=abs(state.pwm))
        return state._replace(reported_at=t), (encode(answer),)

    def report_if_due(self, state: BoardState, t: float) -> tuple[BoardState, tuple[bytes, ...]]:
        """Return the result of `report` if the last report was sent at least `FALLBACK_S` ago, otherwise the unchanged
        board state and no message."""
        due = t - state.reported_at > FALLBACK_S - 1e-6
        return self.report(state, t) if due else (state, ())

    def _watch(self, state: BoardState, t: float) -> BoardState:
        """Return the board state, with `silent` or `latched` set if no steering message has arrived for too long."""
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
            steer = HelloReply(STEER, self._attitude(state), counts, self._switches(t))
            return (steer, HelloReply(IMU)) if self.inertial_unit else (steer,)
        if isinstance(message, Scan):
            a = self.address
            return (ScanReply(STEER, a, (a[0], a[1], a[2])),)
        return ()

    def _attitude(self, state: BoardState) -> float:
        counts = counts_of(state.steer, self.spec.sensor_counts_per_degree, state.config)
        return angle_of(counts, state.settings, self.spec.host)

    def _switches(self, t: float) -> int:
        """Return the switch byte: work switch off, steer switch on from `engage_at_s`. AgOpenWeb inverts this bit."""
        on = self.spec.engage_at_s is None or t >= self.spec.engage_at_s
        return 0x01 | (0x02 if on == (self.spec.host == "agopenweb") else 0x00)
