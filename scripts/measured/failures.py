"""Rare failures: splitting beside plain runs, and a failure that two harmless changes make together.

The process of the first is short and cheap, so that plain runs can judge it, and what takes the tractor off its line is
what does so in a field: reflections off trees, which shift the fixes for seconds. Three centimetres are possible for
the phase of the carrier, whose error stays below a quarter of its wave; a tree every 3 s is one in 3.6 m. The heading
is known, as on a line that is being driven: otherwise the first fixes, at rest, decide. That of the second is a lane
change.
"""

import shutil
from typing import Any

from sweeps import Blocks, Row, Study

from agrobot_mj.core.markdown import markdown_table
from agrobot_mj.extensions.search.falsify import FalsifyQuestion, Varied, falsify
from agrobot_mj.extensions.search.limit import Question, limit
from agrobot_mj.extensions.search.risk import RiskQuestion, risk
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.studies.engine import Task, perform
from agrobot_mj.studies.statistics import wilson_interval

TREES = {
    "plant.kind": "bicycle",
    "guidance.kind": "lqr",
    "duration_s": 10.0,
    "sensors.gnss.multipath_sigma_m": 0.03,
    "sensors.gnss.multipath_time_s": 3.0,
    "estimator.initial_yaw_sigma_deg": 0.5,
}
OFTEN_M, RARE_M = 0.12, 0.16
"""Distances from the line that about one run in a hundred, and one in ten thousand, come to [m]."""
REPETITIONS, PARTICLES, PLAIN, CHUNK, PLAIN_SEED = 20, 20, 6000, 50, 200_000
LANES = {"plant.kind": "bicycle", "guidance.kind": "lqr"}
LATE, FAST = Varied.ranged("sensors.gnss.latency_s", 0.0, 0.4), Varied.ranged("path.speed_m_s", 1.2, 3.0)
FAR = "xte_abs_max > 0.3"


def failures(study: Study) -> Blocks:
    """The table of the comparison and the answer of the falsification; draws the failure of each."""
    rows = study.done("failures", plain, range(PLAIN_SEED, PLAIN_SEED + PLAIN, CHUNK))
    if not rows or study.only_draw:
        return {}
    table = risk_table(study, [far for row in rows for far in row["far"]])
    shutil.copyfile(study.runs / f"risk-{RARE_M}" / "risk.png", study.images / "risk.png")
    shown = "![The chance to come so close, and a failure beside an ordinary run](images/risk.png)"
    return {"risk": f"{table}\n\n{shown}", "falsified": falsified(study)}


def plain(first: int) -> Row:
    """How far off the line each of some plain runs comes [m]."""
    scenario = load_scenario("straight_line", TREES)
    seeds = range(first, first + CHUNK)
    return {"far": [perform(Task.of(scenario, {"seed": k})).row["xte_abs_max"] for k in seeds]}


def risk_table(study: Study, far: list[float]) -> str:
    """Probability by each way, the driving that it took, and how much plain runs would need for the same interval."""
    scenario, lines = load_scenario("straight_line", TREES), list[tuple[Any, ...]]()
    for at in (OFTEN_M, RARE_M):
        runs, failed = len(far), sum(x > at for x in far)
        text = _text(failed / runs, *wilson_interval(failed, runs, 0.95))
        lines.append((f"{100 * at:g} cm", f"{runs:,} plain runs", text, f"{runs:,}", "1"))
        question = RiskQuestion(f"xte_abs_max > {at}", PARTICLES, REPETITIONS)
        answer = risk(scenario, question, study.runs / f"risk-{at}", study.jobs)
        found, way = answer.estimate, f"{REPETITIONS} splittings of {PARTICLES} runs"
        times = found.probability * (1 - found.probability) / found.error**2 / answer.worth
        text = _text(found.probability, found.low, found.high)
        lines.append((f"{100 * at:g} cm", way, text, f"{answer.worth:,.0f}", f"{times:.2g}"))
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
