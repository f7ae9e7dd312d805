"""Comparison of the filters with filterpy

`estimator.backend = "filterpy"` computes the velocity and pose filters with filterpy's `KalmanFilter` and
`ExtendedKalmanFilter`. Both backends process the same measurements of a figure eight. The maximum differences between
the backends are due to rounding alone. In closed loop, rounding differences grow about tenfold in 5 s, so that two runs
with different backends differ by centimetres at their end.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from agrobot_mj.core.signals import TICK_S, Array, Estimate
from agrobot_mj.extensions.bench.manoeuvres.base import Check, Trial
from agrobot_mj.plants import Mujoco
from agrobot_mj.simulation.stepping import Simulation

KINDS = ("ekf", "ekf_bias")
BAND = 1e-9  # Maximum difference between the estimates of both backends: position [m], yaw [rad], covariance [m2, rad2]
BRIEFLY_S = 20.0  # Duration of the run in quick mode [s]


def differences(kind: str, duration_s: float | None) -> tuple[float, float, float]:
    """Return the maximum differences between the estimates of both backends in a run: position [m], yaw [rad] and
    covariance [m2, rad2]."""
    changes = {"estimator.kind": kind, **({"duration_s": duration_s} if duration_s else {})}
    sim = Simulation("figure_eight", changes)
    sim.reset()
    truth = sim.truth
    estimator: Any = sim.scenario.estimator.model_copy(update={"backend": "filterpy"})
    state = estimator.init(truth.rear_x, truth.rear_y, truth.yaw, sim.scenario.tractor)
    found: list[Array] = []
    while not sim.done:
        state, estimate = estimator.update(state, sim.measurement, TICK_S)
        found.append(_numbers(estimate) - _numbers(sim.estimate))
        sim.step()
    worst = np.abs(found).max(axis=0)
    return float(worst[:2].max()), float(worst[2]), float(worst[3:].max())


def _numbers(estimate: Estimate) -> Array:
    """Return position, yaw and covariance of an estimate as one vector, shape (12,)."""
    return np.array((estimate.rear_x, estimate.rear_y, estimate.yaw, *estimate.covariance.ravel()))


def run(m: Trial) -> Iterator[Check]:
    """Yield checks of the differences between the backends for `ekf` and `ekf_bias`. Quick mode simulates only the
    first `BRIEFLY_S`."""
    for kind in KINDS:
        found = differences(kind, BRIEFLY_S if m.quick else None)
        for quantity, unit, value in zip(
            ("position", "yaw", "covariance"), ("m", "rad", "m2, rad2"), found, strict=True
        ):
            yield m.about(f"{kind}, {quantity}", Mujoco().tyre.kind, unit).below(value, BAND)
