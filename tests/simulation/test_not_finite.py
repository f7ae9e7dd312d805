"""Non-finite numbers: the run ends with an error that names the source; invalid measurements count as missing."""

import json
from math import copysign, inf, nan
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq
import pytest
from processes import command

from agrobot_mj import Simulation, load_scenario, run
from agrobot_mj.core.errors import CommandError, NotFiniteError, ScenarioError
from agrobot_mj.core.kernels import fetched, held
from agrobot_mj.core.signals import Array, Command, Conditions, Drive, Estimate, PointMass
from agrobot_mj.estimation import Ekf
from agrobot_mj.paths import FigureEight
from agrobot_mj.plants import BicyclePlant
from agrobot_mj.sensors import Suite
from agrobot_mj.simulation.checks import Numbers
from agrobot_mj.simulation.low_level import LowLevelLoops
from agrobot_mj.simulation.run import run as run_without_hints
from agrobot_mj.simulation.storage import write_log

pytestmark = pytest.mark.usefixtures("single_ticks")
SHORT = {"duration_s": 1.5, "plant.kind": "bicycle", "supervisor.enabled": False}


PLUGIN = """
from math import nan
from typing import Literal
from agrobot_mj import register
from agrobot_mj.control.base import YawCommand, YawController

@register
class NanSteer(YawController):
    \"\"\"A controller that loses its mind in tick 10.\"\"\"
    kind: Literal["nan_steer"] = "nan_steer"

    def init(self):
        return 0

    def update(self, state, t, yaw_rate_error, dt, steer_limit):
        return state + 1, YawCommand(nan if state == 10 else 0.0)
"""


def spoiled(monkeypatch, owner, method, change, at=10):
    """Change the result of a method by the function `change` in tick `at`."""
    whole, calls = getattr(owner, method), []

    def wrapped(*arguments, **options):
        found = whole(*arguments, **options)
        calls.append(1)
        return change(found) if len(calls) == at else found

    monkeypatch.setattr(owner, method, wrapped)


def second(**fields):
    """Return a function that changes the second of two outputs."""
    return lambda found: (found[0], found[1]._replace(**fields))


def moved(**fields):
    """Return a function that changes the true state returned by a plant."""
    return lambda truth: held(fetched(truth)._replace(**fields))


def without(field, state):
    """Return the state of an estimator in which the array `field` is NaN."""
    numbers = fetched(state.numbers)
    return state._replace(numbers=held(numbers._replace(**{field: getattr(numbers, field) * nan})))


STAGES = [
    (BicyclePlant, "advance_held", moved(antenna=(nan, 0.0, 2.0)), "truth.antenna is nan", "bicycle"),
    (BicyclePlant, "advance_held", moved(yaw=inf), "truth.yaw is inf", "bicycle"),
    (BicyclePlant, "advance_held", moved(steer_samples=np.full(25, nan)), "truth.steer_samples is nan", "bicycle"),
    (Ekf, "update", second(yaw=nan), "estimate.yaw is nan", "ekf"),
    (Ekf, "update", second(yaw_rate=-inf), "estimate.yaw_rate is -inf", "ekf"),
    (Ekf, "update", second(sideslip=nan), "estimate.sideslip is nan", "ekf"),
    (Ekf, "update", second(covariance=np.full((3, 3), nan)), "estimate.covariance is nan", "ekf"),
    (
        Ekf,
        "update",
        lambda found: (without("pose", found[0]), found[1]),
        "failed: array must not contain infs or NaNs",
        "ekf",
    ),
    (Ekf, "init", lambda state: without("pose_covariance", state), "", "ekf"),
    (FigureEight, "at", lambda reference: reference._replace(vx=nan), "reference.vx is nan", "figure_eight"),
    (FigureEight, "at", lambda reference: reference._replace(x=inf), "reference.x is inf", "figure_eight"),
]


@pytest.mark.parametrize(("owner", "method", "change", "what", "who"), STAGES)
def test_error_names_the_stage_that_returns_a_non_finite_value(monkeypatch, tmp_path, owner, method, change, what, who):
    scenario = load_scenario("figure_eight", SHORT)
    spoiled(monkeypatch, owner, method, change, at=1 if method == "init" else 10)
    log = run_without_hints(scenario)  # hints ask the path for its course, too
    assert log.outcome == log.metrics["outcome"] == "diverged"
    assert what in log.metrics["stop_reason"]
    assert f"({who})" in log.metrics["stop_reason"]
    assert all(np.isfinite(log.column(name)[1:]).all() for name in ("x", "x_hat", "x_ref", "steer_ref"))
    write_log(log, tmp_path)
    assert json.loads((tmp_path / "metrics.json").read_text())["outcome"] == "diverged"


@pytest.mark.parametrize("guidance", ["kinematic", "lqr"])
def test_error_names_the_guidance_law_that_returns_a_non_finite_command(monkeypatch, guidance):
    scenario = load_scenario("figure_eight", {**SHORT, "guidance.kind": guidance})
    law = type(scenario.guidance.using(scenario.controller))
    spoiled(monkeypatch, law, "update", second(steer=nan))
    assert run(scenario).metrics["stop_reason"] == f"command.steer is nan, returned by the guidance law ({guidance})"


@pytest.mark.parametrize("angle", [1e9, -10.0, 1.58])
@pytest.mark.parametrize("guidance", ["kinematic", "lqr"])
def test_error_names_the_law_that_commands_an_impossible_steering_angle(monkeypatch, guidance, angle):
    scenario = load_scenario("figure_eight", {**SHORT, "guidance.kind": guidance})
    law = type(scenario.guidance.using(scenario.controller))
    spoiled(monkeypatch, law, "update", second(steer=angle))
    log = run(scenario)
    assert log.outcome == "diverged"
    assert f"deg, more than 90 deg, returned by the guidance law ({guidance})" in log.metrics["stop_reason"]


@pytest.mark.parametrize("angle", [0.8, 1.2, -1.57])
def test_steering_angle_above_the_limit_is_clipped(monkeypatch, angle):
    """The angle exceeds the limit for one tick. The derivative of the steering loop would remember it for seconds."""
    scenario = load_scenario("figure_eight", {**SHORT, "guidance.kind": "lqr"})
    law, limit = type(scenario.guidance), scenario.tractor.steer_limit
    logs = []
    for steer in (angle, copysign(limit, angle)):
        with monkeypatch.context() as patched:
            spoiled(patched, law, "update", second(steer=steer))
            logs.append(run(scenario))
    assert logs[0].outcome == "completed"
    assert abs(logs[0].column("steer_ref")).max() == limit
    assert logs[0].signals.equals(logs[1].signals)


def test_impossible_steering_angle_of_an_external_command_is_rejected():
    sim = Simulation("circle", {"plant.kind": "bicycle"})
    sim.reset()
    with pytest.raises(CommandError, match="steer: must be between -pi/2 and pi/2 rad, got 30"):
        sim.step(steer=30.0)
    sim.step(steer=1.5)
    assert sim.log().column("steer_ref")[-1] == sim.scenario.tractor.steer_limit


def test_guidance_law_cannot_modify_the_covariance_of_the_estimate(monkeypatch):
    scenario = load_scenario("figure_eight", {**SHORT, "guidance.kind": "lqr"})
    sim = Simulation(scenario)
    sim.reset()
    for situation in (sim.situation, sim.restore(sim.save()) and sim.situation):
        with pytest.raises(ValueError, match="read-only"):
            situation.estimate.covariance[:] = 0.0


def test_error_names_the_plugin_controller_with_a_non_finite_command(tmp_path):
    """The test needs a separate process, because a registration lasts until the end of a process."""
    (tmp_path / "nan_steer.py").write_text(PLUGIN, encoding="utf-8")
    sets = [*(f"{key}={value}".lower() for key, value in SHORT.items()), "controller.kind=nan_steer"]
    arguments = ["run", "figure_eight", "--plugin", "nan_steer.py", "--no-rrd", "--quiet", "--out", "out"]
    arguments += [word for text in sets for word in ("--set", text)]
    done = command(tmp_path, *arguments)
    assert done.returncode == 1, done.stderr
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text("utf-8"))
    assert metrics["outcome"] == "diverged"
    assert "steer nan rad" in metrics["stop_reason"]
    assert "of the controller (nan_steer) is not finite" in metrics["stop_reason"]
    assert pq.read_metadata(tmp_path / "out" / "signals.parquet").num_rows == 10


def test_error_names_the_control_loop_with_a_non_finite_voltage(monkeypatch):
    scenario = load_scenario("figure_eight", SHORT)
    spoiled(monkeypatch, LowLevelLoops, "drive", lambda found: found._replace(steer_voltage=nan))
    assert (
        run(scenario).metrics["stop_reason"].startswith("drive.steer_voltage is nan, returned by the low-level loops")
    )


def test_exceptions_in_an_estimator_are_passed_on_unchanged(monkeypatch):
    scenario = load_scenario("figure_eight", SHORT)

    def fails(found):
        raise ValueError("not enough values to unpack")

    spoiled(monkeypatch, Ekf, "update", fails)
    with pytest.raises(ValueError, match="not enough values"):
        run(scenario)


@pytest.mark.parametrize(
    ("field", "value", "column"),
    [
        ("fix", {"x": nan}, "gnss_x"),
        ("fix", {"y": 1e12}, "gnss_x"),
        ("fix", {"vy": inf}, "gnss_x"),
        ("steer", nan, "steer_measured"),
        ("pedal", inf, "pedal_measured"),
    ],
)
def test_non_finite_measurement_is_treated_as_missing(monkeypatch, field, value, column):
    scenario = load_scenario("figure_eight", SHORT)
    whole = run(scenario)

    def bad(found):
        state, measured = found
        return state, measured._replace(**{field: measured.fix._replace(**value) if field == "fix" else value})

    spoiled(monkeypatch, Suite, "measure", bad)
    log = run(scenario)
    assert log.outcome == "completed"
    assert log.metrics["rejected_readings"] == {field: 1}
    seen = log.column(column)
    assert np.isnan(seen[9]) if field == "fix" else seen[9] == seen[8]
    assert log.column("gnss_quality")[9] == (0 if field == "fix" else 2)
    for name in ("x", "x_hat", "steer_ref", "pedal_voltage"):
        np.testing.assert_allclose(log.column(name), whole.column(name), atol=0.1 if name != "pedal_voltage" else 7.0)
    assert "rejected_readings" not in whole.metrics


def test_non_finite_optional_measurements_are_ignored_and_counted(monkeypatch):
    units = {f"sensors.{name}.enabled": True for name in ("gyro", "imu")}
    keys = {"estimator.yaw_rate_source": "gyro", "estimator.terrain_compensation": True}
    scenario = load_scenario("figure_eight", SHORT | units | keys)
    spoiled(monkeypatch, Suite, "measure", second(gyro=inf, roll=inf, pitch=nan))
    log = run(scenario)
    assert log.outcome == "completed"
    assert log.metrics["rejected_readings"] == {"gyro": 1, "roll": 1}
    assert np.isfinite(log.column("yaw_rate_hat")).all()


def test_run_that_diverges_while_settling_has_one_log_row_without_values(monkeypatch, tmp_path):
    scenario = load_scenario("figure_eight", SHORT)
    monkeypatch.setattr(BicyclePlant, "trouble", lambda plant: "diverged")
    sim = Simulation(scenario)
    measured = sim.reset()
    assert sim.done
    assert np.isnan(measured.steer)
    log = run(scenario)
    assert (log.outcome, log.rows.filled, log.column("t")[0]) == ("diverged", 1, 0.0)
    assert "(bicycle) diverged while settling" in log.metrics["stop_reason"]
    write_log(log, tmp_path)


def test_diverging_plant_ends_the_run_as_diverged(monkeypatch):
    scenario = load_scenario("figure_eight", SHORT)
    whole = BicyclePlant.advance_held

    def advanced(plant, drive: Drive, conditions):
        if plant.ticks == 5:
            plant.state[0] = nan
        return whole(plant, drive, conditions)

    monkeypatch.setattr(BicyclePlant, "advance_held", advanced)
    assert "(bicycle) is not finite" in run(scenario).metrics["stop_reason"]


def test_error_names_a_numerically_singular_filter():
    log = run(load_scenario("figure_eight", {**SHORT, "estimator.initial_velocity_sigma_m_s": 1e9}))
    assert log.outcome == "diverged"
    reason = "the estimator (ekf) failed: the innovation covariance is not positive definite"
    assert log.metrics["stop_reason"] == reason


class Inner(NamedTuple):
    """Nested message in a `Sample`."""

    gain: float = 1.0
    word: str = "east"
    rate: float = 0.0


class Sample(NamedTuple):
    """Message with a field of every type."""

    x: float
    word: str
    samples: Array
    place: tuple[float, float]
    wanted: float | None = None
    count: int = 0
    heading: float = nan
    rates: tuple[float, float] = (nan, nan)
    inner: Inner = Inner()


SOUND = Sample(1.0, "nan", np.ones(3), (1.0, 2.0))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"x": nan}, "sample.x is nan, returned by a test"),
        ({"samples": np.array([1.0, inf, nan])}, "sample.samples is inf, returned by a test"),
        ({"place": (0.0, -inf)}, "sample.place is -inf, returned by a test"),
        ({"wanted": inf}, "sample.wanted is inf, returned by a test"),
        ({"inner": Inner(rate=nan)}, "sample.inner.rate is nan, returned by a test"),
        ({"x": 1e308, "place": (1e308, 1e308)}, "sample, returned by a test, overflows"),
    ],
)
def test_error_names_the_non_finite_field_of_a_return_value(changes, named):
    Numbers(Sample).check(SOUND, "a test")
    with pytest.raises(NotFiniteError, match=f"^{named}$"):
        Numbers(Sample).check(SOUND._replace(**changes), "a test")


def test_field_of_a_return_value_may_be_nan_if_its_default_is_nan():
    untold = SOUND._replace(heading=nan, rates=(nan, 1.0), wanted=None)
    Numbers(Sample).check(untold, "a test")
    Numbers(Sample, but=("samples",)).check(untold._replace(samples=np.array([nan])), "a test")


def test_return_value_with_non_numeric_fields_is_rejected():
    for changes in ({"x": "east"}, {"place": None}, {"samples": 1.0}):
        with pytest.raises(ScenarioError, match=r"^a test returned a non-numeric sample: Sample\("):
            Numbers(Sample).check(SOUND._replace(**changes), "a test")


@pytest.mark.parametrize(
    ("message", "changes", "named"),
    [
        (Estimate, {"nis": None}, "estimate.nis is None"),
        (Estimate, {"position_sigma": "1"}, "estimate.position_sigma is '1'"),
        (Estimate, {"fix_age": np.ones(2)}, r"estimate.fix_age is array\(\[1., 1.\]\)"),
        (Estimate, {"aligned": np.array([True, False])}, "estimate.aligned is array"),
        (Estimate, {"covariance": [[1.0]]}, r"estimate.covariance is \[\[1.0\]\]"),
        (Command, {"speed": 10**400}, "command.speed is 1000"),
        (Command, {"pedal": "half"}, "command.pedal is 'half'"),
        (Conditions, {"gnss_offset": [1.0, 1.0]}, "conditions.gnss_offset must be a tuple of 2 numbers, got"),
        (Conditions, {"tyre_rolling": (1.0,) * 3}, "conditions.tyre_rolling must be a tuple of 4 numbers, got"),
        (Conditions, {"gyro": 1.0}, "returned 1.0 as conditions.gyro; return an object of Distortion"),
        (Conditions, {"payload": PointMass(1.0, 0.0, 0.0, 0.0)}, "returned 1.0 as conditions.payload; return an obj"),
        (Conditions, {"payload": ((1.0, 0.0, 0.0, 0.0),)}, "as conditions.payload; return an object of PointMass"),
    ],
)
def test_error_names_the_field_of_a_wrong_type(message, changes, named):
    sound = {
        Estimate: Estimate(*[0.0] * 7, np.eye(3)),
        Command: Command(0.0, 1.0),
        Conditions: Conditions(payload=(PointMass(1.0, 0.0, 0.0, 0.0),)),
    }[message]
    Numbers(message).check(sound, "a test")
    with pytest.raises(ScenarioError, match=named):
        Numbers(message).check(sound._replace(**changes), "a test")
