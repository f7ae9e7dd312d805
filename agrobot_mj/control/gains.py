"""Gains of the laws in cascade, which depend on the pair of guidance law and yaw controller.

`tuned`, the default, are the results of the one search for all laws, `scenarios/tunings/gains.toml`; its traces are in
docs/tuning/. `paper` leaves the laws of the paper - its network, and what it is compared with - the defaults of their
own keys, with which the paper's figures are reproduced; the paper prints no gains. The defaults of the laws that follow
a path by its nearest point are tuned, whatever the scenario asks for.
"""

from collections.abc import Mapping
from typing import Literal

Gains = Literal["tuned", "paper"]

PAPER = ("kinematic with pd", "kinematic with pd_t2fnn", "kinematic with pd_t1fnn", "kinematic with pd_isgn")
"""Laws that have gains of the paper."""
TUNED: Mapping[str, Mapping[str, float]] = {
    "kinematic with pd_t2fnn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.37,
        "controller.kp": 0.41,
        "controller.kd": 0.11,
        "controller.network.alpha": 0.062,
    },
    "kinematic with pi": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.29,
        "controller.kp": 0.61,
        "controller.ki": 0.48,
    },
    "feedforward with pi": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.31,
        "controller.kp": 0.54,
        "controller.ki": 0.22,
    },
    "feedforward with pd": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.52,
        "controller.kp": 0.43,
        "controller.kd": 0.14,
    },
    "feedforward with pd_t2fnn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.76,
        "controller.kp": 0.35,
        "controller.kd": 0.18,
        "controller.network.alpha": 0.0066,
    },
    "kinematic with pd": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.7,
        "controller.kp": 0.41,
        "controller.kd": 0.099,
    },
    "kinematic with pd_isgn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.3,
        "controller.kp": 0.44,
        "controller.kd": 0.095,
        "controller.alpha": 0.085,
    },
    "kinematic with pd_t1fnn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.66,
        "controller.kp": 0.33,
        "controller.kd": 0.24,
        "controller.network.alpha": 0.086,
    },
    "learned_feedforward with pd": {
        "guidance.inner.scheduled_above_m_s": 1.5,
        "guidance.network.eta": 0.64,
        "controller.kp": 0.41,
        "controller.kd": 0.13,
    },
}
"""Gains by dotted key of the scenario, by law as `Scenario.law` names it."""


def gains_of(law: str, which: Gains) -> Mapping[str, float]:
    """The gains of a law, by dotted key, that are not the defaults of their own keys."""
    return {} if which == "paper" and law in PAPER else TUNED.get(law, {})
