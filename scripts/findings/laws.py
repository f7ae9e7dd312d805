"""The stack by law, surface and estimator: the sweep `results`, changed in places, each seed other noise."""

import json

from estimates import by_law, compared_tables, field
from sweeps import Blocks, Row, Study, shipped, variants

from agrobot_mj.control import Nmpc

LAWS, GRID = list(variants("results")), shipped("results")
ESTIMATORS = ("ekf", "ekf_full")
SURFACES = ("level", "soil", "rough D", "side slope 10 deg", "GNSS loss of 5 s", "level, bicycle", "swaths")
"""Surfaces in the order of the tables."""
NETWORK = "network tuned"
RIVALS = ("network as printed", "integral of sgn tuned", "PI", "P + feed-forward", "PI + feed-forward", "LQR", "nmpc")
"""Laws that the tuned network should beat."""


def grids() -> dict[str, dict[str, object]]:
    """What differs from the sweep `results` in the other sweeps."""
    compensated = [{"kind": kind, "terrain_compensation": True} for kind in ESTIMATORS]
    tilted = [{"kind": "rough", "iso_class": "D"}, {"kind": "slope", "grade_deg": 10.0}]
    loss, estimator = {"kind": "gnss_loss", "start_s": 60.0, "end_s": 65.0}, GRID["axes"]["estimator"]
    of_swaths = {key: value for key, value in GRID["set"].items() if key != "path.turns"}
    return {
        "results": {},
        "tilted": {
            "set": {**GRID["set"], "sensors.imu.enabled": True},
            "axes": {"estimator": compensated, "terrain": tilted},
        },
        "loss": {"set": {**GRID["set"], "fault": [loss]}, "axes": {"estimator": estimator}},
        "swaths": {"base": "clothoid_swaths", "set": of_swaths, "axes": {"estimator": estimator[1:]}},
    }


def surface(grid: str, row: Row) -> str:
    """The surface of a run."""
    if grid in ("loss", "swaths"):
        return "GNSS loss of 5 s" if grid == "loss" else "swaths"
    if grid == "tilted":
        return "rough D" if json.loads(row["terrain"])["kind"] == "rough" else "side slope 10 deg"
    plant = json.loads(row["plant"])
    return "level, bicycle" if plant["kind"] == "bicycle" else "soil" if "tyre" in plant else "level"


def laws(study: Study) -> Blocks:
    """Cross-track rms [cm] by law and surface, and what the network is worse by than its rivals, for each estimator."""
    if not study.only_draw and "nmpc" in (study.variants or LAWS):
        Nmpc().memory()  # raises now, not after half the runs, where casadi is missing
    runs: dict[str, dict[str, list[Row]]] = {estimator: {} for estimator in ESTIMATORS}
    for grid, changes in grids().items():
        for row in study.rows(grid, "results", **changes):
            runs[json.loads(row["estimator"])["kind"]].setdefault(surface(grid, row), []).append(row)
    blocks = {}
    for estimator, rows in runs.items():
        errors = {where: by_law(rows[where], field("xte_rms", 100)) for where in SURFACES if where in rows}
        blocks[estimator] = compared_tables(errors, [(NETWORK, rival) for rival in RIVALS]) if errors else ""
    return blocks
