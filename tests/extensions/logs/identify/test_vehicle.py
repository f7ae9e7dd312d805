"""`twin --only identify` returns the hidden stiffness of simulated tractors, or the reason for no result."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from machines import log_of, mistold

from agrobot_mj.core.table_columns import FieldLogError
from agrobot_mj.extensions.logs.identify.model import Chassis2
from agrobot_mj.extensions.logs.identify.vehicle import NothingExplainedError, check_stiffness, identify_vehicle
from agrobot_mj.extensions.logs.quantities import Quantity
from agrobot_mj.extensions.logs.words import vehicle_sentences
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.storage import write_log

HIDDEN = {
    "plant__front_cornering_stiffness_n_rad": 11_000.0,
    "plant__rear_cornering_stiffness_n_rad": 24_000.0,
}
BICYCLE = load_scenario("straight_line", {"plant.kind": "bicycle"})
STEADY = ("front", "rear", "offset", "delay", "backlash")
"""Fitted parameters without relaxation lengths, which the simulator's bicycle does not have."""


quickly = pytest.mark.usefixtures("quick_fit")


def said(result):
    """Return the printed text of an identification."""
    return "\n".join(vehicle_sentences(result, BICYCLE.tractor))


@pytest.fixture(scope="module")
def hidden():
    return log_of(3, **HIDDEN)


@pytest.fixture(scope="module")
def steady(hidden):
    """Return the vehicle parameters identified from the log `hidden`, without relaxation lengths."""
    return identify_vehicle(hidden.signals, None, BICYCLE, STEADY)


def test_bicycle_parameters_are_identified_despite_backlash_and_delay(hidden):
    log = mistold(hidden.signals, np.radians(1.0), np.radians(0.5), 0.1)
    found = identify_vehicle(log, None, BICYCLE, STEADY).found
    for key, true in (
        ("front_cornering_stiffness_n_rad", 11e3),
        ("rear_cornering_stiffness_n_rad", 24e3),
        ("steer_offset_deg", 0.5),
        ("steer_delay_s", 0.1),
        ("backlash_deg", 1.0),
    ):
        assert found[key].low < true < found[key].high, (key, found[key])
        assert found[key].identified
    assert found["backlash_deg"].value == pytest.approx(1.0, abs=0.1)
    assert found["front_cornering_stiffness_n_rad"].value == pytest.approx(11e3, rel=0.25)


def test_identified_stiffness_of_mujoco_tractor_equals_its_linear_tyres():
    """The fitted model lacks wheel spin, roll and load transfer, whose effects are small at these speeds."""
    tyres = {"front_cornering_stiffness_n_rad": 6500.0, "rear_cornering_stiffness_n_rad": 14000.0}
    keys = {f"plant__tyre__{key}": value for key, value in tyres.items()}
    log = log_of(2, plant__kind="mujoco", plant__tyre__kind="linear", duration=50.0, **keys)
    result = identify_vehicle(log.signals, None, log.scenario, share=0.8)
    assert result.geometry == "tangent"
    for key, each in tyres.items():
        assert result.found[key].low < 2 * each < result.found[key].high
        assert result.found[key].value == pytest.approx(2 * each, rel=0.25)


def test_log_without_backlash_gives_zero_backlash(steady):
    result = steady
    assert not result.found["backlash_deg"].identified
    assert result.found["backlash_deg"].high < 0.25
    assert result.explained > 0.98
    assert result.residual_deg_s < result.kinematic_deg_s
    assert "The backlash is not larger" in said(result)
    assert "and the scale of the wheel angle (checked by `agrobot-mj twin --only calibrate`)" in said(result)


def test_effect_of_uncertain_machine_values_is_reported_with_intervals(hidden, steady):
    result, t, change = steady, BICYCLE.tractor, "10 % more yaw inertia"
    other = {"yaw_inertia_kg_m2": 1.1 * t.yaw_inertia_kg_m2, "front_load_fraction": t.front_load_fraction}
    given = identify_vehicle(hidden.signals, None, BICYCLE.changed({"tractor": other}), STEADY)
    for axle, ratio in zip(("front", "rear"), result.moved[change], strict=True):
        key = f"{axle}_cornering_stiffness_n_rad"
        assert given.found[key].value / result.found[key].value == pytest.approx(ratio)
    assert f"{change} by 1." in said(result)
    assert given.moved == {}
    assert "do not include assumed values" not in said(given)


def test_stiffness_is_not_identified_from_slow_driving():
    """At 0.6 m/s the effect of slip on the yaw rate is below the noise, so the result contains no stiffness."""
    slow = log_of(1, duration=70.0, **HIDDEN, path__speed_m_s=0.6, driveline__full_speed_m_s=0.6)
    result = identify_vehicle(slow.signals, None, BICYCLE, ("front", "rear", "delay"))
    assert not result.found["rear_cornering_stiffness_n_rad"].identified
    assert "cannot separate front and rear stiffness" in said(result)


@quickly
@pytest.mark.parametrize("spoil", ["sign", "noise"])
def test_fit_that_explains_no_variance_gives_no_result(hidden, spoil):
    steer = np.asarray(hidden.signals["steer_measured"])
    other = -steer if spoil == "sign" else np.random.default_rng(1).permutation(steer)
    at = hidden.signals.column_names.index("steer_measured")
    with pytest.raises(NothingExplainedError, match="no result"):
        identify_vehicle(hidden.signals.set_column(at, "steer_measured", pa.array(other)), None, BICYCLE, STEADY)


@quickly
def test_log_with_yaw_rate_as_wheel_angle_gives_no_result(hidden):
    """The map assigns the column of the yaw rate to the wheel angle."""
    at = hidden.signals.column_names.index("steer_measured")
    rate = hidden.signals.set_column(at, "steer_measured", hidden.signals["yaw_rate"])
    with pytest.raises(NothingExplainedError, match=r"no result"):
        identify_vehicle(rate, None, BICYCLE, STEADY)


@pytest.mark.parametrize(("stiffness", "identified", "refused"), [(4540, True, True), (87e3, True, False), (4e3, 0, 0)])
def test_implausible_stiffness_for_the_load_gives_no_result(stiffness, identified, refused):
    """The mass is set to 5.2 t; values that are not identified are not checked."""
    sound = Quantity(120e3, 1e5, 1.4e5, True)
    rear = Quantity(stiffness, 0.9 * stiffness, 1.1 * stiffness, bool(identified))
    found = {"front_cornering_stiffness_n_rad": sound, "rear_cornering_stiffness_n_rad": rear}
    chassis = Chassis2(5200.0, 8000.0, 1.4, 1.1, True)
    if not refused:
        check_stiffness("log", found, chassis)
        return
    with pytest.raises(
        NothingExplainedError,
        match=r"rear axle is .* times the axle load. Real tyres have "
        r"1 to 60",
    ):
        check_stiffness("log", found, chassis)


def test_logs_that_cannot_identify_the_vehicle_are_rejected(hidden):
    with pytest.raises(FieldLogError, match="complete windows of 5 s"):
        identify_vehicle(hidden.signals.slice(0, 500), None, BICYCLE)
    at = hidden.signals.column_names.index("steer_measured")
    straight = hidden.signals.set_column(at, "steer_measured", pa.array(np.zeros(len(hidden.signals))))
    with pytest.raises(FieldLogError, match="the steering hardly moves"):
        identify_vehicle(straight, None, BICYCLE)


@pytest.mark.parametrize(
    ("part", "fitted", "message"),
    [
        ("identify", "front,rear,bcklash", "--fit bcklash: unknown parameter; did you mean 'backlash'"),
        ("keys", "tractor.mas_kg", "--fit tractor.mas_kg: must be a scenario key with a nonzero number"),
    ],
)
def test_unknown_parameters_are_rejected_before_the_log_is_read(tmp_path, call, part, fitted, message):
    (tmp_path / "log.csv").write_text("not a log")
    status, _, said = call("twin", "log.csv", "--only", part, "--fit", fitted)
    assert (status, said.startswith(message)) == (2, True)


@quickly
def test_identify_command_writes_a_file_and_sets_the_exit_status(hidden, tmp_path, call):
    write_log(hidden, tmp_path / "run")
    status, out, _ = call("twin", "--only", "identify", "run", "--fit", "front,rear,delay")
    assert status == 0
    assert "understeer_gradient_rad_s2_m" in out
    written = json.loads((tmp_path / "run" / "vehicle.json").read_text())
    low, high = (written["found"]["front_cornering_stiffness_n_rad"][key] for key in ("low", "high"))
    assert low < 11e3 < high
    (tmp_path / "run" / "vehicle.json").unlink()
    _, again, err = call("identify", "run", "--vehicle", "--fit", "front,rear,delay")
    assert again == out
    assert err.startswith("identify --vehicle: use `agrobot-mj twin --only identify`")
    assert written == json.loads((tmp_path / "run" / "vehicle.json").read_text())
    at = hidden.signals.column_names.index("steer_measured")
    turned = hidden.signals.set_column(at, "steer_measured", pa.array(-np.asarray(hidden.signals["steer_measured"])))
    pq.write_table(turned, tmp_path / "turned.parquet")
    status, _, err = call("twin", "--only", "identify", "turned.parquet", "--set", "plant.kind=bicycle")
    assert (status, "no result" in err) == (1, True)
    status, _, err = call("twin", "--only", "identify", "nowhere.csv")
    assert (status, "no such file" in err) == (2, True)
