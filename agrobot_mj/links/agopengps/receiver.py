"""The GNSS and IMU board: measurements of the simulated sensors to position sentences.

The position is the receiver's solution at the antenna, with all its noise, latency and losses; without a solution the
host hears nothing, as from a board whose receiver has none. Roll and pitch are the inertial unit's where it is
enabled; its heading is the gyro's, integrated from the true heading at the start, where that is enabled. Two antennas
(`paogi`) measure the heading with white noise.
"""

from math import atan2, hypot, isnan, nan, radians
from typing import NamedTuple

from numpy.random import Generator

from agrobot_mj.control.agopengps import AgOpenGps
from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import Measurement, Quality, Truth
from agrobot_mj.links.agopengps.position import BoardAttitude, panda, paogi
from agrobot_mj.links.nmea import NO_FIX, RTK_FIX, RTK_FLOAT, Solution, gga, rmc, vtg

QUALITIES = {Quality.NONE: NO_FIX, Quality.FLOAT: RTK_FLOAT, Quality.FIX: RTK_FIX}
"""GGA's number of a solution's quality."""


class ReceiverState(NamedTuple):
    """What the board remembers."""

    generator: Generator
    """Noise of the heading of two antennas; advances in place."""
    yaw: float = nan
    """Integral of the gyro, NaN before the first reading [rad]."""
    solution: Solution | None = None
    """Last solution, None before the first."""
    fresh: bool = False
    """The last measurement brought a solution."""
    attitude: BoardAttitude = BoardAttitude()
    """BoardAttitude of the last measurement."""


class Receiver(NamedTuple):
    """A GNSS and IMU board of certain keys."""

    spec: AgOpenGps

    def init(self, seed: int) -> ReceiverState:
        """Power-up; noise from the stream of its own of `seed`."""
        return ReceiverState(stream(seed, "agopengps.heading"))

    def measure(self, state: ReceiverState, m: Measurement, truth: Truth, dt: float) -> ReceiverState:
        """Take the measurements of one tick of `dt` [s]; the truth is only for what `sensors` has no model of."""
        yaw = truth.yaw if isnan(state.yaw) else wrap(state.yaw + m.gyro * dt)
        heading = yaw = nan if isnan(m.gyro) else yaw
        if self.spec.position == "paogi":
            heading = wrap(truth.yaw + radians(self.spec.heading_sigma_deg) * state.generator.standard_normal())
        attitude = BoardAttitude(heading, m.roll, m.pitch, m.gyro)
        solution = self._solution(m, truth) or state.solution
        return state._replace(yaw=yaw, solution=solution, fresh=m.fix is not None, attitude=attitude)

    def sentence(self, state: ReceiverState, t: float) -> bytes | None:
        """The position for the host at time `t` [s]; None without a solution."""
        if state.solution is None or not state.fresh:
            return None
        write = paogi if self.spec.position == "paogi" else panda
        return write(state.solution._replace(t=t), state.attitude)

    def nmea(self, state: ReceiverState, t: float) -> tuple[bytes, ...]:
        """GGA, RMC and VTG for any reader at time `t` [s]; they say so when there is no solution."""
        if state.solution is None:
            return ()
        s = state.solution._replace(t=t, quality=state.solution.quality if state.fresh else NO_FIX)
        return gga(s), rmc(s), vtg(s)

    def _solution(self, m: Measurement, truth: Truth) -> Solution | None:
        if m.fix is None:
            return None
        origin = Origin(self.spec.origin_lat_deg, self.spec.origin_lon_deg)
        latitude, longitude = to_geodetic(origin, m.fix.x, m.fix.y)
        motion = hypot(m.fix.vx, m.fix.vy), atan2(m.fix.vy, m.fix.vx)
        return Solution(m.t, latitude, longitude, truth.antenna[2], *motion, QUALITIES[m.quality])
