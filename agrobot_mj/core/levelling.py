"""Heading rate on sloping ground, from one gyro and the roll and pitch of the inertial unit.

With roll phi, pitch theta and heading psi (ISO 8855) the components of the angular velocity are

    w_z = psi' - phi' sin(theta)                                about the vertical,
    r   = psi' cos(phi) cos(theta) - theta' sin(phi)            about the vertical axis of the chassis.

On a slope of 10 deg the terms without psi' contribute 3 deg of heading to every rotation by 180 deg. Roll and pitch are
low-pass filtered before differentiation. The filter delay causes no permanent error, because the filtered rates
integrate to the total change of the angles.
"""

from math import cos, exp, sin
from typing import NamedTuple

from agrobot_mj.core.kernels import kernel_method

SMOOTHING_S = 0.1
"""Time constant of the roll and pitch filter [s]. Assumed value; 0.5 s causes a heading error of 0.3 deg in bends."""


class SmoothedTilt(NamedTuple):
    """Low-pass filtered roll and pitch, and the time derivatives of the filtered angles."""

    roll: float  # Filtered roll [rad]
    pitch: float  # Filtered pitch [rad]
    roll_rate: float = 0.0  # Rate of the filtered roll [rad/s]
    pitch_rate: float = 0.0  # Rate of the filtered pitch [rad/s]

    def after(self, roll: float, pitch: float, dt: float) -> "SmoothedTilt":
        """Return the filtered angles after a measurement of roll and pitch [rad], `dt` [s] after the previous
        measurement."""
        new = 1.0 - exp(-dt / SMOOTHING_S)
        d_roll, d_pitch = new * (roll - self.roll), new * (pitch - self.pitch)
        return SmoothedTilt(self.roll + d_roll, self.pitch + d_pitch, d_roll / dt, d_pitch / dt)

    def heading_rate(self, gyro: float, body: bool) -> float:
        """Return the heading rate [rad/s] from a `gyro` rate [rad/s] about the chassis z axis if `body`, else the
        vertical."""
        if body:
            return (gyro + self.pitch_rate * sin(self.roll)) / (cos(self.roll) * cos(self.pitch))
        return gyro + self.roll_rate * sin(self.pitch)


for _method in ("after", "heading_rate"):
    kernel_method(_method)
