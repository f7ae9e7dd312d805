"""Gains of the cascaded laws for each pair of guidance law and yaw controller.

`tuned`, the default, selects gains from the tuning of all laws with `scenarios/tunings/gains.toml`; docs/tuning/
contains the traces. `paper` selects the default values of the keys for the paper's network and its baselines. The paper
states no gains; these values reproduce its figures. Laws that use the nearest path point always have tuned defaults.
"""

from collections.abc import Mapping
from typing import Literal

from agrobot_mj.control.base import GuidanceLaw

Gains = Literal["tuned", "paper"]

PAPER = ("kinematic with pd", "kinematic with pd_t2fnn", "kinematic with pd_t1fnn", "kinematic with pd_isgn")
"""Laws for which `gains = "paper"` selects the gains that reproduce the paper."""
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
"""Tuned gains by law, named as in `Scenario.law`, and by dotted scenario key."""


def gains_of(law: str, guidance: GuidanceLaw, which: Gains) -> Mapping[str, float]:
    """Return the gains of the law named `law` that differ from the defaults, by dotted scenario key."""
    return {} if which == "paper" and law in PAPER else {**TUNED, **guidance.tuned}.get(law, {})
