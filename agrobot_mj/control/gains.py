"""Gains of the cascaded laws for each pair of guidance law and yaw controller.

`gains = "tuned"`, the default, selects gains from the tuning of all laws with `scenarios/tunings/gains.toml`;
docs/tuning/ contains the tuning traces. `gains = "paper"` selects the default values of the keys for the paper's
network and its baselines. The paper states no gains; these values reproduce the figures of the paper. Laws that use the
nearest path point always have tuned defaults.
"""

from collections.abc import Mapping
from typing import Literal

from agrobot_mj.control.base import GuidanceLaw

Gains = Literal["tuned", "paper"]

PAPER = ("kinematic with pd", "kinematic with pd_t2fnn", "kinematic with pd_t1fnn", "kinematic with pd_isgn")
"""Names of the laws for which `gains = "paper"` selects gains that reproduce the figures of the paper."""


def _tuned_gains(gain_per_m: float, saturation_m_s: float, **controller: float) -> dict[str, float]:
    """Return the tuned gains by dotted scenario key. In argument names of controller gains, `__` stands for a dot."""
    outer = {"scheduled_above_m_s": 1.5, "gain_per_m": gain_per_m, "saturation_m_s": saturation_m_s}
    inner = {f"controller.{name.replace('__', '.')}": gain for name, gain in controller.items()}
    return {**{f"guidance.{name}": gain for name, gain in outer.items()}, **inner}


TUNED: Mapping[str, Mapping[str, float]] = {
    "kinematic with pd_t2fnn": _tuned_gains(0.66, 0.55, kp=0.7, kd=0.16, network__alpha=0.075),
    "kinematic with pi": _tuned_gains(1.1, 0.44, kp=0.96, ki=0.47),
    "feedforward with pi": _tuned_gains(0.58, 0.55, kp=1.0, ki=0.12),
    "feedforward with pd": _tuned_gains(0.71, 0.65, kp=0.9, kd=0.11),
    "feedforward with pd_t2fnn": _tuned_gains(0.95, 0.51, kp=0.86, kd=0.2, network__alpha=0.0077),
    "kinematic with pd": _tuned_gains(1.4, 0.48, kp=0.99, kd=0.075),
    "kinematic with pd_isgn": _tuned_gains(0.66, 0.55, kp=0.7, kd=0.16, alpha=0.075),
    "kinematic with pd_t1fnn": _tuned_gains(0.66, 0.55, kp=0.7, kd=0.16, network__alpha=0.075),
}
"""Tuned gains of each law by dotted scenario key. The laws are named as in `Scenario.law`."""


def gains_of(law: str, guidance: GuidanceLaw, which: Gains) -> Mapping[str, float]:
    """Return the tuned gains of the law named `law` by dotted scenario key.

    The mapping is empty for a law without tuned gains. If `which` is "paper", the mapping is also empty for the
    laws `PAPER`, which then have their default gains.
    """
    return {} if which == "paper" and law in PAPER else {**TUNED, **guidance.tuned}.get(law, {})
