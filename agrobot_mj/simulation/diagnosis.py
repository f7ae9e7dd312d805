"""Diagnosis of a run: main cause of its cross-track error with a remedy, and consistency of the estimate.

This module converts metrics to text. An estimate contradicts its covariance if its NEES or NIS is above a quantile of
the chi-square distribution.

Position errors are correlated over minutes, so that a run may contain only one independent error. NEES_MOST is
therefore the limit for a single sample. Innovations of a consistent filter are white, so that every statistic has at
least 20 independent samples (`metrics.base.LEAST`). NIS_MOST is the limit for the mean of these samples.
"""

from collections.abc import Iterator, Mapping
from math import degrees, log
from typing import Any

import numpy as np

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.metrics import RunView
from agrobot_mj.metrics.base import rms
from agrobot_mj.metrics.estimate_error import FLOAT, HEADING, LATENCY, LEAN, LOSS, PLACE, cause_of
from agrobot_mj.scenario.schema import Scenario
from agrobot_mj.simulation.log import Log

NEES_MOST = -2.0 * log(0.001)
"""Mean position NEES above which an estimate contradicts its covariance [-]: 99.9 % quantile of chi-square(2)."""
NIS_MOST = 3.67
"""Mean position NIS above which an estimate contradicts its covariance [-]: 99.9 % quantile of chi-square(40) / 20."""
SIDESLIP_MOST = 2.0
"""Maximum plausible steady sideslip on level ground [deg]. Assumed value: twice the mounting error of two antennas
before calibration; the sideslip of tyres is below 0.5 deg."""
WORTH_M = 0.03
"""Error of the CG estimate per axis above which a message states a remedy [m]. Assumed value, above the RTK error."""
FULL = {"estimator.kind": "ekf_full", "sensors.gyro.enabled": True, "sensors.wheel_speed.enabled": True}
COMPENSATED = {"sensors.imu.enabled": True, "estimator.terrain_compensation": True}
REMEDIES: dict[str, dict[str, Any]] = {LEAN: COMPENSATED, HEADING: FULL, LATENCY: FULL, LOSS: FULL, FLOAT: FULL}
"""Scenario keys and values that reduce the estimation error, by cause of the error."""
GUIDANCE, MOUNTING = "guidance", "antenna mounting"
CALIBRATE = "calibrate sensors.gnss.dual_antenna.mounting_deg"
MEASURE = "measure the antenna position and set sensors.gnss.configured_ahead_m and configured_left_m"


def diagnosis(log: Log, view: RunView, metrics: Mapping[str, Any]) -> dict[str, str]:
    """Return the texts `xte_cause`, `xte_remedy` and `estimate_warning` for metrics.json, without empty texts.

    `xte_cause` is "guidance" or, if the estimator part of the cross-track error is larger, the cause of this part.
    `metrics` are the metrics of the log.
    """
    s = log.scenario
    part, guidance = (metrics[f"xte_{name}_rms"] for name in ("estimator", "guidance"))
    if not s.guidance.using(s.controller).follows_path or part is None:
        return {}
    askew = abs(degrees(metrics.get("level_sideslip") or 0.0)) > SIDESLIP_MOST
    cause, remedy = _cause_text(s, cause_of(view, across=True), askew) if part > (guidance or 0.0) else (GUIDANCE, "")
    remedy = remedy if part > WORTH_M else ""
    warnings = list(_warnings(s, view, metrics, askew, remedy))
    found = {"xte_cause": cause, "xte_remedy": remedy, "estimate_warning": ". ".join(warnings)}
    return {name: text for name, text in found.items() if text}


def _warnings(s: Scenario, view: RunView, metrics: Mapping[str, Any], askew: bool, given: str) -> Iterator[str]:
    """Yield warnings about the estimate, without the remedy `given`, which another text already states.

    `askew` is True if the sideslip on level ground is implausible. With two antennas the sideslip is then attributed
    to the antenna mounting, because only the sum of sideslip and mounting angle is observable.
    """
    nees, nis = (metrics[name] or 0.0 for name in ("position_nees", "position_nis"))
    if nees > NEES_MOST or nis > NIS_MOST:
        cause, remedy = _cause_text(s, cause_of(view, across=False), askew)
        about = f": {cause}" if cause else ""
        numbers = f"position NEES {nees:.0f}, NIS {nis:.1f}, both 2 for a consistent filter"
        worth = rms(np.hypot(*(view.column(name) - view.column(f"{name}_hat") for name in "xy"))) or 0.0
        more = f"; {remedy}" if remedy not in ("", given) and worth > 2**0.5 * WORTH_M else ""
        yield f"the estimate contradicts its covariance ({numbers}){about}{more}"
    mounting = degrees(metrics.get("antenna_mounting") or 0.0)
    beta = degrees(metrics.get("level_sideslip") or 0.0)
    if abs(mounting) > SIDESLIP_MOST and s.sensors.gnss.dual_antenna.enabled:
        yield (f"the antennas point {mounting - beta:.1f} deg off the heading, corrected by the estimator; {CALIBRATE}")
    if askew:
        reason = f": {MOUNTING}; {CALIBRATE}" if s.sensors.gnss.dual_antenna.enabled else ""
        yield f"a steady sideslip of {beta:.1f} deg on level ground is not plausible{reason}"


def _cause_text(s: Scenario, cause: str, askew: bool) -> tuple[str, str]:
    """Return a cause and its remedy as text. The remedy is empty if its keys are already set or do not apply."""
    if cause == HEADING and askew and s.sensors.gnss.dual_antenna.enabled:
        return MOUNTING, CALIBRATE
    if cause not in REMEDIES:
        return cause, MEASURE if cause == PLACE else ""
    given = s.model_dump(include={"sensors", "estimator"})
    keys = {key: value for key, value in REMEDIES[cause].items() if _value(given, key) != value}
    try:
        s.changed(keys, files=False)
    except ScenarioError:
        return cause, ""
    enabled = [key.removesuffix(".enabled") for key, value in keys.items() if value is True]
    parts = [f'set {key} = "{value}"' for key, value in keys.items() if isinstance(value, str)]
    return cause, "; ".join([*parts, *([f"enable {_enumerate_names(enabled)}"] if enabled else [])])


def _value(tables: Any, key: str) -> Any:
    """Return the value of a dotted key in nested tables, or None for a missing key."""
    for name in key.split("."):
        tables = tables.get(name) if isinstance(tables, dict) else None
    return tables


def _enumerate_names(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def attribution(row: Mapping[str, Any]) -> str:
    """Return a sentence on the estimator and guidance parts of the cross-track error, or "" if a part is missing."""
    names = ("xte_rms", "xte_estimator_rms", "xte_guidance_rms")
    total, estimator, guidance = (row.get(name) for name in names)
    if total is None or estimator is None or guidance is None:
        return ""
    cause, remedy, steering = row.get("xte_cause"), row.get("xte_remedy"), row.get("steer_error_rms")
    led = estimator > guidance
    inside = f" (steering error {degrees(steering):.1f} deg)" if steering and not led else ""
    parts = f"{_cm(estimator)} estimator{f' ({cause})' if cause and led else ''}, {_cm(guidance)} guidance{inside}"
    return f"{_cm(total)} cross-track: {parts}{f'; {remedy}' if remedy else ''}"


def _cm(metres: float) -> str:
    return f"{100 * metres:.1f} cm"
