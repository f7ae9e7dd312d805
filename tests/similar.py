"""Scaling of a scenario to a tractor of another mass with the same shape and density.

Lengths scale with mass^(1/3). Quantities that follow from lengths and weight scale with the power of the length below.
The ground and its strength remain unchanged. The path grows with the tractor, because its bends would be too tight.
"""

from typing import Any

from agrobot_mj.scenario.schema import Scenario, resolve

POWERS = {
    **{"stiffness_n_m_rad": 4.0, "damping_n_m_s_rad": 4.5, "friction_n_m": 4.0, "torque_n_m": 4.0},
    **{"torque_limit_n_m": 4.0, "_kw": 3.0, "stiffness_n_m": 2.0, "damping_n_s_m": 2.5, "_kg_m2": 5.0, "_kg": 3.0},
    **{"_n_rad": 3.0, "_n_deg": 3.0, "_n": 3.0, "_l_min_v": 3.0, "_l_min": 3.0, "_per_m": -1.0, "_per_m2": -2.0},
    **{"_mm": 1.0, "_m": 1.0, "size": 1.0},
}
"""Power of the length with which a key scales, by the first matching suffix of the key. Other keys do not change."""
GROWING = ("tractor", "driveline", "steering", "plant", "implement", "fault", "path")
"""Tables of a scenario that scale with the tractor."""
SOIL = ("noise_length_m", "shear_m", "cell_m", "rebound_mpa_m")  # Lengths that belong to the ground and do not scale
DEFAULT_KG = Scenario().tractor.mass_kg


def similar(scenario: Scenario, mass_kg: float) -> Scenario:
    """Return the scenario for a tractor of `mass_kg` [kg]. Raises `ScenarioError` if the tractor is impossible."""
    length = (mass_kg / scenario.tractor.mass_kg) ** (1 / 3)
    data = scenario.model_dump(mode="json", exclude_none=True)
    for table in GROWING:
        data[table] = grown(data[table], length)
    if "size_m" in data["terrain"]:
        data["terrain"]["size_m"] = grown({"size_m": data["terrain"]["size_m"]}, max(length, 1.0))["size_m"]
    return resolve(data, f"{scenario.name} at {mass_kg:g} kg")


def grown(value: Any, length: float, key: str = "") -> Any:
    """Return a value of the key `key`, or a table of values, for a tractor whose lengths are multiplied by `length`."""
    if isinstance(value, dict):
        return {name: grown(inner, length, name) for name, inner in value.items()}
    if isinstance(value, list):
        return [grown(inner, length, key) for inner in value]
    if isinstance(value, bool) or not isinstance(value, int | float) or key in SOIL:
        return value
    power = next((power for ending, power in POWERS.items() if key.endswith(ending)), 0.0)
    return value * length**power if power else value
