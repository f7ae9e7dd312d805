"""Gains of the laws in cascade, which depend on the pair of guidance law and yaw controller.

`tuned`, the default, are the results of the one search for all laws, `scenarios/tunings/gains.toml`; its traces are in
docs/tuning/. `paper` leaves the laws of the paper - its network, and what it is compared with - the defaults of their
own keys, with which the paper's figures are reproduced; the paper prints no gains. The defaults of the laws that follow
a path by its nearest point are tuned, whatever the scenario asks for.
"""

from collections.abc import Mapping
from typing import Literal

from agrobot_mj.control.base import GuidanceLaw

Gains = Literal["tuned", "paper"]

PAPER = ("kinematic with pd", "kinematic with pd_t2fnn", "kinematic with pd_t1fnn", "kinematic with pd_isgn")
"""Laws that have gains of the paper."""
TUNED: Mapping[str, Mapping[str, float]] = {
    "kinematic with pd_t2fnn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.66,
        "guidance.saturation_m_s": 0.55,
        "controller.kp": 0.7,
        "controller.kd": 0.16,
        "controller.network.alpha": 0.075,
    },
    "kinematic with pi": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 1.1,
        "guidance.saturation_m_s": 0.44,
        "controller.kp": 0.96,
        "controller.ki": 0.47,
    },
    "feedforward with pi": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.58,
        "guidance.saturation_m_s": 0.55,
        "controller.kp": 1.0,
        "controller.ki": 0.12,
    },
    "feedforward with pd": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.71,
        "guidance.saturation_m_s": 0.65,
        "controller.kp": 0.9,
        "controller.kd": 0.11,
    },
    "feedforward with pd_t2fnn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.95,
        "guidance.saturation_m_s": 0.51,
        "controller.kp": 0.86,
        "controller.kd": 0.2,
        "controller.network.alpha": 0.0077,
    },
    "kinematic with pd": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 1.4,
        "guidance.saturation_m_s": 0.48,
        "controller.kp": 0.99,
        "controller.kd": 0.075,
    },
    "kinematic with pd_isgn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.66,
        "guidance.saturation_m_s": 0.55,
        "controller.kp": 0.7,
        "controller.kd": 0.16,
        "controller.alpha": 0.075,
    },
    "kinematic with pd_t1fnn": {
        "guidance.scheduled_above_m_s": 1.5,
        "guidance.gain_per_m": 0.66,
        "guidance.saturation_m_s": 0.55,
        "controller.kp": 0.7,
        "controller.kd": 0.16,
        "controller.network.alpha": 0.075,
    },
}
"""Gains by dotted key of the scenario, by law as `Scenario.law` names it."""


def gains_of(law: str, guidance: GuidanceLaw, which: Gains) -> Mapping[str, float]:
    """The gains of a law, by dotted key, that are not the defaults of their own keys."""
    return {} if which == "paper" and law in PAPER else {**TUNED, **guidance.tuned}.get(law, {})
