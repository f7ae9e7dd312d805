"""Sensor suite: all sensors have one protocol, and a new sensor needs only a class and a field."""

import json
from math import nan
from typing import NamedTuple

import numpy as np
import pytest
from numpy.random import Generator

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import NOMINAL, Distortion, Quality, Truth
from agrobot_mj.sensors import Gyro, Imu, Sensor, Sensors

DT = 0.05
ALL_ON = Sensors.model_validate(
    {name: {"enabled": True} for name, sensor in Sensors().all.items() if "enabled" in type(sensor).model_fields}
)
ILL = NOMINAL._replace(gnss_quality=Quality.NONE, gnss_latency_s=0.2, steering_pot=Distortion(offset=0.1, stuck="last"))


def truth(k):
    return Truth(
        *(k * DT, k * 0.06, 0.0, 0.5, 0.3, 0.01, -0.02, 1.2, 0.0, 0.1, 0.1, 0.5, k * 0.06 - 0.6, 0.0),
        antenna=(k * 0.06 - 0.6, 0.0, 2.0),
        antenna_velocity=(1.2, 0.0, 0.0),
        steer_samples=np.full(25, 0.1),
        pedal_samples=np.full(25, 0.5),
        wheel_speed=1.2,
        body_rates=(0.0, 0.0, 0.1),
        rear_velocity=(1.15, 0.35, 0.0),
    )


class Bearing(NamedTuple):
    """Measurement of the compass."""

    yaw: float


class Compass(Sensor):
    """GNSS compass, an example of a new sensor."""

    sigma_rad: float = 0.003

    @property
    def columns(self):
        return (("compass_yaw", "rad", "heading from two antennas"),)

    def init(self, seed: int) -> Generator:
        return stream(seed, "compass")

    def measure(self, state, truth, conditions, dt):
        yaw = truth.yaw + self.sigma_rad * state.standard_normal()
        return state, Bearing(yaw if conditions.gnss_quality == Quality.FIX else nan)

    def report(self, reading):
        return reading


class WithCompass(Sensors):
    """Sensors of the tractor with an additional compass."""

    compass: Compass = Compass()


def drive(sensors, ticks=40, conditions=NOMINAL, seed=1):
    """Return state and measurement of each tick."""
    state, found = sensors.init(seed), []
    for k in range(ticks):
        state, measurement = sensors.measure(state, truth(k), conditions, DT)
        found.append((state, measurement))
    return found


def test_new_sensor_needs_only_a_class_and_a_field():
    steps = drive(WithCompass())
    errors = np.array([m.readings["compass"].yaw for _, m in steps]) - 0.3
    assert 0.001 < errors.std() < 0.006
    assert WithCompass().columns[-1] == ("compass_yaw", "rad", "heading from two antennas")
    state, measurement = steps[-1]
    assert WithCompass().report(state)[-1] == measurement.readings["compass"].yaw


def test_new_sensor_does_not_change_the_noise_of_other_sensors():
    for (_, new), (_, old) in zip(drive(WithCompass()), drive(Sensors()), strict=True):
        assert {name: new.readings[name] for name in old.readings} == old.readings


@pytest.mark.parametrize("name", Sensors().all)
def test_every_sensor_follows_the_protocol(name):
    sensor = ALL_ON.all[name]
    assert isinstance(sensor, Sensor)
    state = sensor.init(3)
    for k in range(10):
        state, reading = sensor.measure(state, truth(k), NOMINAL, DT)
        values = sensor.report(reading)
        assert len(values) == len(sensor.columns)
        assert all(isinstance(value, float) for value in values)


@pytest.mark.parametrize("name", Sensors().all)
def test_sensor_faults_do_not_change_the_noise_after_the_fault(name):
    """After a fault, the measurements equal the measurements of a run without the fault."""
    sensor, readings = ALL_ON.all[name], []
    for conditions in (NOMINAL, ILL):
        state = sensor.init(3)
        for k in range(30):
            state, reading = sensor.measure(state, truth(k), conditions if 5 <= k < 15 else NOMINAL, DT)
        readings.append(sensor.report(reading))
    assert repr(readings[0]) == repr(readings[1])


EVERYTHING = {
    "gnss": {"dual_antenna": {"enabled": True}, "canopy": [{"points": [[100, 100], [101, 100], [100, 101]]}]},
    **{name: {"enabled": True} for name in ("gyro", "imu", "wheel_speed", "radar_speed")},
}


@pytest.mark.parametrize("name", EVERYTHING)
def test_enabling_a_sensor_does_not_change_the_noise_of_others(name):
    """Each optional sensor, the second antenna and a distant canopy are compared with a tractor without them."""
    bare, more = Sensors(), Sensors.model_validate_json(json.dumps({name: EVERYTHING[name]}))
    for (_, with_it), (_, without) in zip(drive(more), drive(bare), strict=True):
        for other in bare.all:
            if other == "gnss":
                assert with_it.fix[:6] == without.fix[:6]
            elif other != name and getattr(bare, other).columns == getattr(more, other).columns:
                same, here = with_it.readings[other], without.readings[other]
                assert np.array_equal(np.ravel(same), np.ravel(here), equal_nan=True)


class ExactGyro(Gyro):
    """Gyro without errors."""

    def measure(self, state, truth, conditions, dt):
        return state, truth.yaw_rate


def test_sensor_of_the_suite_can_be_replaced_by_a_subclass():
    """The method `measure` of the subclass is called, and the noise of other sensors does not change."""
    (_, exact), (_, noisy) = (drive(Sensors(gyro=kind(enabled=True)))[-1] for kind in (ExactGyro, Gyro))
    assert exact.gyro == exact.readings["gyro"] == 0.1 != noisy.gyro
    assert exact.fix == noisy.fix
    assert exact[3:5] == noisy[3:5]


def test_sensor_columns_have_distinct_names_and_descriptions():
    columns = ALL_ON.columns
    assert len({column.name for column in columns}) == len(columns) > 0
    assert all(column.name.isidentifier() and column.unit and column.description for column in columns)
    state, _ = drive(ALL_ON, ticks=1)[-1]
    assert len(ALL_ON.report(state)) == len(columns)


def test_disabled_sensors_have_no_columns():
    names = {column.name for column in Sensors().columns}
    assert names.isdisjoint({"gyro", "imu_roll", "imu_pitch"})
    assert {"gyro", "imu_roll"} <= {
        column.name for column in Sensors(gyro=Gyro(enabled=True), imu=Imu(enabled=True)).columns
    }
