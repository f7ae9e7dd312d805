"""Components of the cross-track error, their causes, and estimates inconsistent with their covariance."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core.signals import Quality
from agrobot_mj.faults.gnss import GnssLatency
from agrobot_mj.metrics import RunView, metrics
from agrobot_mj.metrics.attribution import parts_of
from agrobot_mj.metrics.crosstrack import cross_track
from agrobot_mj.metrics.estimate_error import FLOAT, GNSS, HEADING, LATENCY, LEAN, LOSS, UNIT, cause_of, contributions
from agrobot_mj.paths import Circle, LaneChange, Line
from agrobot_mj.sensors.gnss import Gnss
from agrobot_mj.simulation.columns import COLUMNS
from agrobot_mj.simulation.diagnosis import attribution

ANTENNA_M, CG_M, ARM_M = 2.7, 0.8, 0.9


class LoggedRun:
    """Straight run to the north with a perfect estimate, except for the given columns."""

    def __init__(
        self, path: Any = None, compensated: bool = False, latency_s: float = 0.0, fault: Any = (), **columns: Any
    ) -> None:
        self.scenario = SimpleNamespace(
            path=path or Line(heading_deg=90.0),
            duration_s=None,
            fault=fault,
            tractor=SimpleNamespace(
                antenna_height_m=ANTENNA_M, antenna_ahead_m=0.0, antenna_left_m=0.0, cg_height_m=CG_M
            ),
            sensors=SimpleNamespace(gnss=Gnss(latency_s=latency_s)),
            estimator=SimpleNamespace(terrain_compensation=compensated),
            implement=SimpleNamespace(receiver=False),
        )
        t = np.arange(0.0, 20.0, 0.05)
        north = {"t": t, "yaw": np.pi / 2, "y": 1.5 * t, "rear_y": 1.5 * t - ARM_M, "gnss_quality": Quality.FIX}
        north |= {"y_hat": 1.5 * t, "rear_y_hat": 1.5 * t - ARM_M, "gnss_y": 1.5 * t - ARM_M}
        given = {name: np.zeros(len(t)) + value for name, value in {**north, **columns}.items()}
        self.columns = {name: np.zeros(len(t)) for name in COLUMNS} | given

    def column(self, name: str) -> Any:
        return self.columns[name]


def leaning(roll: float, **more: Any) -> LoggedRun:
    """Return a run along a side slope. The filter ignores the antenna tilt, and the true CG is tilted as well."""
    antenna, cg = ANTENNA_M * np.sin(roll), CG_M * np.sin(roll)  # to the east, on the right
    return LoggedRun(roll=roll, x=cg, gnss_x=antenna, x_hat=antenna, rear_x_hat=antenna, **more)


@pytest.mark.parametrize("path", [Line(heading_deg=-35.0), Circle(radius_m=7.0), LaneChange()], ids=lambda p: p.kind)
def test_error_contributions_add_up_to_the_cross_track_error(path: Any) -> None:
    rng, t = np.random.default_rng(8), np.arange(0.0, 20.0, 0.05)
    on = np.array([path.at(float(s)) for s in t])
    truth, estimate = (on[:, :2] + rng.normal(0.0, 0.15, (len(t), 2)) for _ in range(2))
    estimate[360:390] += 3.0  # so far apart, in the lane change, that each has a nearest point of its own
    log = LoggedRun(path, t=t, x=truth[:, 0], y=truth[:, 1], x_hat=estimate[:, 0], y_hat=estimate[:, 1])
    parts = parts_of(RunView(log))
    assert parts.estimator + parts.guidance == pytest.approx(cross_track(path, t, *truth.T))
    assert parts.guidance == pytest.approx(cross_track(path, t, *estimate.T), abs=2e-3)


def test_estimator_contribution_on_a_line_is_the_lateral_estimate_error() -> None:
    yaw = np.radians(24.0)
    log = LoggedRun(Line(heading_deg=24.0), yaw=yaw, x=3.0 - 0.2 * np.sin(yaw), y=0.2 * np.cos(yaw), x_hat=3.0, y_hat=0)
    along = 3.0 * np.sin(yaw)  # (3, 0) lies to the right of the line
    parts = parts_of(RunView(log))
    assert parts.estimator == pytest.approx(0.2)
    assert parts.guidance == pytest.approx(-along)


def test_lateral_antenna_shift_is_height_times_sine_of_roll() -> None:
    roll = np.radians(6.0)
    view = RunView(leaning(roll))
    wanted = (ANTENNA_M - CG_M) * np.sin(roll)
    assert parts_of(view).estimator == pytest.approx(wanted)
    assert contributions(view)[1][LEAN].imag == pytest.approx(wanted)
    assert metrics(view.log)["xte_estimator_rms"] == pytest.approx(wanted)
    assert cause_of(view, across=True) == LEAN


def test_estimator_contributions_of_a_perfect_estimate_are_zero() -> None:
    error, parts = contributions(RunView(LoggedRun()))
    assert not error.any()
    assert all(np.abs(part).max() < 1e-12 for part in parts.values())
    assert cause_of(RunView(LoggedRun()), across=False) == ""


CASES = {
    HEADING: {"x_hat": -0.25},
    GNSS: {"gnss_x": 0.3, "x_hat": 0.3, "rear_x_hat": 0.3},
    LOSS: {"gnss_x": np.nan, "gnss_y": np.nan, "gnss_quality": Quality.NONE, "x_hat": 0.4, "rear_x_hat": 0.4},
    FLOAT: {"gnss_quality": Quality.FLOAT, "gnss_x": 0.5, "x_hat": 0.5, "rear_x_hat": 0.5},
}


@pytest.mark.parametrize("cause", CASES)
def test_main_cause_of_the_cross_track_error_is_identified_from_the_log(cause: str) -> None:
    assert cause_of(RunView(LoggedRun(**CASES[cause])), across=True) == cause


@pytest.mark.parametrize("own_s", [0.3, 0.2, 0.0])
def test_gnss_latency_is_the_cause_of_only_the_longitudinal_error(own_s: float) -> None:
    """Cases are the latency of the receiver, the latency of a fault from 6 s to 13 s, and the sum of both."""
    t, fault = np.arange(0.0, 20.0, 0.05), GnssLatency(start_s=6.0, end_s=13.0, latency_s=0.3)
    late_s = own_s + np.where((t > 5.99) & (t < 12.99), 0.3, 0.0)
    late = 1.5 * np.maximum(t - late_s, 0.0)
    log = LoggedRun(latency_s=own_s, fault=(fault,), y_hat=late, rear_y_hat=late - ARM_M, gnss_y=late - ARM_M)
    assert contributions(RunView(log))[1][LATENCY].real == pytest.approx(1.5 * t - late)
    assert cause_of(RunView(log), across=False) == LATENCY
    assert cause_of(RunView(log), across=True) == ""


def test_imu_error_and_uncompensated_roll_are_distinguished_as_causes() -> None:
    roll, measured = np.radians(5.0), np.radians(2.0)
    foot = ANTENNA_M * (np.sin(roll) - np.sin(measured))
    columns = {"roll": roll, "imu_roll": measured, "imu_pitch": 0.0, "x": CG_M * np.sin(roll)}
    columns |= {"gnss_x": ANTENNA_M * np.sin(roll), "rear_x_hat": foot, "x_hat": foot + CG_M * np.sin(measured)}
    log = LoggedRun(compensated=True, **columns)
    assert cause_of(RunView(log), across=True) == UNIT


def test_steering_error_is_angle_minus_command_of_the_previous_tick() -> None:
    command = 0.1 * np.sin(np.arange(400))
    follows = LoggedRun(steer_ref=command, steer=np.roll(command, 1))
    assert metrics(follows)["steer_error_rms"] == pytest.approx(0.0)
    assert metrics(LoggedRun(steer_ref=0.02, steer=-0.03))["steer_error_rms"] == pytest.approx(0.05)


SLOPE = {"duration_s": 20.0, "physics": "fast", "terrain.grade_deg": 4.0, "tractor.antenna_height_m": 2.4}
IMU = {"sensors.imu.enabled": True, "estimator.terrain_compensation": True}


@pytest.fixture(scope="module")
def on_slope() -> Any:
    """Return a run along a side slope with the estimator of the paper."""
    return run(load_scenario("side_slope_10", SLOPE))


def test_run_on_a_slope_reports_antenna_roll_and_an_effective_remedy(on_slope: Any) -> None:
    m = on_slope.metrics
    lean = (2.4 - on_slope.scenario.tractor.cg_height_m) * abs(np.sin(on_slope.column("roll")).mean())
    assert m["xte_estimator_rms"] == pytest.approx(lean, abs=0.015)
    assert (m["xte_cause"], m["xte_remedy"]) == (LEAN, "enable sensors.imu and estimator.terrain_compensation")
    assert attribution(m).endswith("guidance; enable sensors.imu and estimator.terrain_compensation")
    assert f"{100 * m['xte_estimator_rms']:.1f} cm estimator (antenna lean)" in attribution(m)
    remedied = run(on_slope.scenario.changed(IMU)).metrics
    assert remedied["xte_estimator_rms"] < 0.3 * m["xte_estimator_rms"]
    assert "xte_remedy" not in remedied


def test_suggested_remedy_lists_only_features_that_are_disabled(on_slope: Any) -> None:
    half = run(on_slope.scenario.changed({"sensors.imu.enabled": True})).metrics
    assert half["xte_remedy"] == "enable estimator.terrain_compensation"


def test_estimate_that_contradicts_its_covariance_is_reported(on_slope: Any) -> None:
    m = on_slope.metrics
    assert m["position_nees"] > 100
    numbers = f"position NEES {m['position_nees']:.0f}, NIS {m['position_nis']:.1f}, both 2 for a consistent filter"
    assert m["estimate_warning"] == f"the estimate contradicts its covariance ({numbers}): antenna lean"


FULL = {"estimator.kind": "ekf_full", "sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True}
FULL_TEXT = 'set estimator.kind = "ekf_full"; enable sensors.gyro and sensors.wheel_speed'
LOST = {"plant.kind": "bicycle", "duration_s": 40.0, "path.kind": "circle", "path.radius_m": 11.0}
LOST |= {"fault": [{"kind": "gnss_loss", "start_s": 20.0, "end_s": 36.0}]}
LEVEL = {**FULL, "plant.kind": "bicycle", "duration_s": 40.0, "guidance.kind": "lqr"}
DUAL = {**LEVEL, "sensors.gnss.dual_antenna.enabled": True}


EKF = {"plant.kind": "bicycle", "duration_s": 40.0}


@pytest.mark.parametrize("keys", [EKF, LEVEL, DUAL], ids=["ekf", "full", "dual"])
def test_estimate_consistent_with_its_covariance_gives_no_warning(keys: dict[str, Any]) -> None:
    for seed in (11, 12, 13):
        m = run(load_scenario("straight_line", {**keys, "seed": seed})).metrics
        assert "estimate_warning" not in m
        assert "xte_remedy" not in m


@pytest.mark.parametrize("mounting", [-5.0, 12.0])
def test_estimated_antenna_mounting_error_is_reported(mounting: float) -> None:
    m = run(load_scenario("straight_line", {**DUAL, "sensors.gnss.dual_antenna.mounting_deg": mounting})).metrics
    assert np.degrees(m["antenna_mounting"]) == pytest.approx(mounting, abs=0.4)
    assert abs(m["level_sideslip"]) < np.radians(0.5)
    angle = np.degrees(m["antenna_mounting"] - m["level_sideslip"])
    assert m["estimate_warning"].startswith(f"the antennas point {angle:.1f} deg off")


def test_antennas_that_rotate_during_a_run_are_reported_with_angle() -> None:
    """The estimator attributes a part of 7 deg to sideslip; only the sum is observable on level ground."""
    fault = [{"kind": "heading_bias", "bias_deg": 7.0, "start_s": 6.0}]
    m = run(load_scenario("straight_line", {**DUAL, "fault": fault})).metrics
    angle = float(m["estimate_warning"].partition("antennas point ")[2].partition(" deg")[0])
    assert angle == pytest.approx(7.0, abs=0.5)
    assert np.degrees(m["antenna_mounting"]) != pytest.approx(7.0, abs=0.3)


@pytest.mark.parametrize("mounting", [-2.6, 2.7])
def test_misaligned_antennas_are_reported(mounting: float) -> None:
    m = run(load_scenario("straight_line", {**DUAL, "sensors.gnss.dual_antenna.mounting_deg": mounting})).metrics
    assert np.degrees(m["level_sideslip"]) == pytest.approx(-mounting, abs=0.4)
    assert m["xte_cause"] == "antenna mounting"
    assert m["estimate_warning"].startswith(f"a steady sideslip of {np.degrees(m['level_sideslip']):.1f} deg on level")
    assert m["estimate_warning"].endswith("calibrate sensors.gnss.dual_antenna.mounting_deg")


def test_gnss_loss_is_reported_as_cause_with_an_effective_remedy() -> None:
    m = run(scenario := load_scenario("straight_line", {**LOST, "guidance.kind": "lqr"})).metrics
    assert (m["xte_cause"], m["xte_remedy"]) == (LOSS, FULL_TEXT)
    remedied = run(scenario.changed(FULL)).metrics
    assert remedied["xte_estimator_rms"] < 0.5 * m["xte_estimator_rms"]
    assert remedied["xte_rms"] < 0.7 * m["xte_rms"]


def test_latency_fault_is_reported_as_cause_with_an_effective_remedy() -> None:
    keys = {"plant.kind": "bicycle", "duration_s": 25.0, "path.speed_m_s": 2.1, "guidance.kind": "lqr"}
    own = load_scenario("slalom", {**keys, "sensors.gnss.latency_s": 0.35})
    fault = own.changed({"sensors.gnss.latency_s": 0.0, "fault": [{"kind": "gnss_latency", "latency_s": 0.35}]})
    first, second, remedied = (run(scenario) for scenario in (own, fault, fault.changed(FULL)))
    assert second.metrics["estimate_warning"] == first.metrics["estimate_warning"]
    assert second.metrics["estimate_warning"].endswith(f"{LATENCY}; {FULL_TEXT}")
    errors = [
        np.hypot(log.column("x") - log.column("x_hat"), log.column("y") - log.column("y_hat"))[100:]
        for log in (second, remedied)
    ]
    assert errors[1].mean() < 0.2 * errors[0].mean()


def test_cause_and_remedy_belong_to_the_larger_part_of_the_error() -> None:
    """With the law `kinematic`, guidance errors dominate, so the remedy for a loss of fixes is not suggested."""
    found = [
        run(load_scenario("straight_line", {**LOST, "guidance.kind": law})).metrics for law in ("kinematic", "lqr")
    ]
    parts = [m["xte_estimator_rms"] / m["xte_guidance_rms"] for m in found]
    assert parts[0] < 0.8
    assert parts[1] > 1.5
    assert [m.get("xte_remedy") for m in found] == [None, FULL_TEXT]
    assert [m["xte_cause"] for m in found] == ["guidance", LOSS]
    assert [f"estimator ({LOSS})" in attribution(m) for m in found] == [False, True]
    assert found[0]["estimate_warning"].endswith(f"{LOSS}; {FULL_TEXT}")  # of the estimate itself


def test_run_without_path_following_has_no_error_attribution() -> None:
    m = run(load_scenario("step_steer", {"plant.kind": "bicycle", "duration_s": 3.0})).metrics
    assert not m.keys() & {"xte_cause", "xte_remedy", "estimate_warning"}


def test_attribution_summary_includes_steering_if_guidance_dominates() -> None:
    parts = {"xte_rms": 0.07, "xte_estimator_rms": 0.012, "xte_guidance_rms": 0.068, "steer_error_rms": np.radians(3.0)}
    assert attribution(parts) == "7.0 cm cross-track: 1.2 cm estimator, 6.8 cm guidance (steering error 3.0 deg)"
    assert attribution({**parts, "xte_rms": None}) == ""
