"""Findings: the runs are valid, the conclusions follow from the results, and the pages show the figures."""

import json
import re
from math import nan
from pathlib import Path

import numpy as np
import pytest
from blocks import block
from blocks import page as page_file
from estimates import by_seed, compared_tables, estimate, ratio, select
from measured import claims, figures, findings, ranking

from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep

ROOT = Path(__file__).parents[1]
PAGES = ["findings", "findings_tables"]


def row(value, seed, outcome="completed"):
    return {"seed": seed, "outcome": outcome, "v": value}


def test_mean_without_failed_runs_states_their_number_and_is_not_ranked():
    whole, survivors = estimate([1.0, 1.1, 0.9]), estimate([1.0, 1.1, 0.9, nan])
    assert whole.below(2.0)
    assert whole.above(0.5)
    assert survivors.mean == whole.mean
    assert not survivors.below(2.0)
    assert not survivors.above(0.5)
    assert survivors.short() == "1.00, 1 of 4 failed"
    assert estimate([nan, nan]).text() == estimate([nan]).short() == "failed"


def test_error_ratio_is_the_geometric_mean_over_paired_successful_seeds():
    one = [row(1.0, 1), row(4.0, 2), row(9.0, 3, "diverged"), row(9.0, 4)]
    other = [row(2.0, 2), row(2.0, 1), row(1.0, 3)]
    found = ratio(by_seed(one, lambda r: r["v"]), by_seed(other, lambda r: r["v"]))
    assert (found.n, found.failed) == (2, 1)
    assert found.mean == pytest.approx(1.0)  # geometric mean of 1/2 and 2
    assert found.text().endswith(", 1 of 3 failed")
    assert ratio({}, by_seed(other, lambda r: r["v"])).n == 0


def plan_of(sweep):
    """Yield variant, seed and parameters of each run of a sweep. Tables are JSON text, as in the results table."""
    for run in SweepPlan(read_sweep(sweep)).runs():
        shown = {key: json.dumps(v) if isinstance(v, dict) else v for key, v in run.parameters.items()}
        yield {"variant": run.variant, "seed": run.seed, **shown}


def test_each_run_used_for_the_claims_is_listed_once():
    cells = [(row["study"], row["plant"], row["law"], row["x"], row["seed"]) for row in world()]
    assert len(set(cells)) == len(cells) == 475
    assert {row["study"] for row in world()} == set(claims.STUDIES)


def test_statistics_of_network_parameter_q_are_computed_per_lap():
    q = np.array([0.5, 1.0, 1.0, 0.0, 0.0, 0.0, 0.25])
    turns = [np.arange(7) < 4, np.arange(7) >= 4]
    found = claims.q_numbers(q, turns)
    assert found["q_travel"] == [1.5, 0.25]
    assert found["q_rests"] == pytest.approx([0.5, 2 / 3])


BETTER = {"pd": 1.0, "pd_isgn": 0.9, "pd_t1fnn": 0.9, "pd_t2fnn": 0.5, "pi": 0.9, "lqr": 0.9, claims.FASTER: 0.9}
"""Errors by law in an artificial result in which only the network satisfies the paper's claims."""


EQUAL = dict.fromkeys(BETTER, 1.0)  # Errors of a world in which all laws are as good


def world(errors=BETTER, later=0.8, share=(0.3, 0.7), noise=lambda law, s: 1.0, q_travel=(10.0, 1.0, 0.1)):
    """Return rows of every study with given errors by law and a spread of 1 % over at least three seeds."""
    rows = []
    for study, sweep in claims.STUDIES.items():
        for run in plan_of(sweep):
            law, seed = run["variant"], run["seed"]
            of = {"study": study, "law": law, **claims.plant_and_x(study, run)}
            network = law == claims.T2
            error = errors[law] * (1 + 0.01 * seed) * (noise(law, of["x"]) if study == "noise" else 1.0)
            turns = [{"lateral_mse": error}, {"lateral_mse": error * (later if network else 1.0)}]
            shares = share if network else (0.3, 0.3)
            travel = [*q_travel[:2], *[q_travel[2] * (1 + 0.01 * seed)] * 6]
            values = {"lateral_mse": error, "xte_rms": error, "per_turn": turns, "q_travel": travel}
            values |= {"nn_share": [*shares, *[shares[1]] * 6], "q_rests": [0.5] * 8}
            rows.append({**of, "seed": seed, "outcome": "completed", **values})
    return rows


def verdicts(rows):
    return [found.verdict for found in claims.judged(claims.Claims(rows))]


def test_claims_are_confirmed_if_only_the_network_satisfies_them():
    rows = world(noise=lambda law, s: 0.5 if law == claims.T2 and s > 0.1 else 1.0)
    found = verdicts(rows)
    assert found[:5] == ["confirmed"] * 5
    assert found[5] == "qualified"  # no law minds the soil there


def test_claim_on_type_2_network_is_evaluated_by_the_documented_rule():
    """If type 1 with a larger alpha is better as well, the claim is qualified for any effect of the noise."""
    for strong in (0.7, 0.95):  # gains more under strong noise, or less
        gains = {claims.T2: lambda s, strong=strong: strong if s > 0.1 else 0.9, claims.FASTER: lambda s: 0.9}
        rows = world(errors=EQUAL, noise=lambda law, s, gains=gains: gains.get(law, lambda s: 1.0)(s))
        assert verdicts(rows)[4] == "qualified"
        rows = world(errors=EQUAL, noise=lambda law, s, gains=gains: gains[law](s) if law == claims.T2 else 1.0)
        assert verdicts(rows)[4] == "confirmed"
    assert verdicts(world(errors=EQUAL, noise=lambda law, s: 0.9 if law == claims.T2 and s < 0.1 else 1.0))[4] == (
        "qualified"
    )
    assert verdicts(world(errors=EQUAL))[4] == "refuted"


def test_claim_is_qualified_if_it_also_holds_for_a_null_model():
    assert verdicts(world(errors={**BETTER, "pd_isgn": 0.5}))[0] == "qualified"


def test_claims_without_any_support_are_refuted():
    rows = world(errors=dict.fromkeys(BETTER, 1.0), later=1.2, share=(0.6, 0.4), q_travel=(1.0, 1.0, 4.0))
    assert verdicts(rows)[:5] == ["refuted"] * 5


def test_claim_figures_show_every_law_and_the_table_lists_every_claim(tmp_path):
    rows = world()
    assert claims.claims_table(rows).count("\n| ") == 6
    left, right = figures.drawn(figures.panels(claims.Claims(rows))["better"]).axes[:2]
    assert len(right.lines) >= 3 * 2
    assert {line.get_color() for line in left.lines} >= {figures.COLOURS[law] for law in ("pd_t2fnn", "pd_isgn", "pi")}
    for file in figures.write_claim_figures(rows, tmp_path):
        assert file.stat().st_size > 10_000
        assert (ROOT / "docs" / "images" / file.name).exists()


@pytest.mark.parametrize("page", PAGES)
def test_findings_page_has_its_figures_and_generated_blocks(page):
    file = page_file(page)
    text = file.read_text(encoding="utf-8")
    for image in re.findall(r"\(((?:\.\./)*images/[^)]+)\)", text):
        assert (file.parent / image).stat().st_size > 10_000
    for name in re.findall(r"<!-- end of (.+) -->", text):
        assert len(block(text, name)) > 40, name


def test_every_part_of_the_findings_states_version_and_commit():
    text = "".join(page_file(page).read_text(encoding="utf-8") for page in PAGES)
    assert set(re.findall(r"<!-- standing (\w+) -->", text)) >= set(findings.PARTS)
    assert set(re.findall(r"STUDY=(\w+)", text)) == set(findings.PARTS)


def test_guidance_laws_are_compared_by_mean_errors_and_per_seed():
    values = {"a": {1: 2.0, 2: 2.2, 3: nan}, "b": {1: 1.0, 2: 1.0, 3: 1.0}}
    columns, pairs = {"level": values, "soil": {"b": {1: 3.0}}}, [("a", "b"), ("a", "c")]
    means, differences = compared_tables(columns, pairs).split("\n\n")
    assert means.splitlines()[2].startswith("| a | 2.1 (0.8 to 3.4), 1 of 3 failed | - |")
    assert means.splitlines()[3] == "| b | 1.0 (1.0 to 1.0) | 3.0 |"
    assert differences.splitlines()[2].startswith("| a less b | +1.1 (")
    assert len(differences.splitlines()) == 3
    assert select([{"a": 1}, {"a": 2}], a=1) == [{"a": 1}]


def controllers(seeds, **offsets):
    """Return rows of a sweep of laws with correlated cross-track errors, each with a separate offset."""
    noise = np.random.default_rng(min(seeds)).normal(0, 0.01, len(seeds))
    own = np.random.default_rng(max(seeds)).normal(0, 1e-4, (len(offsets), len(seeds)))
    return [
        {"plant.tyre.kind": "soil", "terrain": '{"kind": "slope", "grade_deg": 10}', "variant": law, "seed": seed}
        | {"outcome": "completed", "xte_rms": 0.1 + offset + noise[k] + own[j, k]}
        for j, (law, offset) in enumerate(offsets.items())
        for k, seed in enumerate(seeds)
    ]


def test_ranks_of_laws_follow_paired_differences_and_may_be_tied():
    first = ranking.by_ground(controllers(range(1, 21), good=0.0, fair=0.002, bad=0.03))
    assert list(first) == ["soil, slope 10"]
    assert ranking.ranks(first["soil, slope 10"]) == {"good": 1, "fair": 2, "bad": 3}
    same = {"a": {1: 0.1, 2: 0.2, 3: 0.15}, "b": {1: 0.2, 2: 0.1, 3: 0.16}, "c": {1: 0.9, 2: 0.9, 3: 0.91}}
    assert ranking.ranks(same) == {"a": 1, "b": 1, "c": 3}


def test_law_with_fewer_failures_ranks_first_regardless_of_error():
    laws = {
        "sure": {1: 30.0, 2: 30.0, 3: 30.0},
        "risky": {1: 1.0, 2: 1.0, 3: nan},
        "lost": dict.fromkeys((1, 2, 3), nan),
    }
    assert ranking.ranks(laws) == {"sure": 1, "risky": 2, "lost": 3}
    table = ranking.ranking_table({"soil": laws}, {"soil": laws})
    assert "1.0, 1 of 3 failed (2)" in table
    assert "failed (3)" in table


def test_claim_with_a_failed_run_is_not_confirmed():
    rows = world(noise=lambda law, s: 0.5 if law == claims.T2 and s > 0.1 else 1.0)
    one = next(row for row in rows if row["study"] == "paper" and row["law"] == claims.T2)
    one |= {"outcome": "stopped"}
    found = claims.judged(claims.Claims(rows))[0]
    assert found.verdict == "qualified"
    assert "1 of 10 failed" in found.network


def test_second_set_of_seeds_confirms_contradicts_or_leaves_open_a_rank():
    first = ranking.by_ground(controllers(range(1, 21), a=0.0, b=0.01, c=0.02))
    again = ranking.by_ground(controllers(range(21, 41), a=0.0, b=0.01, c=0.005))
    assert ranking.compare_sets(first, first) == {ranking.SAME: 3}
    found = ranking.compare_sets(first, again)
    assert found == {ranking.SAME: 2, ranking.OPPOSITE: 1}
    few = ranking.by_ground(controllers(range(50, 51), a=0.0, b=0.01, c=0.02))
    assert ranking.compare_sets(first, few) == {ranking.OPEN: 3}
    assert "| b | 11." in ranking.ranking_table(first, again)
    assert "1 in the opposite" in ranking.compared_text(found)
