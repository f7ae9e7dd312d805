"""Files of a twin contain all calibrated quantities: map, machine, and latencies as faults of the scenario."""

import tomllib

import numpy as np
import pyarrow as pa
import pytest
from field_logs import WHEELBASE_M, field_log, field_map, path
from test_two_scales import CENTRE, two_sided

from agrobot_mj.core.signals import TICK_S
from agrobot_mj.extensions.logs.calibrate import calibrate
from agrobot_mj.extensions.logs.identify.vehicle import vehicle_quantities
from agrobot_mj.extensions.logs.maps import LogMap
from agrobot_mj.extensions.logs.quantities import Quantity
from agrobot_mj.extensions.logs.twin.machine import twin_faults, twin_keys
from agrobot_mj.extensions.logs.words import map_lines
from agrobot_mj.scenario.loading import load_scenario

UTILITY = load_scenario("straight_line", {"machine": "utility", "tractor.wheelbase_m": WHEELBASE_M})
AHEAD, LATE_ROWS = 0.8, 3


@pytest.fixture(scope="module")
def calibrated():
    """Return the calibration of a sensor with wrong centre and two wrong scales, and with a delayed heading."""
    columns = field_log(path(duration=60.0, swing_deg=14.0), counts=two_sided(0.085, 0.115), ahead=AHEAD)
    columns["heading"] = np.concatenate([columns["heading"][:1].repeat(LATE_ROWS), columns["heading"][:-LATE_ROWS]])
    steer = {"offset": CENTRE + 20, "scale": 0.1}
    return calibrate([pa.table(columns)], field_map(columns, steer=steer, position={"ahead_m": 0.0}), UTILITY)


def test_scenario_keys_of_a_twin_contain_the_identified_sensor_errors(calibrated):
    keys = twin_keys(calibrated, vehicle_quantities(calibrated.fit, calibrated.data.chassis), UTILITY)
    values = {key.removeprefix("sensors."): each.value for key, each in keys.items()}
    assert values["steering_pot.centre_deg"] == pytest.approx(-20 * 0.1, abs=0.1)
    assert values["steering_pot.scale_left"] == pytest.approx(0.1 / 0.085, rel=0.05)
    assert values["steering_pot.scale_right"] == pytest.approx(0.1 / 0.115, rel=0.05)
    assert values["tractor.antenna_ahead_m"] == pytest.approx(AHEAD, abs=0.1)
    assert values["gnss.configured_ahead_m"] == 0.0
    assert values["gnss.rate_hz"] == 20.0
    assert values.get("gnss.latency_s", 0.0) == pytest.approx(0.0, abs=TICK_S)
    UTILITY.changed({key: each.value for key, each in keys.items()})


def test_latency_above_the_receiver_latency_is_written_as_a_fault(calibrated):
    (fault,) = twin_faults(calibrated)
    assert fault["kind"] == "heading_delay"
    assert fault["delay_s"] == pytest.approx(LATE_ROWS * TICK_S, abs=1.001 * TICK_S)
    UTILITY.changed({"fault": [fault]})


@pytest.mark.usefixtures("quick_fit")
def test_written_map_keeps_every_estimated_value_with_its_interval():
    """Values that are rounded to their defaults are also written."""
    columns = field_log(path(duration=40.0, swing_deg=12.0))
    found = calibrate([pa.table(columns)], field_map(columns), UTILITY)
    found.found["position.ahead_m"] = Quantity(0.0, -0.1, 0.1, True)
    text = map_lines(found)
    written = LogMap.model_validate(tomllib.loads(text))
    for key, each in found.found.items():
        table, _, name = key.partition(".")
        assert not each.identified or name in getattr(written, table).model_fields_set, key
        assert not each.identified or f"  # {each.ends[0]} to {each.ends[1]}" in text
    assert any(each.rounded in (0.0, 1.0) for each in found.found.values() if each.identified)
