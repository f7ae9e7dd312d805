"""The paper's claims, judged by the runs of `claims`: confirmed, qualified or refuted by rule, with the numbers.

A claim is *confirmed* if the interval of what it says lies on its side on both plants and the null models do not do
the same; *qualified* if they do, or if it holds in some of the cases only; *refuted* if it does not hold in any.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from estimates import Estimate, field, mean, ratio, select
from sweeps import Row
from verdict.claims import FASTER, FASTER_ALPHA, ISGN, LQR, PATHS, PD, PI, PLANTS, SIGMAS, T1, T2

from agrobot_mj.core.markdown import markdown_table

CONFIRMED, QUALIFIED, REFUTED = "confirmed", "qualified", "refuted"
PAPER_RATIO = 0.70
"""Error with the network over that of PD alone, of the real tractor [-]."""
ROBUST = 1.5
"""Error on the softest soil over that on the firmest up to which a law counts as robust [-]."""
Rows = Sequence[Row]


class Judged(NamedTuple):
    """One claim."""

    claim: str
    verdict: str
    network: str
    """What the paper's network does, on the bicycle and on MuJoCo."""
    null: str
    """What the models that it has to beat do."""


mse, xte = field("lateral_mse"), field("xte_rms")


def turn(name: str, number: int) -> Callable[[Row], float]:
    """The value of `name` in turn `number`, from 1."""
    return lambda row: float(row[name][number - 1])


def over_pd(rows: Rows, plant: str, law: str, study: str = "paper", x: float | str = 0.0) -> Estimate:
    """Lateral mean square error of a law over that of PD alone."""
    of = {"study": study, "plant": plant, "x": x}
    return ratio(select(rows, law=law, **of), select(rows, law=PD, **of), mse)


def second_turn(
    rows: Rows, plant: str, law: str, study: str = "paper", x: float | str = 0.0, name: str = ""
) -> Estimate:
    """`name`, by default the lateral mean square error, of the second turn over that of the first."""
    runs, name = select(rows, law=law, study=study, plant=plant, x=x), name or "lateral_mse_turns"
    return ratio(runs, runs, turn(name, 2), turn(name, 1))


def share(rows: Rows, plant: str, law: str, number: int) -> Estimate:
    """Share of the network, or of its null model, in the steering command of a turn."""
    return mean(select(rows, study="paper", plant=plant, law=law), turn("share_turns", number))


def against_type_1(rows: Rows, plant: str, sigma: float, law: str) -> Estimate:
    """Lateral mean square error of type 2 over that of type 1 at a noise of the position [m]."""
    of = {"study": "noise", "plant": plant, "x": sigma}
    return ratio(select(rows, law=T2, **of), select(rows, law=law, **of), mse)


def faster_type_1(rows: Rows, plant: str, sigma: float) -> Estimate:
    """Lateral mean square error of type 1 at its larger alpha over that at the common one, at a noise [m]."""
    of = {"study": "noise", "plant": plant, "x": sigma}
    return ratio(select(rows, law=FASTER, **of), select(rows, law=T1, **of), mse)


def softest_over_firmest(rows: Rows, plant: str, law: str) -> Estimate:
    """Cross-track rms on the softest soil over that on the firmest; on the bicycle, by cornering stiffness."""
    runs = select(rows, study="soil", plant=plant, law=law)
    values = [row["x"] for row in runs]
    return ratio(select(runs, x=min(values)), select(runs, x=max(values)), xte)


def both(function: Callable[[str], Estimate], digits: int = 2) -> str:
    """An estimate on both plants, as text."""
    return "; ".join(f"{plant} {function(plant).text(digits)}" for plant in PLANTS)


def judged(rows: Rows) -> list[Judged]:
    """All claims, in the order of the page."""
    return [_better(rows), _takes_over(rows), _second_turn(rows), _settles(rows), _type_2(rows), _soil(rows)]


def _verdict(holds: Sequence[bool], null_too: bool) -> str:
    if not any(holds):
        return REFUTED
    return CONFIRMED if all(holds) and not null_too else QUALIFIED


def _better(rows: Rows) -> Judged:
    holds = [over_pd(rows, plant, T2).below(PAPER_RATIO) for plant in PLANTS]
    null = all(over_pd(rows, plant, ISGN).below(PAPER_RATIO) for plant in PLANTS)
    network = f"MSE over that of PD: {both(lambda p: over_pd(rows, p, T2))}"
    others = ", ".join(f"{law} {over_pd(rows, PLANTS[1], law).text()}" for law in (ISGN, T1, PI))
    return Judged("30 % better than PD", _verdict(holds, null), network, f"MuJoCo: {others}")


def _takes_over(rows: Rows) -> Judged:
    """The paper: PD dominates in the first turn, the network leads after it."""
    leads = [share(rows, plant, T2, 2).above(0.5) for plant in PLANTS]
    later = [share(rows, plant, T2, 1).below(0.5) for plant in PLANTS]
    null = all(share(rows, plant, ISGN, 2).above(0.5) for plant in PLANTS)

    def text(law: str) -> str:
        return "; ".join(
            f"{p} {share(rows, p, law, 1).short(3)}, then {share(rows, p, law, 2).short(3)}" for p in PLANTS
        )

    return Judged(
        "the network takes over after the first turn",
        _verdict([*leads, *later], null),
        f"share of the command in turns 1 and 2: {text(T2)}",
        f"{ISGN}: {text(ISGN)}",
    )


def _second_turn(rows: Rows) -> Judged:
    cases: list[tuple[str, str, float | str]] = [(plant, "paper", 0.0) for plant in PLANTS]
    cases += [(plant, "paths", path) for plant in PLANTS for path in PATHS]
    holds = [second_turn(rows, plant, T2, study, x).below(1.0) for plant, study, x in cases]
    null = all(second_turn(rows, plant, ISGN).below(1.0) for plant in PLANTS)
    worse = sum(second_turn(rows, plant, T2, study, x).mean > 1.0 for plant, study, x in cases)
    text = f"MSE of turn 2 over turn 1: {both(lambda p: second_turn(rows, p, T2))}"
    text += f"; above 1 in {worse} of {len(cases)} cases"
    return Judged(
        "better in the second turn",
        _verdict(holds, null),
        text,
        f"{ISGN}: {both(lambda p: second_turn(rows, p, ISGN))}",
    )


def _settles(rows: Rows) -> Judged:
    holds = [second_turn(rows, plant, T2, name="q_travel").below(0.5) for plant in PLANTS]
    last = [mean(select(rows, study="settling", plant=plant), turn("q_travel", 8)) for plant in PLANTS]
    rests = all(found.below(1.0) for found in last)
    text = f"travel of q, turn 2 over turn 1: {both(lambda p: second_turn(rows, p, T2, name='q_travel'))}"
    text += "; in turn 8 still " + ", ".join(found.short(1) for found in last)
    return Judged(
        "q settles",
        _verdict([*holds, rests], False),
        text,
        "from limit to limit is 1; f rises meanwhile like a ratchet",
    )


def _type_2(rows: Rows) -> Judged:
    """Cases are the weakest and the strongest noise on both plants; the null model is type 1 with a larger alpha."""
    low, high = SIGMAS[0], SIGMAS[-1]
    cases = [(plant, sigma) for plant in PLANTS for sigma in (low, high)]
    holds = [against_type_1(rows, *case, T1).below(1.0) for case in cases]
    null = all(faster_type_1(rows, *case).below(1.0) for case in cases)
    text = "; ".join(f"{p} {against_type_1(rows, p, s, T1).text()} at {s:g} m" for p, s in cases)
    alone = "; ".join(f"{p} {faster_type_1(rows, p, high).text()}" for p in PLANTS)
    faster = "; ".join(f"{p} {against_type_1(rows, p, high, FASTER).text()}" for p in PLANTS)
    return Judged(
        "type 2 is better than type 1 under noise",
        _verdict(holds, null),
        f"MSE of type 2 over type 1 at equal alpha: {text}",
        f"type 1 at alpha {FASTER_ALPHA:g} over that at 0.02, at {high:g} m: {alone}; type 2 over it: {faster}",
    )


def _soil(rows: Rows) -> Judged:
    """Robust if the softest soil costs less than half as much again as the firmest; the null models are asked, too."""
    holds = [softest_over_firmest(rows, plant, T2).below(ROBUST) for plant in PLANTS]
    null_too = all(softest_over_firmest(rows, plant, law).below(ROBUST) for plant in PLANTS for law in (PD, ISGN))
    null = ", ".join(f"{law} {softest_over_firmest(rows, PLANTS[1], law).text()}" for law in (PD, ISGN, PI, LQR))
    text = f"cross-track rms, softest over firmest: {both(lambda p: softest_over_firmest(rows, p, T2))}"
    return Judged("robust without knowing the soil", _verdict(holds, null_too), text, f"MuJoCo: {null}")


def claims_table(found: Sequence[Judged]) -> str:
    """Markdown table of the claims."""
    rows = [(each.claim, f"**{each.verdict}**", each.network, each.null) for each in found]
    return markdown_table(("claim", "verdict", "the paper's network", "what it has to beat"), rows)
