"""Measurements of the sensors of the package, computed in one compiled call per tick."""

from math import isfinite, nan
from typing import Any, NamedTuple

from agrobot_mj.core.held import Held
from agrobot_mj.core.kernels import fetched, held, jit, stage
from agrobot_mj.core.signals import Truth, Vector
from agrobot_mj.sensors.base import motion_of
from agrobot_mj.sensors.gnss import FixErrors, GnssLaw, Sky, Solved, Streams, solution
from agrobot_mj.sensors.gyro import GyroLaw, GyroValues, gyro_rate
from agrobot_mj.sensors.implement_gnss import (
    ImplementFix,
    ImplementGnss,
    ImplementGnssLaw,
    ImplementGnssValues,
    implement_fix,
)
from agrobot_mj.sensors.imu import Attitude, Imu, ImuLaw, ImuValues, attitude
from agrobot_mj.sensors.potentiometer import PotentiometerLaw, rounded_mean
from agrobot_mj.sensors.speed import SpeedLaw, SpeedValues, radar_speed, wheel_speed


class Laws(NamedTuple):
    """Parameters of the compiled sensors. The states of the sensors are in the fields of `Values` with the same
    names."""

    steering_pot: PotentiometerLaw
    pedal_pot: PotentiometerLaw
    present: tuple[bool, bool, bool, bool, bool]
    """Whether the gyro, inertial unit, wheel speed, radar and receiver on the implement are present, in this order."""
    gnss: GnssLaw
    gyro: GyroLaw
    imu: ImuLaw
    wheel_speed: SpeedLaw
    radar_speed: SpeedLaw
    implement_gnss: ImplementGnssLaw


class Values(NamedTuple):
    """Numeric state of each compiled sensor, carried from one tick to the next."""

    gnss: FixErrors
    gyro: GyroValues
    imu: ImuValues
    wheel_speed: SpeedValues
    radar_speed: SpeedValues
    implement_gnss: ImplementGnssValues


class Generators(NamedTuple):
    """Random number generators of the compiled sensors."""

    steering_pot: Any
    pedal_pot: Any
    gnss: Any
    gyro: Any
    imu: Any
    wheel_speed: Any
    radar_speed: Any
    implement_gnss: Any


class Addresses(NamedTuple):
    """Addresses of the random streams of the compiled sensors."""

    steering_pot: int
    pedal_pot: int
    gnss: Streams
    gyro: tuple[int, int]
    imu: tuple[int]
    wheel_speed: tuple[int]
    radar_speed: tuple[int]
    implement_gnss: tuple[int]


class SensorReadings(NamedTuple):
    """Measurements of the compiled sensors in one tick, with NaN for absent sensors."""

    gnss: Solved  # Solution computed in this tick
    heading: float  # Heading from two antennas [rad], without the faults of its signal line
    steering_pot: float
    pedal_pot: float
    gyro: float
    imu: Attitude
    wheel_speed: float
    radar_speed: float
    implement_gnss: ImplementFix


NO_ATTITUDE, NO_PLACE = Imu.absent, ImplementGnss.absent


@stage
def sense(
    p: Held[Laws],
    s: Held[Values],
    streams: Held[Addresses],
    truth: Held[Truth],
    sky: Sky,
    steer: Vector,
) -> tuple[Held[Values], SensorReadings, bool]:
    """Return the sensor states after a tick, the measurements, and whether the true state is finite.

    `steer` (n,) is the signal that the steering potentiometer samples, or empty for the true steering angle.
    """
    p, s, streams, truth = fetched(p), fetched(s), fetched(streams), fetched(truth)
    motion = motion_of(truth)
    steer_angle = rounded_mean(p.steering_pot, streams.steering_pot, steer if steer.size else truth.steer_samples)
    pedal_place = rounded_mean(p.pedal_pot, streams.pedal_pot, truth.pedal_samples)
    gnss, (solved, heading) = solution(p.gnss, s.gnss, streams.gnss, motion, sky)
    has_gyro, has_imu, has_wheel_speed, has_radar, has_implement = p.present
    gyro, rate = s.gyro, nan
    if has_gyro:
        gyro, rate = gyro_rate(p.gyro, gyro, streams.gyro, motion)
    imu, angles = s.imu, NO_ATTITUDE
    if has_imu:
        imu, angles = attitude(p.imu, imu, streams.imu, motion)
    wheels, rolled = s.wheel_speed, nan
    if has_wheel_speed:
        wheels, rolled = wheel_speed(p.wheel_speed, wheels, streams.wheel_speed, motion)
    radar, moved = s.radar_speed, nan
    if has_radar:
        radar, moved = radar_speed(p.radar_speed, radar, streams.radar_speed, motion)
    implement, tool = s.implement_gnss, NO_PLACE
    if has_implement:
        implement, tool = implement_fix(p.implement_gnss, implement, streams.implement_gnss, motion)
    readings = SensorReadings(solved, heading, steer_angle, pedal_place, rate, angles, rolled, moved, tool)
    return held(Values(gnss, gyro, imu, wheels, radar, implement)), readings, is_sound(truth)


@jit
def is_sound(t: Truth) -> bool:
    """Return whether the true state is finite. Samples and plant-specific numbers are not checked."""
    (x, y, z), (vx, vy, vz) = t.antenna, t.antenna_velocity
    pose = t.t + t.x + t.y + t.z + t.yaw + t.pitch + t.roll + t.rear_x + t.rear_y
    rates = t.speed + t.lateral_speed + t.yaw_rate + t.steer + t.pedal
    return isfinite(pose + rates + x + y + z + vx + vy + vz)
