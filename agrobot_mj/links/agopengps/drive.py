"""What a steer module does with its angle sensor and its motor: calibration and the proportional law.

Angles in rad, left positive, except inside the board's own arithmetic, which is in degrees, right positive, as on the
wire. The motor's PWM (-255 to 255, left positive here) becomes the voltage of our valve.

The offset of message 252 is added to the sensor's reading by AgOpenGPS boards, since that program's zero button sends
the offset it has less the counts of the angle shown; a module of AgOpenWeb takes it away, whose zero button adds them.
"""

from math import degrees, radians

from agrobot_mj.core.agopengps.messages import SteerConfig, SteerSettings
from agrobot_mj.core.signals import NEUTRAL_V

FULL_PWM = 255
"""Full output of the motor driver [PWM counts]."""
SOFT_ZONE_DEG = 3.0
"""Below this error the limit of the PWM falls with it [deg]. As AgOpenGPS boards."""
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
