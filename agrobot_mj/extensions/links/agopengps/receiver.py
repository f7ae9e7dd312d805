"""GNSS and IMU board: converts measurements of the simulated sensors to position sentences.

The position is the receiver solution at the antenna, with noise, latency and losses. Like a real board, the board sends
no sentence without a solution. Roll and pitch come from the inertial unit if enabled. With one antenna, the heading is
the gyro, if enabled, integrated from the true initial heading. With two antennas (`paogi`), the heading comes from the
receiver, and the last heading is repeated during a loss. Before the first heading, the single-antenna sentence is sent.
"""

from math import atan2, hypot, isnan, nan
from typing import NamedTuple

from agrobot_mj.core.agopengps.position import BoardAttitude, panda, paogi
from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.core.nmea import DGPS_FIX, NO_FIX, RTK_FIX, RTK_FLOAT, Solution, gga, rmc, vtg
from agrobot_mj.core.signals import Measurement, Quality, Truth
from agrobot_mj.extensions.links.agopengps_guidance import AgOpenGps
from agrobot_mj.extensions.links.running import gyro_heading

QUALITIES = {Quality.NONE: NO_FIX, Quality.DGPS: DGPS_FIX, Quality.FLOAT: RTK_FLOAT, Quality.FIX: RTK_FIX}
"""Quality number of GGA for each solution quality."""


class ReceiverState(NamedTuple):
    """State of the board between two ticks."""

    yaw: float = nan
    """Integral of the gyro [rad]; NaN before the first measurement."""
    heading: float = nan
    """Last heading from two antennas [rad]; NaN before the first."""
    solution: Solution | None = None
    fresh: bool = False
    """Whether the last measurement contained a solution."""
    attitude: BoardAttitude = BoardAttitude()
    """Attitude from the last measurement."""


class Receiver(NamedTuple):
    """GNSS and IMU board with the settings of a scenario."""

    spec: AgOpenGps

    def measure(self, state: ReceiverState, m: Measurement, truth: Truth, dt: float) -> ReceiverState:
        """Update the board with the measurements of a tick of `dt` [s]; `truth` gives the initial gyro heading."""
        yaw = gyro_heading(state.yaw, m.gyro, truth.yaw, dt)
        heading = m.fix.heading if m.fix is not None and not isnan(m.fix.heading) else state.heading
        attitude = BoardAttitude(heading if self.spec.position == "paogi" else yaw, m.roll, m.pitch, m.gyro)
        solution = self._solution(m) or state.solution
        return ReceiverState(yaw, heading, solution, m.fix is not None, attitude)

    def sentence(self, state: ReceiverState, t: float) -> bytes | None:
        """Return the position sentence at time `t` [s]; None without a solution."""
        if state.solution is None or not state.fresh:
            return None
        write = paogi if self.spec.position == "paogi" and not isnan(state.heading) else panda
        return write(state.solution._replace(t=t), state.attitude)

    def nmea(self, state: ReceiverState, t: float) -> tuple[bytes, ...]:
        """Return GGA, RMC and VTG for any NMEA reader at time `t` [s]; marked invalid without a solution."""
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
