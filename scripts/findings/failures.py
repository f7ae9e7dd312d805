"""Rare failures: splitting beside plain runs, and a failure that two harmless changes make together.

The process of the first is short and cheap, so that plain runs can judge it: four seconds of the bicycle on a straight
line under LQR, off the line by some centimetres. That of the second is a lane change.
"""

import shutil
from typing import Any

from sweeps import Blocks, Row, Study

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.studies.engine import Done, Task, base_text, perform
from agrobot_mj.studies.falsify import FalsifyQuestion, Varied, falsify
from agrobot_mj.studies.limit import Question, limit
from agrobot_mj.studies.limit.question import condition_of
from agrobot_mj.studies.risk import RiskQuestion, risk
from agrobot_mj.studies.risk.command import worth_of
from agrobot_mj.studies.risk.population import populations
from agrobot_mj.studies.risk.question import mean_of
from agrobot_mj.studies.statistics import wilson_interval

DRIFT = {"plant.kind": "bicycle", "guidance.kind": "lqr", "duration_s": 4.0}
OFTEN_M, RARE_M = 0.038, 0.05
"""Distances from the line that about one run in a hundred, and one in ten thousand, come to [m]."""
REPETITIONS, PARTICLES, PLAIN, CHUNK, PLAIN_SEED = 20, 40, 2000, 250, 200_000
JOBS = [
    *(("plain", PLAIN_SEED + first) for first in range(0, PLAIN, CHUNK)),
    *(("split", at, number) for at in (OFTEN_M, RARE_M) for number in range(REPETITIONS)),
]
"""All pieces of work of the comparison."""
LANES = {"plant.kind": "bicycle", "guidance.kind": "lqr"}
LATE, FAST = Varied.ranged("sensors.gnss.latency_s", 0.0, 0.4), Varied.ranged("path.speed_m_s", 1.2, 3.0)
FAR = "xte_abs_max > 0.3"


def failures(study: Study) -> Blocks:
    """The table of the comparison and the answer of the falsification; draws the failure of each."""
    rows = study.done("failures", piece, JOBS)
    if not rows or study.only_draw:
        return {}
    flat = load_scenario("straight_line", DRIFT)
    risk(flat, RiskQuestion(f"xte_abs_max > {RARE_M}", PARTICLES, 3), study.runs / "risk", study.jobs)
    shutil.copyfile(study.runs / "risk" / "risk.png", study.images / "risk.png")
    shown = "![The chance to come so close, and a failure beside an ordinary run](images/risk.png)"
    return {"risk": f"{risk_table(rows)}\n\n{shown}", "falsified": falsified(study)}


def piece(job: tuple[Any, ...]) -> Row:
    """The row of a piece: how many of some plain runs fail, or what one splitting says."""
    scenario = load_scenario("straight_line", DRIFT)
    if job[0] == "plain":
        base, seeds = base_text(scenario), range(job[1], job[1] + CHUNK)
        far = [do([Task(0, base, scenario.name, {"seed": seed})])[0].numbers["xte_abs_max"] for seed in seeds]
        return {
            "kind": "plain",
            "runs": CHUNK,
            "failed": {str(at): sum(x > at for x in far) for at in (OFTEN_M, RARE_M)},
        }
    _, at, number = job
    question = RiskQuestion(f"xte_abs_max > {at}", PARTICLES, 1)
    first = scenario.changed({"seed": 1 + number * PARTICLES})
    found = populations(first, question, condition_of(question.until, scenario), do, lambda population: None)
    return {"kind": "split", "at": at, "probability": found[0].split.probability, "worth": worth_of(found)}


def do(tasks: Any) -> list[Done]:
    """Does tasks one after the other."""
    return list(map(perform, tasks))


def risk_table(rows: list[Row]) -> str:
    """Probability by each way, the driving that it took, and how much plain runs would need for the same interval."""
    plain = [row for row in rows if row["kind"] == "plain"]
    lines = []
    for at in (OFTEN_M, RARE_M):
        runs, failed = sum(row["runs"] for row in plain), sum(row["failed"][str(at)] for row in plain)
        low, high = wilson_interval(failed, runs, 0.95)
        lines.append((f"{100 * at:g} cm", f"{runs:,} plain runs", _text(failed / runs, low, high), f"{runs:,}", "1"))
        some = [row for row in rows if row["kind"] == "split" and row["at"] == at]
        worth, found = sum(row["worth"] for row in some), mean_of([row["probability"] for row in some])
        times = found.probability * (1 - found.probability) / found.error**2 / worth
        way, text = f"{len(some)} splittings of {PARTICLES} runs", _text(found.probability, found.low, found.high)
        lines.append((f"{100 * at:g} cm", way, text, f"{worth:,.0f}", f"{times:.1f}"))
    heads = ("off the line by", "found by", "probability (95 %)", "whole runs driven", "times cheaper than plain runs")
    return markdown_table(heads, lines, 2)


def _text(mean: float, low: float, high: float) -> str:
    return f"{mean:.2g} ({low:.2g} to {high:.2g})"


def falsified(study: Study) -> str:
    """What limits along each key say, and the mildest combination."""
    scenario = load_scenario("lane_change", LANES)
    folder, question = study.runs / "falsify", FalsifyQuestion((LATE, FAST), FAR, 60, 1)
    mild = scenario.changed(question.overrides(scenario, (0.0, 0.0)))
    found = []
    for each in (LATE, FAST):
        along = Question(each.key, each.start, each.at(1.0), FAR, 2)
        found += limit(mild, along, [], study.runs / f"limit-{each.key}", study.jobs)
    answer = falsify(scenario, question, folder, study.jobs)
    shutil.copyfile(folder / "falsify.png", study.images / "falsify.png")
    said = "\n".join(f"- {each.statement.split('. ')[0]}." for each in (*found, answer))
    return f"{said}\n\n![Combinations tried, and the failure beside a mild run](images/falsify.png)"
