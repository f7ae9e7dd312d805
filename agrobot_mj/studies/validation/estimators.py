"""Both estimators side by side; `python -m agrobot_mj.studies.validation.estimators` prints docs/estimators.md's table.

Whole loops with noise, default gains, MuJoCo on `magic_formula` unless said otherwise; means over seeds. Errors are
those of R (position) and of the heading and the course, after the first 20 s; NEES and NIS are 2 on average if
consistent. `coast` is the position error at the last tick of a loss, which is from 40 to 45 s.
"""

import sys
from math import degrees
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.core.geometry import wrap
from agrobot_mj.core.signals import Array
from agrobot_mj.scenario import Scenario, load_scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import run

BEGIN_S = 20.0
"""Time before which errors do not count [s]."""
LOSS = {"fault": [{"kind": "gnss_loss", "start_s": 40.0, "end_s": 45.0}], "duration_s": 60.0}
SLOPE = {"terrain": {"kind": "slope", "grade_deg": 10.0, "direction_deg": 90.0}}
TURNED = {"fault": [{"kind": "steering_pot_bias", "bias_deg": 2.0}]}
LINE = {"path.length_m": 144.0, "duration_s": 120.0}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "figure eight, bicycle": ("figure_eight", {"plant.kind": "bicycle"}),
    "figure eight": ("figure_eight", {}),
    "figure eight, correlated share 0.8": ("figure_eight", {"sensors.gnss.correlated_fraction": 0.8}),
    "figure eight, potentiometer off by 2 deg": ("figure_eight", TURNED),
    "figure eight, side slope 10 deg": ("figure_eight", SLOPE),
    "line, side slope 10 deg": ("straight_line", {**LINE, **SLOPE}),
    "GNSS loss of 5 s in a turn": ("figure_eight", LOSS),
    "GNSS loss of 5 s, line, side slope 10 deg": ("straight_line", {**LINE, **LOSS, **SLOPE}),
}
ESTIMATORS: dict[str, dict[str, Any]] = {
    "ekf": {},
    "ekf, compensated": {"terrain_compensation": True},
    "ekf_bias": {"kind": "ekf_bias"},
    "ekf_bias, compensated": {"kind": "ekf_bias", "terrain_compensation": True},
}
REMEDIES: dict[str, dict[str, Any]] = {
    "ekf, gnss_sigma_m 0.04": {"gnss_sigma_m": 0.04},
    "ekf, gnss_sigma_m 0.06": {"gnss_sigma_m": 0.06},
    "ekf, position_walk_m_rt_s 0.03": {"position_walk_m_rt_s": 0.03},
    "ekf_bias, gnss_correlated_fraction 0": {"kind": "ekf_bias", "gnss_correlated_fraction": 0.0},
}
"""Estimators that state a larger uncertainty, tried on the figure eight."""
ROUGH = "figure eight, rough ground of class D"
CASES[ROUGH] = ("figure_eight", {"terrain": {"kind": "rough", "iso_class": "D"}})
SWINGS: dict[str, dict[str, Any]] = {
    f"ekf_bias, compensated, swing_filter_s {filter_s:g}": {
        "kind": "ekf_bias",
        "terrain_compensation": True,
        "swing_filter_s": filter_s,
    }
    for filter_s in (0.0, 0.1, 1e6)
}
"""Filters of the antenna's swing, tried on rough ground; the last one leaves the swing in the velocity."""


class Row(NamedTuple):
    """Results of one estimator in one case."""

    position: float
    """RMS of the position error [cm]."""
    heading: float
    """RMS of the yaw against the true heading [deg]."""
    course: float
    """RMS of the yaw against the true course of R [deg]."""
    nees: float
    nis: float
    coast: float
    """Position error at the end of a GNSS loss; NaN without a loss [cm]."""
    speed: float
    """RMS of the speed against that of the CG [cm/s]."""
    lateral: float
    """RMS of the true lateral error of the loop [cm]."""


def scenario_of(case: str, estimator: dict[str, Any], seed: int) -> Scenario:
    """Scenario of a case, with the IMU on and default noise."""
    name, given = CASES[case]
    return load_scenario(name, {**given, "seed": seed, "sensors.imu.enabled": True, "estimator": estimator})


def row(log: Log) -> Row:
    """Results of a run."""
    c, counts = log.column, log.column("t") > BEGIN_S
    error = np.hypot(c("rear_x_hat") - c("rear_x"), c("rear_y_hat") - c("rear_y"))
    true_course = np.arctan2(np.gradient(c("rear_y")), np.gradient(c("rear_x")))
    quality = c("gnss_quality")
    lost = np.flatnonzero(quality == 0)
    return Row(
        100 * _rms(error[counts]),
        degrees(_rms(_wrapped(c("yaw_hat") - c("yaw"))[counts])),
        degrees(_rms(_wrapped(c("yaw_hat") - true_course)[counts])),
        float(np.mean(c("position_nees")[counts])),
        float(np.nanmean(c("position_nis")[counts])),
        100 * float(error[lost[-1]]) if lost.size else np.nan,
        100 * _rms((c("speed_hat") - c("speed"))[counts]),
        100 * _rms(c("e_lateral")[counts]),
    )


def mean_row(case: str, estimator: dict[str, Any], seeds: int) -> Row:
    """Mean results over the seeds 1, 2, ..."""
    rows = [row(run(scenario_of(case, estimator, seed))) for seed in range(1, seeds + 1)]
    return Row(*np.mean(rows, axis=0).tolist())


def table(seeds: int) -> str:
    """All tables, as Markdown."""
    tried = [(case, words, given) for case in CASES for words, given in ESTIMATORS.items() if _of_interest(case, words)]
    tried += [("figure eight", words, given) for words, given in REMEDIES.items()]
    tried += [(ROUGH, words, given) for words, given in SWINGS.items()]
    heads = (
        "case",
        "estimator",
        "position [cm]",
        "heading [deg]",
        "course [deg]",
        "NEES",
        "NIS",
        "coast [cm]",
        "speed [cm/s]",
        "lateral [cm]",
    )
    lines = [heads, ("---", "---", *["---:"] * (len(heads) - 2))]
    for case, words, given in tried:
        numbers = ("" if np.isnan(v) else f"{v:.3g}" if v < 1000 else f"{v:.0f}" for v in mean_row(case, given, seeds))
        lines.append((case, words, *numbers))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _of_interest(case: str, words: str) -> bool:
    return "slope" in case or "compensated" not in words


def _wrapped(angles: Array) -> Array:
    return np.array([wrap(angle) for angle in angles])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    sys.stdout.write(table(seeds=3) + "\n")
