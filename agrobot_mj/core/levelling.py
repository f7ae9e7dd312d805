"""Rate of the heading on ground that leans, from one gyro and the roll and pitch of the inertial unit.

With phi roll, theta pitch and psi heading (ISO 8855) the angular velocity has the components

    w_z = psi' - phi' sin(theta)                                about the vertical,
    r   = psi' cos(phi) cos(theta) - theta' sin(phi)            about the chassis' upright axis.

On a slope of 10 deg the missing terms add up to 3 deg of heading in every half turn. Roll and pitch are low-passed
before their rates are taken; what that delays comes in the end, since sums of differences telescope.
"""

from math import cos, exp, sin
from typing import NamedTuple

SMOOTHING_S = 0.1
"""Time constant of the low pass of roll and pitch [s]. Assumed value: 0.5 s cause 0.3 deg heading error in a bend."""


class SmoothedTilt(NamedTuple):
    """Low-passed roll and pitch, and their rates."""

    roll: float
    """Roll [rad]."""
    pitch: float
    """Pitch [rad]."""
    roll_rate: float = 0.0
    """Rate of the roll [rad/s]."""
    pitch_rate: float = 0.0
    """Rate of the pitch [rad/s]."""

    def after(self, roll: float, pitch: float, dt: float) -> "SmoothedTilt":
        """Return the tilt after the next measurements [rad], `dt` [s] later."""
        new = 1.0 - exp(-dt / SMOOTHING_S)
        d_roll, d_pitch = new * (roll - self.roll), new * (pitch - self.pitch)
        return SmoothedTilt(self.roll + d_roll, self.pitch + d_pitch, d_roll / dt, d_pitch / dt)

    def heading_rate(self, gyro: float, body: bool) -> float:
        """Return the heading rate [rad/s] from a gyro about the vertical, or about the axis of the `body`."""
        if body:
            return (gyro + self.pitch_rate * sin(self.roll)) / (cos(self.roll) * cos(self.pitch))
        return gyro + self.roll_rate * sin(self.pitch)
