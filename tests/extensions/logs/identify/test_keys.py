"""Fit of scenario keys with MuJoCo's toolbox: hidden values are identified, and unsuitable keys are rejected."""

import numpy as np
import pytest
from extras import NEEDS_SYSID
from machines import log_of

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.logs.calibrate import changed_map
from agrobot_mj.extensions.logs.identify.keys import STEER_DELAY_S, STEER_SCALE, fit_keys
from agrobot_mj.extensions.logs.identify.vehicle import identify_vehicle
from agrobot_mj.extensions.logs.identify.windows import TooLittleError
from agrobot_mj.extensions.logs.maps import built_in
from agrobot_mj.scenario.loading import load_scenario

BICYCLE = load_scenario("straight_line", {"plant.kind": "bicycle"})
HIDDEN = {"plant.front_cornering_stiffness_n_rad": 11e3, "plant.rear_cornering_stiffness_n_rad": 24e3}


def log_with_hidden_stiffness(duration=60.0):
    return log_of(3, duration, **{key.replace(".", "__"): value for key, value in HIDDEN.items()}).signals


@NEEDS_SYSID
def test_fitted_parameters_agree_with_true_values_and_with_identify():
    log = log_with_hidden_stiffness()
    found = fit_keys([log], None, BICYCLE, list(HIDDEN))
    own = identify_vehicle([log], None, BICYCLE, ("front", "rear", "offset", "delay", "backlash"), share=0.9).found
    for key, true in HIDDEN.items():
        fitted, other = found.found[key], own[key.removeprefix("plant.")]
        assert fitted.value == pytest.approx(true, rel=0.03)
        assert fitted.identified
        assert not fitted.excludes(true)
        assert abs(fitted.value - other.value) < np.hypot(fitted.half, other.half)
        assert found.toolbox[key] < fitted.half
    assert found.rms["yaw_rate"][1] < 0.5 * found.rms["yaw_rate"][0]


def misread(seed):
    """Return hidden stiffnesses, and a log and a map with typical errors of a calibrated wheel angle."""
    rng = np.random.default_rng([seed, 77])
    true = dict(zip(HIDDEN, (rng.uniform(8e3, 16e3), rng.uniform(18e3, 34e3)), strict=True))
    log = log_of(seed, 60.0, **{key.replace(".", "__"): value for key, value in true.items()}).signals
    log_map = built_in(log.column_names, "log")
    steer = {
        "scale": 1.0 + rng.normal(0.0, STEER_SCALE),
        "delay_s": log_map.steer.delay_s + rng.normal(0.0, STEER_DELAY_S),
    }
    return true, log, changed_map(log_map, {f"steer.{key}": value for key, value in steer.items()})


@NEEDS_SYSID
@pytest.mark.slow
def test_intervals_contain_the_true_stiffness_in_34_of_40_machines():
    """At least 34 of 40 intervals of 95 % contain the true value with a probability of 99 %."""
    inside = dict.fromkeys(HIDDEN, 0)
    for seed in range(40):
        true, log, log_map = misread(seed)
        for key, each in fit_keys([log], log_map, BICYCLE.changed(true), list(HIDDEN)).found.items():
            inside[key] += not each.excludes(true[key])
    print(inside)
    assert min(inside.values()) >= 34


@NEEDS_SYSID
def test_error_for_a_short_log_states_the_number_of_windows():
    with pytest.raises(TooLittleError, match="needs 6; use a longer log"):
        fit_keys([log_with_hidden_stiffness(20.0)], None, BICYCLE, list(HIDDEN))


@NEEDS_SYSID
@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("plant.front_cornering_stifness_n_rad", "did you mean 'plant.front_cornering_stiffness_n_rad'"),
        ("plant.kind", "nonzero number as start value"),
        ("front", "must be a scenario key"),
    ],
)
def test_error_for_keys_that_cannot_be_fitted_states_a_remedy(key, message):
    with pytest.raises(ScenarioError, match=message):
        fit_keys([log_with_hidden_stiffness(20.0)], None, BICYCLE, [key])
