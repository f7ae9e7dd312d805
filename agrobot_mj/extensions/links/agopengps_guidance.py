"""Guidance by an external program of the AgOpenGPS family: scenario keys of the guidance and of the simulated boards.

The tractor acts as steer module, GNSS receiver and inertial unit. A host sends the steering angle over UDP. With
`steer_by = "angle"`, this angle is the setpoint of the tractor's steering loop. With `"pwm"`, the proportional law of
the board, with adjustable gains, controls the valve. The speed is the reference speed of the path.
"""

from collections.abc import Sequence
from math import nan
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import GuidanceLaw, Situation
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.signals import NEUTRAL_V, Column, Command
from agrobot_mj.core.spec import NonNegative, Positive, Spec

Byte = Annotated[int, Field(ge=0, le=255)]  # Setting stored in one byte


class BoardSettings(Spec):
    """Settings of a steer module at power-up, before the host sends settings. The defaults are common values."""

    kp: Byte = 40
    """Proportional gain of the board's control law [PWM counts/deg]. AgOpenGPS boards use the same default."""
    high_pwm: Byte = 60
    """PWM limit at steering errors of at least 3 deg [PWM counts]. AgOpenGPS boards use the same default."""
    min_pwm: Byte = 9
    """Minimum motor PWM, added to the proportional PWM [PWM counts]. AgOpenGPS boards use the same default."""
    counts_per_degree: Annotated[int, Field(ge=1, le=255)] = 30
    """Scale of the angle sensor [counts/deg]. AgOpenGPS boards use the same default."""
    offset: Annotated[int, Field(ge=-32768, le=32767)] = 0
    """Offset added to the sensor counts, or subtracted with `host = "agopenweb"` [counts]. AgOpenGPS boards use the
    same default."""
    ackermann_percent: Byte = 100
    """Scale factor on steering angles to the left [%]. AgOpenGPS boards use the same default."""


class Actuation(NamedTuple):
    """Steering output of the steer module in one tick."""

    engaged: bool = False
    steer: float = 0.0  # Setpoint for the steering loop of the tractor [rad], left positive
    voltage: float | None = NEUTRAL_V
    """Valve voltage that replaces the output of the steering loop [V], or None if the loop controls the valve."""
    asked: float = nan
    """Steering setpoint of the host [rad], positive to the left, also if not engaged. NaN before the first message."""
    cross_track: float = nan
    """Cross-track error reported by the host [m], positive to the left. NaN without a guidance line or messages."""


class AgOpenGps(GuidanceLaw):
    """Guidance by an external program over UDP with the command `agrobot-mj link`."""

    kind: Literal["agopengps"] = "agopengps"
    label: ClassVar = "AgOpenGPS"
    host: Literal["agopengps", "agopenweb"] = "agopengps"
    """Message dialect of the host. `agopengps` includes QtAgOpenGPS."""
    steer_by: Literal["angle", "pwm"] = "angle"
    """Controller for the angle commanded by the host: steering loop (`angle`), or control law of the board (`pwm`)."""
    position: Literal["panda", "paogi"] = "panda"
    """Position sentence sent to the host: `panda` for one antenna, `paogi` for two (`sensors.gnss.dual_antenna`)."""
    position_rate_hz: Literal[5, 10] = 10
    """Rate of position sentences [Hz]. Hosts discard positions less than 50 ms apart."""
    origin_lat_deg: Annotated[float, Field(ge=-85, le=85)] = 50.877
    """Latitude of the map origin x = y = 0 [deg]."""
    origin_lon_deg: Annotated[float, Field(ge=-180, le=180)] = 4.699
    """Longitude of the map origin x = y = 0 [deg]."""
    watchdog_s: Annotated[float, Field(gt=0, le=60)] = 2.5
    """Time without messages until the board releases the steering [s], as in AgOpenGPS boards (100 loops of 25 ms)."""
    latch_s: Annotated[float, Field(gt=0, le=3600)] | Literal["never"] = 2.5
    """Time without messages after which the board is latched [s], at least `watchdog_s`, or "never".

    A latched board does not steer until a message without the engaged bit arrives. The board firmware AiO v2.5 latches
    after 6.25 s (250 loops of 25 ms), and Autosteer_UDP_v5 never latches.
    """
    released: Literal["hold", "centre"] = "hold"
    """Output of a board that does not steer: valve in neutral (`hold`), or wheels straight ahead (`centre`)."""
    give_up_s: Positive = 10.0
    """Time without messages after which the run ends [s]. Assumed value (range 3-60): enough for a restart of the
    host."""
    engage_at_s: NonNegative | None = None
    """Time at which the steer switch of the board is turned on [s]. Default: the start."""
    sensor_counts_per_degree: Annotated[int, Field(ge=1, le=255)] = 30
    """True scale of the angle sensor [counts/deg]. Normally equal to `board.counts_per_degree`."""
    board: BoardSettings = BoardSettings()
    """Settings of the steer module at power-up."""

    @property
    def follows_path(self) -> bool:
        """Whether the law follows the scenario path. False, because the host follows its own guidance line."""
        return False

    @property
    def outside(self) -> str:
        """Name of the command that runs scenarios with this guidance."""
        return "link"

    @property
    def needs(self) -> dict[str, str]:
        """Sensor settings that this guidance requires: two antennas if `position` is "paogi"."""
        return {"gnss.dual_antenna": 'position: "paogi"'} if self.position == "paogi" else {}

    def init(self) -> Actuation:
        """Return the steering output of the board at power-up."""
        return Actuation()

    def update(self, state: Actuation, situation: Situation, dt: float) -> tuple[Actuation, Command]:
        """Return the steering output of the board in `state` as a tractor command, with the reference speed of the
        path."""
        r = situation.reference
        speed = to_heading(r.yaw, r.vx, r.vy)[0]
        released = not state.engaged and state.voltage is not None  # the steering loop holds the current angle
        return state, Command(situation.steer if released else state.steer, speed, state.voltage)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Log columns of the values reported by the host: engagement, steering setpoint and cross-track error."""
        return (
            Column("link_engaged", "-", "1 while the host steers, else 0"),
            Column("link_steer", "rad", "setpoint of the host, left positive; also valid while disengaged"),
            Column("link_cross_track", "m", "cross-track error of the host, left positive; null without"),
        )

    def report(self, state: Actuation) -> Sequence[float]:
        """Return the values of the log columns for a state, in the order of `columns`."""
        return float(state.engaged), state.asked, state.cross_track
