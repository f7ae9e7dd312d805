"""The runs behind the verdict on the paper's claims: the paper's figure eight, varied one thing at a time.

A cell is a study (which claim it serves), a plant, a law and a value of what is varied; each seed of it is a run. The
laws are the paper's, its null models and a PI controller, all inside the paper's kinematic law and with its filter.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from agrobot_mj.metrics.base import RowChoice, RunView
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.simulation.log import Log
from agrobot_mj.simulation.run import run

PLANTS = ("bicycle", "mujoco")
PD, ISGN, T1, T2, PI, LQR = "pd", "pd_isgn", "pd_t1fnn", "pd_t2fnn", "pi", "lqr"
FASTER = "pd_t1fnn, faster"
"""Type 1 at about the rate that type 2 comes to."""
FASTER_ALPHA = 0.0225
"""That rate [rad/s]; type 2 has alpha = 0.02, to which its q adds 7 to 11 %."""
ONE_TURN = {"path.turns": 1}
RADII: dict[float, dict[str, Any]] = {6.0: {"path.straight_m": 17, "path.run_in_m": 8}, 15.0: {"path.straight_m": 42}}
"""Radii of the arcs [m] with straights that fit."""
SPEEDS = (0.8, 2.0)
"""Speeds beside the paper's [m/s]."""
GAINS = (0.4, 0.6, 0.8, 1.2)
"""Proportional gains k_P [rad s/rad]; 0.4 is the default."""
SIGMAS = (0.005, 0.02, 0.05, 0.1, 0.2)
"""Standard deviations of the position [m]; the receiver has 0.02."""
CONES = (250.0, 450.0, 900.0, 1800.0)
"""Cone indices, tilled to firm [kPa]."""
STIFFNESSES = (0.5, 0.7, 1.0, 1.5, 2.0)
"""Cornering stiffnesses over those of the model [-]."""
LONG_TURNS = 8
"""Turns of the study of q."""


class ClaimCell(NamedTuple):
    """One cell, of which each seed is a run."""

    study: str
    plant: str
    law: str
    x: float
    """Value of what the study varies."""
    overrides: dict[str, Any]

    def key(self, seed: int) -> str:
        """Name of a run."""
        return f"{self.study}|{self.plant}|{self.law}|{self.x:g}|{seed}"


_KINDS: dict[str, dict[str, Any]] = {
    FASTER: {"controller.kind": T1, "controller.network.alpha": FASTER_ALPHA},
    LQR: {"guidance.kind": LQR},
}
"""Overrides of laws that are more than a kind of yaw controller."""


def claim_cells(study: str) -> Iterator[ClaimCell]:
    """The cells of a study."""
    for plant in PLANTS:
        for law, x, overrides in _VARIED[study](plant):
            kinds = _KINDS.get(law, {"controller.kind": law})
            yield ClaimCell(study, plant, law, x, {"plant.kind": plant, **kinds, **overrides})


Varied = Iterator[tuple[str, float, dict[str, Any]]]
"""Law, value and overrides."""


def _paper(plant: str) -> Varied:
    yield from ((law, 0.0, {}) for law in (PD, ISGN, T1, T2, PI))


def _gain(plant: str) -> Varied:
    yield from ((law, k, {**ONE_TURN, "controller.kp": k}) for k in GAINS for law in (PD, ISGN, T2))


def _radius(plant: str) -> Varied:
    yield from ((law, r, {"path.radius_m": r, **path}) for r, path in RADII.items() for law in (PD, ISGN, T2))


def _speed(plant: str) -> Varied:
    yield from ((law, v, {"path.speed_m_s": v}) for v in SPEEDS for law in (PD, ISGN, T2))


def _noise(plant: str) -> Varied:
    yield from ((law, s, {**ONE_TURN, "sensors.gnss.sigma_m": s}) for s in SIGMAS for law in (T1, FASTER, T2))


def _soil(plant: str) -> Varied:
    """Soil under the MuJoCo tractor; cornering stiffness, the bicycle's only trace of soil, on the bicycle."""
    front, rear = 14800.0, 30000.0
    for law in (PD, ISGN, T2, PI, LQR):
        if plant == "mujoco":
            for cone in CONES:
                yield law, cone, {**ONE_TURN, "plant.tyre.kind": "soil", "plant.tyre.cone_index_kpa": cone}
        else:
            for share in STIFFNESSES:
                stiffness = {"front": front * share, "rear": rear * share}
                keys = {f"plant.{axle}_cornering_stiffness_n_rad": value for axle, value in stiffness.items()}
                yield law, share, {**ONE_TURN, **keys}


def _settling(plant: str) -> Varied:
    yield T2, 0.0, {"path.turns": LONG_TURNS}


_VARIED = {
    "paper": _paper,
    "noise": _noise,
    "soil": _soil,
    "gain": _gain,
    "radius": _radius,
    "speed": _speed,
    "settling": _settling,
}
STUDIES = tuple(_VARIED)
"""Names of the studies."""


def claim_jobs(seeds: dict[str, int]) -> dict[str, tuple[ClaimCell, int]]:
    """All runs by key, for a number of seeds of each study; low seeds of all studies first."""
    cells = {study: list(claim_cells(study)) for study in seeds}
    order = ((study, seed) for seed in range(1, max(seeds.values()) + 1) for study in seeds if seed <= seeds[study])
    return {cell.key(seed): (cell, seed) for study, seed in order for cell in cells[study]}


def claim_run(job: tuple[str, tuple[ClaimCell, int]]) -> dict[str, Any]:
    """The row of one run."""
    key, (cell, seed) = job
    log = run(load_scenario("figure_eight", {**cell.overrides, "seed": seed}))
    about = {"key": key, "study": cell.study, "plant": cell.plant, "law": cell.law, "x": cell.x, "seed": seed}
    return {**about, "outcome": log.outcome, **claim_numbers(log)}


def claim_numbers(log: Log) -> dict[str, Any]:
    """What the verdict needs of a run: errors of the whole and turn by turn, shares, and how much q moves."""
    m = log.metrics
    turns = [turn for turn in m["per_turn"] if turn["complete"]]
    names = ("lateral_mse", "xte_rms", "yaw_rate_error_rms")
    found = {name: m[name] for name in names}
    found |= {f"{name}_turns": [turn[name] for turn in turns] for name in names}
    found["share_turns"] = m["nn_share"][: len(turns)]
    if "fnn" in log.scenario.controller.kind:
        found |= q_numbers(log.column("q"), RunView(log).turns[: len(turns)])
    return found


def q_numbers(q: np.ndarray, turns: Sequence[RowChoice]) -> dict[str, list[float]]:
    """For each turn, its ticks: how far q travels, how often it crosses 1/2, and the share of ticks at rest."""
    steps, crossings = np.abs(np.diff(q, prepend=q[0])), np.diff(q > 0.5, prepend=q[0] > 0.5)
    return {
        "q_travel": [float(steps[rows].sum()) for rows in turns],
        "q_crossings": [int(crossings[rows].sum()) for rows in turns],
        "q_rests": [float(np.mean(steps[rows] == 0.0)) for rows in turns],
    }
