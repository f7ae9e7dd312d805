from math import exp

import numpy as np
import pytest

from agrobot_mj.core.signals import Fix
from agrobot_mj.estimation.ekf import PoseEkf
from agrobot_mj.estimation.ukf import PoseUkf
from agrobot_mj.scenario import load_scenario
from agrobot_mj.simulation.run import run

EKF, UKF = PoseEkf(1.7, 0.02, 0.004), PoseUkf(1.7, 0.02, 0.004, 0.5)


@pytest.mark.parametrize("sigma_yaw", [0.2, 0.5])
def test_ukf_predicted_distance_decreases_with_yaw_uncertainty(sigma_yaw):
    """The mean of u T cos(psi) for a normal yaw is u T exp(-sigma^2 / 2); the EKF predicts u T."""
    belief = np.zeros(3), np.diag((1e-6, 1e-6, sigma_yaw**2))
    ekf, ukf = (kf.step(*belief, (4.0, 0.0, 1.0), None, 0.02)[0] for kf in (EKF, UKF))
    assert ekf[0] == 4.0
    assert ukf[0] == pytest.approx(4.0 * exp(-(sigma_yaw**2) / 2), rel=0.01)


def test_ukf_equals_ekf_for_small_uncertainty():
    rng = np.random.default_rng(8)
    ours = theirs = np.array((2.0, 1.0, 0.7)), np.diag((1e-3, 1e-3, 1e-3)), 0.0
    for k in range(200):
        fix = None if k % 4 == 1 else Fix(*(ours[0][:2] + 0.02 * rng.standard_normal(2)), 0.0, 0.0)
        ours, theirs = (kf.step(*b[:2], (1.3, 0.15, 0.05), fix, 0.02) for kf, b in ((UKF, ours), (EKF, theirs)))
        assert np.allclose(ours[0], theirs[0], atol=1e-4)
        assert np.allclose(ours[1], theirs[1], rtol=0.01, atol=1e-6)
        assert ours[2] == pytest.approx(theirs[2], rel=0.02, abs=1e-4, nan_ok=True)


def test_closed_loop_errors_with_ukf_and_ekf_are_nearly_equal():
    errors = []
    for kind in ("ekf", "ukf"):
        log = run(load_scenario("circle", {"estimator.kind": kind, "duration_s": 20, "seed": 6}))
        errors.append(
            np.hypot(log.column("rear_x_hat") - log.column("rear_x"), log.column("rear_y_hat") - log.column("rear_y"))
        )
    assert np.sqrt(np.mean(np.square(errors[1]))) == pytest.approx(np.sqrt(np.mean(np.square(errors[0]))), rel=0.1)


def test_compiled_and_filterpy_backends_differ_only_by_rounding():
    keys = {"duration_s": 10, "seed": 6}
    logs = [run(load_scenario("circle", {**keys, "estimator.backend": name})) for name in ("compiled", "filterpy")]
    difference = np.abs(logs[0].column("x_hat") - logs[1].column("x_hat")).max()
    assert 0.0 < difference < 1e-9
