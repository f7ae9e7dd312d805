"""The runs behind the paper's claims: its figure eight, varied one thing at a time (sweeps `claims` and `claims_*`).

A run is a row with its study (the sweep's name behind `claims`, `paper` without), plant, law and `x`, the value of what
the study varies. Laws are the paper's, its null models and a PI controller, all inside the paper's kinematic law and
with its filter.
"""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from sweeps import Row, Study, shipped, variants

from agrobot_mj.metrics.base import RowChoice, RunView
from agrobot_mj.plants import Bicycle

PLANTS = ("bicycle", "mujoco")
PD, ISGN, T1, T2, PI, LQR = "pd", "pd_isgn", "pd_t1fnn", "pd_t2fnn", "pi", "lqr"
FASTER = "pd_t1fnn, faster"
"""Type 1 at about the rate that type 2 comes to."""
FASTER_ALPHA: float = variants("claims_noise")[FASTER]["controller.network.alpha"]
"""That rate [rad/s]."""
STUDIES = {
    "paper": "claims",
    **{name: f"claims_{name}" for name in ("noise", "soil", "gain", "paths", "settling")},
}
"""Sweeps of the studies."""
GAINS: list[float] = shipped("claims_gain")["axes"]["controller.kp"]
"""Proportional gains k_P [rad s/rad]; 0.4 is the default."""
SIGMAS: list[float] = shipped("claims_noise")["axes"]["sensors.gnss.sigma_m"]
"""Standard deviations of the position [m]; the receiver has 0.02."""
LONG_TURNS: int = shipped("claims_settling")["set"]["path.turns"]
"""Turns of the study of q."""


def path_name(path: dict[str, Any]) -> str:
    """A figure eight by radius and speed."""
    return f"{path['radius_m']:g} m, {path['speed_m_s']:g} m/s"


PATHS = [path_name(path) for path in shipped("claims_paths")["axes"]["path"]]
"""Paths beside the paper's."""


def claim_rows(study: Study) -> list[Row]:
    """The rows of all studies; none unless all are there."""
    found = {name: study.rows(sweep) for name, sweep in STUDIES.items()}
    if not all(found.values()):
        return []
    return [claim_row(study, name, row) for name, rows in found.items() for row in rows]


def claim_row(study: Study, name: str, row: Row) -> Row:
    """What the claims need of a run: errors of the whole and turn by turn, shares, and how much q moves."""
    turns = [turn for turn in row["per_turn"] or () if turn["complete"]]
    found = {key: row[key] for key in ("seed", "outcome", "expected", "lateral_mse", "xte_rms")}
    found |= {"study": name, "law": row["variant"], **plant_and_x(name, row)}
    found["lateral_mse_turns"] = [turn["lateral_mse"] for turn in turns]
    found["share_turns"] = (row["nn_share"] or [])[: len(turns)]
    if row["variant"] == T2 and name in ("paper", "settling"):
        run = study.kept(STUDIES[name], row)
        found |= q_numbers(run.column("q"), RunView(run).turns[: len(turns)])
    return found


def plant_and_x(name: str, row: Row) -> Row:
    """The plant, and the value of what the study varies."""
    if name == "soil":
        plant = json.loads(row["plant"])
        stiffness = plant.get("front_cornering_stiffness_n_rad", 0) / Bicycle().front_cornering_stiffness_n_rad
        return {"plant": plant["kind"], "x": plant["tyre"]["cone_index_kpa"] if "tyre" in plant else stiffness}
    axis = {"gain": "controller.kp", "noise": "sensors.gnss.sigma_m"}.get(name)
    x: Any = path_name(json.loads(row["path"])) if name == "paths" else row[axis] if axis else 0.0
    return {"plant": row["plant.kind"], "x": x}


def q_numbers(q: np.ndarray, turns: Sequence[RowChoice]) -> dict[str, list[float]]:
    """For each turn, its ticks: how far q travels, and the share of ticks at rest."""
    steps = np.abs(np.diff(q, prepend=q[0]))
    return {
        "q_travel": [float(steps[rows].sum()) for rows in turns],
        "q_rests": [float(np.mean(steps[rows] == 0.0)) for rows in turns],
    }
