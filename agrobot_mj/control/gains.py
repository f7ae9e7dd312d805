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
        "guidance.gain_per_m": 0.58,
        "controller.kp": 0.31,
        "controller.kd": 0.21,
        "controller.network.alpha": 0.15,
    },
    "kinematic with pi": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.66,
        "controller.kp": 0.74,
        "controller.ki": 0.4,
    },
    "feedforward with pi": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.52,
        "controller.kp": 0.97,
        "controller.ki": 0.15,
    },
    "feedforward with pd": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.62,
        "controller.kp": 1.0,
        "controller.kd": 0.091,
    },
    "feedforward with pd_t2fnn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.64,
        "controller.kp": 0.84,
        "controller.kd": 0.2,
        "controller.network.alpha": 0.015,
    },
    "kinematic with pd": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.25,
        "controller.kp": 0.73,
        "controller.kd": 0.16,
    },
    "kinematic with pd_isgn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.29,
        "controller.kp": 0.51,
        "controller.kd": 0.23,
        "controller.alpha": 0.12,
    },
    "kinematic with pd_t1fnn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.47,
        "controller.kp": 0.37,
        "controller.kd": 0.27,
        "controller.network.alpha": 0.12,
    },
    "learned_feedforward with pd": {
        "guidance.inner.scheduled_above_m_s": 1.5,
        "guidance.network.eta": 0.47,
        "controller.kp": 0.54,
        "controller.kd": 0.17,
    },
}
"""Gains by dotted key of the scenario, by law as `Scenario.law` names it."""


def gains_of(law: str, which: Gains) -> Mapping[str, float]:
    """The gains of a law, by dotted key, that are not the defaults of their own keys."""
    return {} if which == "paper" and law in PAPER else TUNED.get(law, {})
