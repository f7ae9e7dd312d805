"""Claims of the paper on its figure eight, with one factor varied at a time (sweeps `claims` and `claims_*`).

A claim is *confirmed* if its confidence interval supports it on both plants and the null models do not show the same
effect. A claim is *qualified* if the null models show the effect or the claim holds only in some cases, and *refuted*
if the claim holds in no case.

A row contains the study (name of the sweep after `claims`, or `paper`), plant, law, and `x`, the value of the varied
factor. The laws are the laws of the paper, null models and a PI controller, all with the paper's kinematic law and
filter.
"""

import json
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from estimates import Estimate, Value, by_seed, field, mean, ratio, select
from sweeps import Row, Study, shipped, variants

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.metrics.base import RowChoice, RunView
from agrobot_mj.plants import Bicycle

PLANTS = ("bicycle", "mujoco")
PD, ISGN, T1, T2, PI, LQR = "pd", "pd_isgn", "pd_t1fnn", "pd_t2fnn", "pi", "lqr"
FASTER = "pd_t1fnn, faster"  # Type-1 network whose learning rate is close to the final rate of type 2
STUDIES = {"paper": "claims", **{name: f"claims_{name}" for name in ("noise", "soil", "gain", "paths", "settling")}}
"""Name of the sweep of each study."""
SIGMAS: list[float] = shipped("claims_noise")["axes"]["sensors.gnss.sigma_m"]
"""Standard deviations of the position in the noise study [m]. The receiver of the paper has 0.02 m."""
TURNS = range(1, 1 + shipped("claims_settling")["set"]["path.turns"])
"""Numbers of the turns of the figure eight in the study of the parameter q of the type-2 network."""
CONFIRMED, QUALIFIED, REFUTED = "confirmed", "qualified", "refuted"
PAPER_RATIO, ROBUST = 0.70, 1.5
"""Ratio of the errors with the network and with PD on the real tractor, from the paper [-], and maximum ratio of the
errors on the softest and on the firmest soil for a robust law [-]."""


def path_name(path: dict[str, Any]) -> str:
    return f"{path['radius_m']:g} m, {path['speed_m_s']:g} m/s"


PATHS = {"10 m, 1.2 m/s": ("paper", 0.0)}
PATHS |= {(name := path_name(path)): ("paths", name) for path in shipped("claims_paths")["axes"]["path"]}
"""Study and value `x` of each figure eight, by name. The first entry is the figure eight of the paper."""


def claim_rows(study: Study) -> list[Row]:
    """Return the rows of all studies, or an empty list if runs are missing."""
    found = {name: study.rows(sweep) for name, sweep in STUDIES.items()}
    if not all(found.values()):
        return []
    return [claim_row(study, name, row) for name, rows in found.items() for row in rows]


def claim_row(study: Study, name: str, row: Row) -> Row:
    """Return a sweep row with its study, law and varied factor, and for type 2 with the variation of the parameter
    q."""
    found = {**row, "study": name, "law": row["variant"], **plant_and_x(name, row)}
    if row["variant"] == T2 and name in ("paper", "settling"):
        run = study.kept(STUDIES[name], row)
        found |= q_numbers(run.column("q"), RunView(run).turns)
    return found


def plant_and_x(name: str, row: Row) -> Row:
    """Return the plant and the varied factor `x` of a row in the study `name`."""
    if name == "soil":
        plant = json.loads(row["plant"])
        stiffness = plant.get("front_cornering_stiffness_n_rad", 0) / Bicycle().front_cornering_stiffness_n_rad
        return {"plant": plant["kind"], "x": plant["tyre"]["cone_index_kpa"] if "tyre" in plant else stiffness}
    axis = {"gain": "controller.kp", "noise": "sensors.gnss.sigma_m"}.get(name)
    x: Any = path_name(json.loads(row["path"])) if name == "paths" else row[axis] if axis else 0.0
    return {"plant": row["plant.kind"], "x": x}


def q_numbers(q: np.ndarray, turns: Sequence[RowChoice]) -> dict[str, list[float]]:
    """Return the total variation of q per turn, and the fraction of ticks per turn in which q is constant."""
    steps = np.abs(np.diff(q, prepend=q[0]))
    return {
        "q_travel": [float(steps[rows].sum()) for rows in turns],
        "q_rests": [float(np.mean(steps[rows] == 0.0)) for rows in turns],
    }


MSE, XTE = field("lateral_mse"), field("xte_rms")


def turn(name: str, number: int, factor: float = 1.0) -> Value:
    """Return a function that reads the value `name` of a turn (from 1) from a row and multiplies it by `factor`."""
    if name == "lateral_mse":
        return lambda row: float(row["per_turn"][number - 1][name])
    return lambda row: factor * float(row[name][number - 1])


class Claims:
    """Rows of all studies, with methods that compute the statistics for claims and figures."""

    def __init__(self, rows: Sequence[Row]) -> None:
        self.rows = rows

    def mean(self, value: Value, plant: str, law: str, study: str = "paper", x: Any = 0.0) -> Estimate:
        return mean(self._runs(plant, law, study, x), value)

    def over(
        self, other: str, plant: str, law: str, study: str = "paper", x: Any = 0.0, value: Value = MSE
    ) -> Estimate:
        """Return `value` (default: lateral mean square error) of a law divided by `value` of the law `other`."""
        return ratio(*(by_seed(self._runs(plant, each, study, x), value) for each in (law, other)))

    def second_turn(
        self, plant: str, law: str, study: str = "paper", x: Any = 0.0, name: str = "lateral_mse"
    ) -> Estimate:
        """Return the value of `name` in the second turn divided by the value in the first turn."""
        runs = self._runs(plant, law, study, x)
        return ratio(*(by_seed(runs, turn(name, number)) for number in (2, 1)))

    def soils(self, plant: str) -> list[float]:
        """Return the soils in the study `soil`, softest first: cone indices [kPa], or relative stiffnesses of the
        bicycle model [-]."""
        return sorted({row["x"] for row in select(self.rows, study="soil", plant=plant)})

    def softest(self, plant: str, law: str) -> Estimate:
        """Return the cross-track RMS of a law on the softest soil divided by its RMS on the firmest soil."""
        soils = self.soils(plant)
        return ratio(*(by_seed(self._runs(plant, law, "soil", x), XTE) for x in (soils[0], soils[-1])))

    def _runs(self, plant: str, law: str, study: str, x: Any) -> list[Row]:
        return select(self.rows, study=study, plant=plant, law=law, x=x)


class Judged(NamedTuple):
    """Claim with its verdict and the results that support it."""

    claim: str
    verdict: str
    network: str  # Result of the paper's network on both plants
    null: str  # Results of the null models


def claims_table(rows: Sequence[Row]) -> str:
    lines = [(each.claim, f"**{each.verdict}**", each.network, each.null) for each in judged(Claims(rows))]
    return markdown_table(("claim", "verdict", "the paper's network", "baseline to beat"), lines)


def judged(claims: Claims) -> list[Judged]:
    return [judge(claims) for judge in (_better, _takes_over, _second_turn, _settles, _type_2, _soil)]


def both(function: Callable[[str], Estimate]) -> str:
    return "; ".join(f"{plant} {function(plant).text()}" for plant in PLANTS)


def _verdict(holds: Sequence[bool], null_too: bool) -> str:
    if not any(holds):
        return REFUTED
    return CONFIRMED if all(holds) and not null_too else QUALIFIED


def _better(claims: Claims) -> Judged:
    holds, null = ([claims.over(PD, plant, law).below(PAPER_RATIO) for plant in PLANTS] for law in (T2, ISGN))
    network = f"MSE over that of PD: {both(lambda p: claims.over(PD, p, T2))}"
    others = ", ".join(f"{law} {claims.over(PD, PLANTS[1], law).text()}" for law in (ISGN, T1, PI))
    return Judged("30 % better than PD", _verdict(holds, all(null)), network, f"MuJoCo: {others}")


def _takes_over(claims: Claims) -> Judged:
    """Evaluate the claim that PD provides most of the command in the first turn, and the network in later turns."""

    def share(plant: str, law: str, number: int) -> Estimate:
        return claims.mean(turn("nn_share", number), plant, law)

    def text(law: str) -> str:
        return "; ".join(f"{p} {share(p, law, 1).short(3)}, then {share(p, law, 2).short(3)}" for p in PLANTS)

    holds = [share(plant, T2, 2).above(0.5) for plant in PLANTS] + [share(plant, T2, 1).below(0.5) for plant in PLANTS]
    verdict = _verdict(holds, all(share(plant, ISGN, 2).above(0.5) for plant in PLANTS))
    network = f"share of the command in turns 1 and 2: {text(T2)}"
    return Judged("the network takes over after the first turn", verdict, network, f"{ISGN}: {text(ISGN)}")


def _second_turn(claims: Claims) -> Judged:
    cases = [claims.second_turn(plant, T2, *case) for plant, case in product(PLANTS, PATHS.values())]
    null = all(claims.second_turn(plant, ISGN).below(1.0) for plant in PLANTS)
    text = f"MSE of turn 2 over turn 1: {both(lambda p: claims.second_turn(p, T2))}"
    text += f"; above 1 in {sum(case.mean > 1.0 for case in cases)} of {len(cases)} cases"
    verdict = _verdict([case.below(1.0) for case in cases], null)
    return Judged("better in the second turn", verdict, text, f"{ISGN}: {both(lambda p: claims.second_turn(p, ISGN))}")


def _settles(claims: Claims) -> Judged:
    travel = [claims.second_turn(plant, T2, name="q_travel") for plant in PLANTS]
    last = [claims.mean(turn("q_travel", TURNS[-1]), plant, T2, "settling") for plant in PLANTS]
    verdict = _verdict([each.below(0.5) for each in travel] + [all(each.below(1.0) for each in last)], False)
    text = f"travel of q, turn 2 over turn 1: {both(lambda p: claims.second_turn(p, T2, name='q_travel'))}"
    text += f"; in turn {TURNS[-1]} still " + ", ".join(each.short(1) for each in last)
    return Judged("q settles", verdict, text, "from limit to limit is 1; f rises meanwhile like a ratchet")


def _type_2(claims: Claims) -> Judged:
    """Evaluate the claim that type 2 is better than type 1, at minimum and maximum noise. The null model is type 1 with
    a larger learning rate alpha."""

    def over(other: str, law: str, plant: str, sigma: float) -> Estimate:
        return claims.over(other, plant, law, "noise", sigma)

    cases, high = list(product(PLANTS, (SIGMAS[0], SIGMAS[-1]))), SIGMAS[-1]
    verdict = _verdict(
        [over(T1, T2, *case).below(1.0) for case in cases], all(over(T1, FASTER, *case).below(1.0) for case in cases)
    )
    text = "; ".join(f"{p} {over(T1, T2, p, s).text()} at {s:g} m" for p, s in cases)
    alone, above = (both(lambda p, pair=pair: over(*pair, p, high)) for pair in ((T1, FASTER), (FASTER, T2)))
    alpha = variants("claims_noise")[FASTER]["controller.network.alpha"]
    null = f"type 1 at alpha {alpha:g} over that at 0.02, at {high:g} m: {alone}; type 2 over it: {above}"
    network = f"MSE of type 2 over type 1 at equal alpha: {text}"
    return Judged("type 2 is better than type 1 under noise", verdict, network, null)


def _soil(claims: Claims) -> Judged:
    """Evaluate the claim of robustness on soft soil: an error ratio below `ROBUST`, also for the null models."""
    holds = [claims.softest(plant, T2).below(ROBUST) for plant in PLANTS]
    null_too = all(claims.softest(*case).below(ROBUST) for case in product(PLANTS, (PD, ISGN)))
    null = ", ".join(f"{law} {claims.softest(PLANTS[1], law).text()}" for law in (PD, ISGN, PI, LQR))
    text = f"cross-track rms, softest over firmest: {both(lambda p: claims.softest(p, T2))}"
    return Judged("robust without knowing the soil", _verdict(holds, null_too), text, f"MuJoCo: {null}")
