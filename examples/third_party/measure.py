"""Print the table of docs/third_party.md: controllers of other projects on the simulated tractor.

Run the script with `make third-party`. A cell contains the cross-track error of the CG, rms / 95th percentile [cm], or
the outcome of an incomplete run. The supervisor is disabled.
"""

import sys
from typing import Any

from avlite_law import AvliteLaw
from rox_drive import drive

import agrobot_mj

TOY: dict[str, Any] = {
    **{"plant.kind": "bicycle", "steering.valve.delay_s": 0.0, "steering.valve.time_constant_s": 0.001},
    **{"steering.valve.dead_band_v": 0.0, "steering.loop.deadband_compensation_v": 0.0},
    **{"sensors.gnss.sigma_m": 0.0, "sensors.gnss.velocity_sigma_m_s": 0.0},
    **{"sensors.steering_pot.noise_sigma_deg": 0.01, "sensors.steering_pot.resolution_deg": 0.01},
}
"""Overrides for the ideal plant: a linear bicycle model without noise, with a fast valve without dead band."""
SURFACES: dict[str, tuple[str, dict[str, Any]]] = {
    "level line": ("straight_line", {"duration_s": 60.0}),
    "side slope 10 deg": ("side_slope_10", {"duration_s": 60.0}),
    "circle, radius 10 m": ("circle", {"duration_s": 60.0}),
    "level line, ideal plant": ("straight_line", {"duration_s": 60.0, **TOY}),
}
"""Scenario and overrides for each table column, by name of the column."""
LAWS: dict[str, dict[str, Any]] = {
    "AVLite Stanley, default (5 1/s)": {"guidance.kind": "avlite"},
    "AVLite Stanley, 0.5 1/s": {"guidance.kind": "avlite", "guidance.gain_per_s": 0.5},
    "AVLite pure pursuit, default (8 m)": {"guidance.kind": "avlite", "guidance.law": "pure_pursuit"},
    "AVLite pure pursuit, 3 m": {
        **{"guidance.kind": "avlite", "guidance.law": "pure_pursuit"},
        "guidance.ahead_m": 3.0,
    },
    "rox-control pure pursuit, 2.5 m": {},
    "ours: Stanley": {"guidance.kind": "stanley"},
    "ours: pure pursuit": {"guidance.kind": "pure_pursuit"},
}


def cell(law: str, scenario: str, keys: dict[str, Any]) -> str:
    """Simulate one run and return its table cell."""
    if law.startswith("rox"):
        metrics = drive(scenario, keys)
    else:
        everything = {**keys, **LAWS[law], "supervisor.enabled": False}
        metrics = agrobot_mj.run(agrobot_mj.load_scenario(scenario, everything)).metrics
    if metrics["outcome"] != "completed":
        return str(metrics["outcome"])
    return f"{100 * metrics['xte_rms']:.1f} / {100 * metrics['xte_abs_p95']:.1f}"


if __name__ == "__main__":
    agrobot_mj.register(AvliteLaw)
    print(f"| law | {' | '.join(SURFACES)} |\n|---|{'---|' * len(SURFACES)}")
    for name in LAWS:
        if len(sys.argv) < 2 or sys.argv[1] in name:
            print(f"| {name} | {' | '.join(cell(name, *surface) for surface in SURFACES.values())} |", flush=True)
