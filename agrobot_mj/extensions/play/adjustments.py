"""Quantities that the driver can adjust. Some quantities change at once, by a fault, and others at the next start."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from agrobot_mj.core.signals import TICK_S, WHEELS
from agrobot_mj.plants.mujoco.build import Mujoco
from agrobot_mj.scenario.reference import families
from agrobot_mj.scenario.schema import Scenario


class Adjustment(NamedTuple):
    """Quantity that the driver can adjust during a drive. The adjusted value applies as a fault from the next tick."""

    label: str  # Label of the slider, with the unit
    low: float
    high: float
    neutral: float  # Slider value that causes no fault
    kind: str  # Kind of the faults that apply the adjusted value
    key: str  # Key of the adjusted value in the fault tables
    others: tuple[Mapping[str, Any], ...] = ({},)
    """Constant keys of the faults that apply the adjusted value, with one table per fault."""
    step: float = 0.001  # Resolution of the slider, in the unit of the label

    def faults(self, value: float) -> list[dict[str, Any]]:
        """Return the faults that apply `value`, limited to the slider range, as tables without start and end times.

        The list is empty for the neutral value.
        """
        value = round(round(min(max(value, self.low), self.high) / self.step) * self.step, 6)
        if abs(value - self.neutral) < 1e-9:
            return []
        return [{"kind": self.kind, self.key: value, **keys} for keys in self.others]


ADJUSTMENTS = {
    "friction": Adjustment("ground friction [-]", 0.05, 1.5, 1.0, "friction", "scale"),
    "tyres": Adjustment(
        *("tyre stiffness [-]", 0.15, 1.0, 1.0, "soft_tyre", "stiffness_share"),
        tuple({"wheel": wheel, "rolling_share": 1.0} for wheel in WHEELS),
    ),
    "dead_band": Adjustment("valve dead band [+V]", 0.0, 2.0, 0.0, "valve_wear", "dead_band_v", ({"gain_share": 1.0},)),
    "latency": Adjustment("receiver latency [+s]", 0.0, 1.0, 0.0, "gnss_latency", "latency_s", step=TICK_S),
}
"""Quantities that the driver can adjust at once, by name, in the order of the panel."""
FAULT_S = 5.0  # Duration of a fault that the driver injects [s]
STEEPEST_DEG = 40.0  # Maximum grade of a slope that the panel can set [deg]


class NextStart(NamedTuple):
    """Settings that take effect at the next start of the drive."""

    grade_deg: float  # Grade of the slope [deg]. If nonzero, terrain without a grade becomes a slope.
    tyre: str = ""  # Kind of the tyre model, or an empty string for the present model
    pressure_bar: float | None = None  # Pressure of all tyres [bar], or None for the present pressures


def fault_kinds() -> list[str]:
    """Return the kinds of faults that a driver can inject, without the kinds used by `ADJUSTMENTS`."""
    used = {each.kind for each in ADJUSTMENTS.values()}
    return [kind for kind in families()["fault"] if kind not in used]


def tyre_kinds() -> list[str]:
    """Return the kinds of all tyre models, for firm ground and for soil."""
    return list(families()["plant.tyre"])


def tyre_kind(scenario: Scenario) -> str:
    """Return the kind of the tyre model in a scenario."""
    assert isinstance(scenario.plant, Mujoco)
    return scenario.plant.tyre.kind


def restart_scenario(scenario: Scenario, settings: NextStart) -> Scenario:
    """Return the scenario with the settings of the next start. Raise `ScenarioError` if a setting is invalid."""
    keys: dict[str, Any] = {}
    if hasattr(scenario.terrain, "grade_deg"):
        keys["terrain.grade_deg"] = settings.grade_deg
    elif settings.grade_deg:
        keys["terrain"] = {"kind": "slope", "grade_deg": settings.grade_deg}
    if settings.tyre and settings.tyre != tyre_kind(scenario):
        keys["plant.tyre"] = {"kind": settings.tyre}
    if settings.pressure_bar is not None:
        keys |= {f"tractor.{axle}_tyre_pressure_bar": settings.pressure_bar for axle in ("front", "rear")}
    return scenario.changed(keys)
