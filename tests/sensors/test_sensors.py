from math import degrees, exp, isnan, radians, sqrt

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.signal import savgol_filter

from agrobot_mj.core.randomness import stream
from agrobot_mj.core.signals import NOMINAL, Quality, Truth
from agrobot_mj.sensors import Gnss, Gyro, PedalPotentiometer, Potentiometer, Sensors, SteeringPotentiometer
from agrobot_mj.sensors.potentiometer import savgol_matrix

DT = 0.05
PERFECT = Gnss(sigma_m=0.0, float_sigma_m=0.0, velocity_sigma_m_s=0.0)


def truth(t=0.0, x=10.0, y=-5.0, steer=0.1, pedal=0.5, yaw_rate=0.0, n=25):
    """Return the true state of a tractor whose CG is not at the antenna."""
    return Truth(
        *(t, x - 1.0, y - 1.0, 0.5, 0.3, 0.0, 0.0, 1.2, 0.0, yaw_rate, steer, pedal, x + 0.3, y + 0.3),
        antenna=(x, y, 2.0),
        antenna_velocity=(1.1, 0.4, 0.0),
        steer_samples=np.full(n, steer),
        pedal_samples=np.full(n, pedal),
    )


def record(sensors, ticks, seed=1, quality=lambda k: Quality.FIX, state_of=lambda k: truth(k * DT)):
    state, measurements = sensors.init(seed), []
    for k in range(ticks):
        state, measurement = sensors.measure(state, state_of(k), NOMINAL._replace(gnss_quality=quality(k)), DT)
        measurements.append(measurement)
    return measurements


# --- potentiometers


def test_potentiometer_filter_is_savitzky_golay_followed_by_a_mean():
    pot = Potentiometer()
    assert pot.weights.shape == (100,)
    assert pot.weights.sum() == pytest.approx(1.0, abs=1e-12)
    for raw in np.random.default_rng(0).normal(size=(20, 100)):
        chain = savgol_filter(raw, pot.savgol_window, pot.savgol_polyorder).mean()
        assert pot.weights @ raw == pytest.approx(chain, abs=1e-12)


@pytest.mark.parametrize(("steps", "samples"), [(25, 100), (10, 100), (100, 100), (1, 5), (50, 21), (7, 40)])
def test_compiled_measurement_equals_the_sequence_of_its_steps(steps, samples):
    pot, rng = Potentiometer(samples=samples, savgol_window=3, savgol_polyorder=1), np.random.default_rng(steps)
    history = rng.uniform(-0.5, 0.5, steps)
    given, wanted = np.arange(1, steps + 1) / steps, np.arange(1, samples + 1) / samples
    degrees = np.degrees(np.interp(wanted, given, history)) + 0.5 * stream(4, "pot").standard_normal(samples)
    assert pot.read(history, stream(4, "pot")) == pytest.approx(np.radians(pot.weights @ np.rint(degrees)), abs=1e-13)


def test_potentiometer_filter_weights_change_with_the_filter_settings():
    pot = Potentiometer()
    assert not np.allclose(pot.weights, pot.model_copy(update={"savgol_window": 5}).weights)


@pytest.mark.parametrize(
    ("samples", "window", "order"), [(100, 21, 3), (21, 21, 3), (10, 5, 2), (3, 3, 1), (60, 1, 0), (90, 41, 4)]
)
def test_savitzky_golay_filter_agrees_with_scipy_including_both_ends(samples: int, window: int, order: int) -> None:
    theirs = savgol_filter(np.eye(samples), window, order, axis=0)
    assert savgol_matrix(samples, window, order) == pytest.approx(theirs, abs=1e-12)


def test_potentiometer_samples_are_quantised_before_filtering():
    pot = Potentiometer(noise_sigma_deg=0.0)
    ramp_deg = np.linspace(0.1, 10.1, 100)
    chain = savgol_filter(np.rint(ramp_deg), pot.savgol_window, pot.savgol_polyorder).mean()
    assert degrees(pot.read(np.radians(ramp_deg), stream(0, "pot"))) == pytest.approx(chain, abs=1e-12)
    assert degrees(pot.read(np.radians([0.4]), stream(0, "pot"))) == pytest.approx(0.0, abs=1e-12)
    assert degrees(pot.read(np.radians([0.6]), stream(0, "pot"))) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("angle_deg", [0.0, 0.25, 0.5, 12.37, -44.9])
def test_sensor_noise_reduces_the_quantisation_error_of_a_static_angle(angle_deg):
    pot, generator = Potentiometer(), stream(1, "steering_pot")
    history = np.full(25, radians(angle_deg))
    readings = np.degrees([pot.read(history, generator) for _ in range(400)])
    sigma = sqrt(pot.noise_sigma_deg**2 + 1 / 12) * np.linalg.norm(pot.weights)
    assert readings.std() == pytest.approx(sigma, rel=5 / sqrt(2 * 400))
    rest_of_rounding = exp(-2 * (np.pi * pot.noise_sigma_deg) ** 2) / np.pi  # first harmonic [Widrow]
    assert abs(readings.mean() - angle_deg) < rest_of_rounding + 5 * sigma / sqrt(400)
    assert np.abs(readings - angle_deg).max() < 0.4


@pytest.mark.parametrize("n", [1, 2, 25, 100, 250])
def test_potentiometer_works_for_any_number_of_physics_steps(n):
    pot = Potentiometer(noise_sigma_deg=0.0, resolution_deg=1e-6)
    assert pot.read(np.full(n, 0.3), stream(0, "pot")) == pytest.approx(0.3, abs=1e-7)


@pytest.mark.parametrize("n", [25, 50, 100])
def test_potentiometer_measurement_of_a_ramp_is_its_mean_over_the_tick(n):
    """Accuracy is 1 % of the change: samples end at the tick, and are held before the first physics step."""
    pot = Potentiometer(noise_sigma_deg=0.0, resolution_deg=1e-6)
    ramp = 0.2 + 0.1 * np.arange(1, n + 1) / n
    assert pot.read(ramp, stream(0, "pot")) == pytest.approx(0.25, abs=0.1 / 100)


def test_pedal_potentiometer_measures_in_pedal_units():
    pot, generator = PedalPotentiometer(), stream(1, "pedal_pot")
    readings = [pot.read(np.full(25, -0.73), generator) for _ in range(200)]
    assert np.mean(readings) == pytest.approx(-0.73, abs=0.002)
    coarse = PedalPotentiometer(noise_sigma_deg=0.0)
    assert coarse.read(np.array([0.99]), generator) == pytest.approx(1.0, abs=1e-12)
    assert coarse.read(np.array([0.974]), generator) == pytest.approx(24 / 25, abs=1e-12)


# --- GNSS


def errors(gnss, ticks, quality=Quality.FIX):
    """Return the errors of x, y [m] and vx, vy [m/s], shape (ticks, 4)."""
    state, now, fixes = gnss.init(5), truth(), []
    for _ in range(ticks):
        state, (fix, _) = gnss.measure(state, now, NOMINAL._replace(gnss_quality=quality), DT)
        fixes.append(fix)
    return np.array(fixes)[:, :4] - [*now.antenna[:2], *now.antenna_velocity[:2]]


def covariances(error, lags):
    """Return the sample autocovariance about the known mean of zero, by lag."""
    n = len(error)
    return np.array([error[: n - lag] @ error[lag:] / (n - lag) for lag in lags])


def tolerance(gamma, lag, n):
    """Return five sigma of the sample autocovariance of Gaussian series with covariance `gamma(lag)` [Bartlett]."""
    j = np.arange(-n // 4, n // 4 + 1)
    return 5 * sqrt((gamma(j) ** 2 + gamma(j + lag) * gamma(j - lag)).sum() / n)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_position_error_has_the_configured_sigma_and_correlation_time(fraction):
    gnss, n = Gnss(correlated_fraction=fraction, correlation_time_s=0.25), 20_000

    def gamma(lag):
        return gnss.sigma_m**2 * ((1 - fraction) * (lag == 0) + fraction * np.exp(-np.abs(lag) * DT / 0.25))

    lags = np.array([0, 1, 3, 5, 10, 20])
    for error in errors(gnss, n).T[:2]:
        for lag, covariance in zip(lags, covariances(error, lags), strict=True):
            assert abs(covariance - gamma(lag)) < tolerance(gamma, lag, n)


def test_velocity_error_is_white_noise_with_the_configured_sigma():
    n, sigma = 5000, Gnss().velocity_sigma_m_s
    error = errors(Gnss(), n)[:, 2:]
    assert np.allclose(error.std(axis=0), sigma, rtol=5 / sqrt(2 * n))
    assert abs(np.corrcoef(error[1:, 0], error[:-1, 0])[0, 1]) < 5 / sqrt(n)


def test_float_solution_has_a_separate_position_sigma():
    n, gnss = 2000, Gnss(float_correlated_fraction=0.0)
    error = errors(gnss, n, Quality.FLOAT)[:, :2]
    assert np.allclose(error.std(axis=0), gnss.float_sigma_m, rtol=5 / sqrt(2 * n))


def test_position_error_starts_in_its_stationary_distribution():
    gnss, n = Gnss(correlated_fraction=1.0), 2000
    first = [gnss.measure(gnss.init(seed), truth(), NOMINAL, DT)[1].fix.x - 10.0 for seed in range(n)]
    assert np.std(first) == pytest.approx(gnss.sigma_m, rel=5 / sqrt(2 * n))


def test_measured_position_is_the_antenna_position():
    fix = record(Sensors(gnss=PERFECT), 1)[0].fix
    assert fix[:6] == (10.0, -5.0, 1.1, 0.4, 0.0, 2.0)


@pytest.mark.parametrize("ticks", [0, 1, 4])
def test_gnss_latency_delays_the_solution_by_whole_ticks(ticks):
    sensors = Sensors(gnss=PERFECT.model_copy(update={"latency_s": ticks * DT}))
    outage = 6
    log = record(
        sensors,
        20,
        quality=lambda k: Quality.NONE if k == outage else Quality.FIX,
        state_of=lambda k: truth(k * DT, x=float(k)),
    )
    for k, measurement in enumerate(log):
        if k < ticks or k == outage + ticks:
            assert (measurement.fix, measurement.quality) == (None, Quality.NONE)
        else:
            assert (measurement.fix.x, measurement.quality) == (k - ticks, Quality.FIX)
            assert measurement.fix.t == pytest.approx((k - ticks) * DT)


def test_gnss_latency_of_fractional_ticks_is_rejected():
    with pytest.raises(ValidationError, match=r"latency_s(.|\n)*0.12 is not a multiple.*try 0.1"):
        Gnss(latency_s=0.12)


def test_lost_solution_gives_no_fix_and_leaves_later_noise_unchanged():
    def quality(k):
        return Quality.NONE if 3 <= k < 6 else Quality.FIX

    sensors = Sensors(gyro=Gyro(enabled=True))
    whole, gap = record(sensors, 10), record(sensors, 10, quality=quality)
    assert [m.fix is None for m in gap] == [3 <= k < 6 for k in range(10)]
    assert [m.quality for m in gap] == [quality(k) for k in range(10)]
    assert gap[6:] == whole[6:]


# --- gyro and the whole


def test_gyro_is_absent_by_default():
    assert isnan(record(Sensors(), 1)[0].gyro)


def test_enabled_gyro_has_the_configured_noise_and_bias():
    gyro, n = Gyro(enabled=True, sigma_deg_s=0.2, bias_deg_s=0.5), 2000
    log = record(Sensors(gyro=gyro), n, state_of=lambda k: truth(yaw_rate=radians(3.0)))
    readings = np.degrees([m.gyro for m in log])
    assert readings.mean() == pytest.approx(3.5, abs=5 * 0.2 / sqrt(n))
    assert readings.std() == pytest.approx(0.2, rel=5 / sqrt(2 * n))


def test_equal_seeds_give_equal_measurements():
    sensors = Sensors(gyro=Gyro(enabled=True))
    one, again, two = (record(sensors, 5, seed=seed) for seed in (1, 1, 2))
    assert one == again
    for name in ("fix", "steer", "pedal", "gyro"):
        assert getattr(one[4], name) != getattr(two[4], name)


def test_number_of_physics_steps_per_tick_may_differ_between_runs():
    sensors, plain = Sensors(), {}
    for steps in (25, 10, 40, 25):
        _, measured = sensors.measure(sensors.init(1), truth(n=steps), NOMINAL, DT)
        assert measured.steer == pytest.approx(0.1, abs=0.01)
        assert plain.setdefault(steps, measured) == measured


def test_noise_of_different_measurement_channels_is_independent():
    gnss, n = Gnss(correlated_fraction=0.5, correlation_time_s=DT), 2000
    log = record(Sensors(gnss=gnss, gyro=Gyro(enabled=True)), n, state_of=lambda k: truth())
    channels = np.array([[*m.fix[:4], m.steer, m.pedal, m.gyro] for m in log]).T
    assert np.abs(np.corrcoef(channels) - np.eye(7)).max() < 6 / sqrt(n)


@pytest.mark.parametrize(
    "changed",
    [
        Sensors(gyro=Gyro(enabled=True)),
        Sensors(pedal_pot=PedalPotentiometer(samples=40, noise_sigma_deg=2.0)),
        Sensors(gnss=Gnss(sigma_m=0.5, latency_s=0.1)),
        Sensors(steering_pot=SteeringPotentiometer(samples=50)),
    ],
)
def test_changed_sensor_settings_do_not_change_the_noise_of_others(changed):
    default = Sensors()
    for before, after in zip(record(default, 20), record(changed, 20), strict=True):
        if changed.gnss == default.gnss:
            assert after.fix == before.fix
        if changed.steering_pot == default.steering_pot:
            assert after.steer == before.steer
        if changed.pedal_pot == default.pedal_pot:
            assert after.pedal == before.pedal


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"savgol_window": 20}, "odd"),
        ({"samples": 10}, "must not exceed samples"),
        ({"savgol_window": 3}, "below savgol_window"),
        ({"resolution_deg": 0.0}, "greater than 0"),
        ({"resolution": 1.0}, "Extra inputs"),
    ],
)
def test_impossible_potentiometer_is_rejected(keys, message):
    with pytest.raises(ValidationError, match=message):
        Potentiometer(**keys)
