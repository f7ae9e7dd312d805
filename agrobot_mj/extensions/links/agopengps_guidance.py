"""Guidance by a program of the AgOpenGPS family: the law lives outside, here are the keys of the boards it talks to.

The tractor plays the steer module, the GNSS receiver and the inertial unit; a host on UDP sends the steering angle.
`steer_by = "angle"` hands that angle to the tractor's own steering loop; `"pwm"` lets the board's own proportional law
drive the valve, which is what users of such programs tune. The speed is that of the path.
"""

from collections.abc import Sequence
from math import nan
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from agrobot_mj.control.base import GuidanceLaw, Situation
from agrobot_mj.core.geometry import to_heading
from agrobot_mj.core.signals import NEUTRAL_V, Column, Command
from agrobot_mj.core.spec import NonNegative, Positive, Spec

Byte = Annotated[int, Field(ge=0, le=255)]
"""One byte of a setting."""


class BoardSettings(Spec):
    """What a steer module remembers until the host sends other settings; defaults of common boards."""

    kp: Byte = 40
    """Proportional gain [PWM counts/deg]. Default of AgOpenGPS boards."""
    high_pwm: Byte = 60
    """Limit at errors of 3 deg and more [PWM counts of 255]. Default of AgOpenGPS boards."""
    min_pwm: Byte = 9
    """Least drive, added towards the set point [PWM counts]. Default of AgOpenGPS boards."""
    counts_per_degree: Annotated[int, Field(ge=1, le=255)] = 30
    """Scale of the angle sensor [counts/deg]. Default of AgOpenGPS boards."""
    offset: Annotated[int, Field(ge=-32768, le=32767)] = 0
    """Added to the angle sensor's reading, taken from it with `host = "agopenweb"` [counts]. Default of such boards."""
    ackermann_percent: Byte = 100
    """Scale of angles to the left [%]. Default of AgOpenGPS boards."""


class Actuation(NamedTuple):
    """What the board does to the steering in one tick; at first nothing."""

    engaged: bool = False
    """The host steers."""
    steer: float = 0.0
    """Angle for the tractor's steering loop, left positive [rad]."""
    voltage: float | None = NEUTRAL_V
    """Valve voltage in place of that loop [V]."""
    asked: float = nan
    """Set point of the host, left positive; alive while not engaged, NaN before the first [rad]."""
    cross_track: float = nan
    """The host's own distance from its line, left positive; NaN without a line and while it is silent [m]."""


class AgOpenGps(GuidanceLaw):
    """An outer program drives over UDP, see `agrobot-mj link`."""

    kind: Literal["agopengps"] = "agopengps"
    label: ClassVar = "AgOpenGPS"
    host: Literal["agopengps", "agopenweb"] = "agopengps"
    """Dialect: `agopengps` also for QtAgOpenGPS."""
    steer_by: Literal["angle", "pwm"] = "angle"
    """The host's angle goes to the tractor's steering loop, or through the board's own law to the valve."""
    position: Literal["panda", "paogi"] = "panda"
    """Sentence to the host: one antenna with an inertial unit if there is one, or two (`sensors.gnss.dual_antenna`)."""
    position_rate_hz: Literal[5, 10] = 10
    """Positions sent [Hz]; hosts discard what comes within 50 ms."""
    origin_lat_deg: Annotated[float, Field(ge=-85, le=85)] = 50.877
    """Latitude of x = y = 0 [deg]."""
    origin_lon_deg: Annotated[float, Field(ge=-180, le=180)] = 4.699
    """Longitude of x = y = 0 [deg]."""
    watchdog_s: Annotated[float, Field(gt=0, le=60)] = 2.5
    """Time without a steering message after which the board lets go [s]. As AgOpenGPS boards: 100 loops of 25 ms."""
    latch_s: Annotated[float, Field(gt=0, le=3600)] | Literal["never"] = 2.5
    """Silence after which a board stays released until a message without the engaged bit, or "never" [s].

    Boards differ: 6.25 s in AiO v2.5 (250 loops of 25 ms), never in Autosteer_UDP_v5. Acts after `watchdog_s` at the
    earliest.
    """
    released: Literal["hold", "centre"] = "hold"
    """A board that does not steer leaves the valve neutral, or steers straight ahead."""
    give_up_s: Positive = 10.0
    """A run ends when a host that drove has been silent for this long [s]. Assumed value (3-60): time to start it
    again."""
    engage_at_s: NonNegative | None = None
    """Time at which the board's steer switch goes on [s]; from the start when left out."""
    sensor_counts_per_degree: Annotated[int, Field(ge=1, le=255)] = 30
    """True scale of the mounted angle sensor [counts/deg]; the board's own `counts_per_degree` should match."""
    board: BoardSettings = BoardSettings()
    """Settings at power-up."""

    @property
    def follows_path(self) -> bool:
        """Always False: host and boards have a line and a supervision of their own."""
        return False

    @property
    def outside(self) -> str:
        """Command that runs this guidance."""
        return "link"

    @property
    def needs(self) -> dict[str, str]:
        """Two antennas, if `position` is "paogi"."""
        return {"gnss.dual_antenna": 'position: "paogi"'} if self.position == "paogi" else {}

    def init(self) -> Actuation:
        """The board at power-up."""
        return Actuation()

    def update(self, state: Actuation, situation: Situation, dt: float) -> tuple[Actuation, Command]:
        """The steering that the link has left in the state, at the speed of the path."""
        r = situation.reference
        speed = to_heading(r.yaw, r.vx, r.vy)[0]
        released = not state.engaged and state.voltage is not None  # the loop holds the wheels where they are
        return state, Command(situation.steer if released else state.steer, speed, state.voltage)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the host's requests."""
        return (
            Column("link_engaged", "-", "1 while the host steers, else 0"),
            Column("link_steer", "rad", "set point of the host, left positive; alive also while it does not steer"),
            Column("link_cross_track", "m", "the host's own distance from its line, left positive; null without"),
        )

    def report(self, state: Actuation) -> Sequence[float]:
        """Values of `columns`."""
        return float(state.engaged), state.asked, state.cross_track
