"""Importance of random parameters: sampling designs, and results for functions with known indices."""

import json
from math import pi, sqrt

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import tomli_w

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.extensions.search.importance.results import (
    importance,
    importance_figure,
    importance_rows,
    importance_texts,
    influence,
    noise_share,
)
from agrobot_mj.extensions.search.importance.shares import (
    FEWEST,
    Share,
    rank_shares,
    regression,
    sobol_flaws,
    sobol_shares,
)
from agrobot_mj.simulation.results import claim
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep, resolve_sweep

KEYS = ("steering.valve.delay_s", "steering.valve.dead_band_v", "tractor.mass_kg")
TEXT = (
    'base = "circle"\nseeds = SEEDS\nmethod = "METHOD"\nsamples = SAMPLES\n[axes]\n"seed_of_rain" = [1, 2]\n[draws]\n'
)
TEXT += "".join(f'"{key}" = {{ uniform = [{-pi}, {pi}] }}\n' for key in KEYS)


def in_file(folder):
    """Return the content of importance.json for each group."""
    return json.loads((folder / "importance.json").read_text())["groups"]


def plain(found):
    """Return influences as JSON values."""
    return [
        {**each._asdict(), "flaws": list(each.flaws), "shares": [share._asdict() for share in each.shares]}
        for each in found
    ]


@pytest.fixture
def plan(tmp_path):
    """Return the plan of a design with numbers of samples and seeds, and two groups that differ in an unused key."""

    def made(samples, seeds=1, method="saltelli"):
        text = TEXT.replace("SAMPLES", str(samples)).replace("SEEDS", str(seeds)).replace("METHOD", method)
        (tmp_path / "mine.toml").write_text(text)
        return SweepPlan(read_sweep(tmp_path / "mine.toml"))

    return made


def ishigami(x1, x2, x3, a=7.0, b=0.1):
    """Return the value of the test function of Ishigami and Homma."""
    return np.sin(x1) + a * np.sin(x2) ** 2 + b * x3**4 * np.sin(x1)


A, B = 7.0, 0.1
V1, V2, V13 = 0.5 * (1 + B * pi**4 / 5) ** 2, A**2 / 8, 8 * B**2 * pi**8 / 225
ISHIGAMI_VARIANCE = V1 + V2 + V13
ISHIGAMI_FIRST = np.array([V1, V2, 0.0]) / ISHIGAMI_VARIANCE
ISHIGAMI_TOTAL = np.array([V1 + V13, V2, V13]) / ISHIGAMI_VARIANCE  # Sobol indices of the function in closed form


def written(plan, folder, left_out=0):
    """Write a results folder as `sweep` does, with a test function as metric. In the second group, x3 is 0."""
    claim(folder, ("sweep.toml", "sweep.parquet"))
    (folder / "sweep.toml").write_text(tomli_w.dumps(resolve_sweep(plan.sweep)))
    rows = []
    for run in list(plan.runs())[left_out:]:
        x1, x2, x3 = (run.parameters[key] for key in KEYS)
        value = ishigami(x1, x2, x3 if run.parameters["seed_of_rain"] == 1 else 0.0)
        noise = 1e-3 * (-1) ** run.seed
        rows.append(
            {"run": run.number, "seed": run.seed, **run.parameters, "outcome": "completed", "xte_rms": value + noise}
        )
    pq.write_table(pa.Table.from_pylist(rows), folder / "sweep.parquet")
    return folder


def test_sobol_design_changes_one_parameter_at_a_time(plan):
    found = plan(4, seeds=2)
    assert found.total == 2 * 4 * 5 * 2
    table = np.array([[run.parameters[key] for key in KEYS] for run in found.runs()]).reshape(2, 4, 5, 2, 3)
    assert np.all(table == table[:1, :, :, :1])  # the same under every value of the axis and every seed
    for a, *mixed, b in table[0, :, :, 0]:
        for k, point in enumerate(mixed):
            assert np.flatnonzero(point != a).tolist() == [k]
            assert point[k] == b[k]


def test_sensitivity_index_intervals_cover_the_known_indices(plan, tmp_path):
    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    found = importance(written(plan(512, seeds=2), tmp_path / "out"))
    wanted = dict(zip(KEYS, zip(ISHIGAMI_FIRST, ISHIGAMI_TOTAL, strict=True), strict=True))
    for share in found[0].shares:
        first, total = wanted[share.key]
        assert share.effect == pytest.approx(first, abs=1.2 * share.half)
        assert share.low - 1e-9 <= total <= share.high + 1e-9
        assert share.high - share.low < 0.3
    assert found[0].deviation ** 2 == pytest.approx(ISHIGAMI_VARIANCE, rel=0.1)
    assert found[0].noise == pytest.approx(0.0, abs=1e-9)
    assert found[1].shares[-1].key == KEYS[2]
    assert found[1].shares[-1].share == pytest.approx(0.0, abs=1e-9)
    assert found[1].shares[-1].rank == "3"
    assert (tmp_path / "out" / "importance.png").stat().st_size > 5000
    assert in_file(tmp_path / "out") == plain(found)
    assert len(importance_rows(found)[1]) == 3


def test_results_unusable_for_importance_are_reported(plan, tmp_path, monkeypatch):
    import sys

    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    with pytest.raises(ScenarioError, match="specify the results folder of a sweep"):
        importance(tmp_path)
    short = written(plan(4), tmp_path / "short", left_out=3)
    with pytest.raises(ScenarioError, match="3 of 40 runs are missing"):
        importance(short)
    whole = written(plan(4), tmp_path / "whole")
    with pytest.raises(ScenarioError, match="--metric xte_rmss: no such column; did you mean 'xte_rms'"):
        importance(whole, "xte_rmss")
    for name in ("outcome", "seed", "run", *KEYS):
        with pytest.raises(ScenarioError, match=f"--metric {name}: is not a result of a run"):
            importance(whole, name)
    monkeypatch.setitem(sys.modules, "SALib.analyze.sobol", None)
    with pytest.raises(ScenarioError, match=r'importance needs SALib; pip install "agrobot-mj\[studies\]"'):
        importance(whole)


def test_importance_analysis_does_not_use_error_metrics_of_failed_runs(plan, tmp_path):
    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    folder = written(plan(64), tmp_path / "out")
    rows = pq.read_table(folder / "sweep.parquet").to_pylist()
    for row in rows:  # rolls over where the first number is large, with an error that is a number
        lost = row[KEYS[0]] > 2.0
        row |= {"outcome": "rolled_over" if lost else "completed", "expected": not lost, "error": None, "wall_s": 1.0}
    pq.write_table(pa.Table.from_pylist(rows), folder / "sweep.parquet")
    lost = sum(not row["expected"] for row in rows)
    with pytest.raises(
        ScenarioError, match=rf"{lost} of 640 runs have no value \({lost} rolled_over\).*--metric expected"
    ):
        importance(folder)
    assert not (folder / "importance.json").exists()
    with pytest.raises(ScenarioError, match="--metric wall_s: is not a result of a run"):
        importance(folder, "wall_s")
    found = importance(folder, "expected")[0]
    assert found.mean == pytest.approx(1 - lost / len(rows), abs=0.02)
    assert found.shares[0].key == KEYS[0]
    assert found.shares[0].effect > 0.8


def test_unsuitable_designs_and_odd_sample_numbers_are_rejected(plan, tmp_path):
    with pytest.raises(ScenarioError, match="samples: must be a power of two with saltelli, got 6"):
        plan(6)
    folder = written(plan(4), tmp_path / "out")
    text = (folder / "sweep.toml").read_text()
    (folder / "sweep.toml").write_text(text.replace('"saltelli"', '"sobol"'))
    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    with pytest.raises(ScenarioError, match="the design is 'sobol'"):
        importance(folder)
    assert not (folder / "importance.json").exists()
    assert json.loads(json.dumps(resolve_sweep(plan(4).sweep)))["samples"] == 4


# --- what the designs that ship tell of functions that are known --------------------------------------------------


def linear_total(d):
    """Return the total indices of `linear` and the weights of its terms."""
    weights = np.zeros(d)
    weights[:4] = (1.0, 0.7, 0.4, 0.1)
    parts = weights**2
    parts[[0, 2]] += 0.3**2
    return parts / (np.sum(weights**2) + 0.3**2), weights


def linear(x):
    """Return four linear terms and one product term of x on (0, 1), shape (n, d)."""
    u = np.sqrt(12.0) * (x - 0.5)
    return u @ linear_total(x.shape[1])[1] + 0.3 * u[:, 0] * u[:, 2]


def claims(found):
    """Yield pairs of keys in which the first key is ranked above the second."""
    return [(a.key, b.key) for a in found.shares for b in found.shares if a.worst < b.best]


@pytest.mark.parametrize("name", ["importance", "importance_sobol"])
@pytest.mark.parametrize("function", ["ishigami", "linear"])
def test_sampling_designs_rank_the_inputs_of_known_functions_correctly(name, function):
    """The plan defines points and seeds, for 20 seeds of the design. Noise has a fifth of the standard deviation."""
    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    sweep = read_sweep(name)
    keys, seeds = list(sweep.file.draws), len(sweep.seeds)
    d, wrong, told, flawed = len(keys), 0, 0, 0
    total = np.pad(ISHIGAMI_TOTAL, (0, d - 3)) if function == "ishigami" else linear_total(d)[0]
    truth = dict(zip(keys, total, strict=True))
    for draw_seed in range(20):
        file = sweep.file.model_copy(update={"draw_seed": draw_seed})
        plan = SweepPlan(sweep._replace(file=file))
        draws = np.array([[run.parameters[key] for key in keys] for run in plan.runs(step=seeds)])
        ranges = [draw.values(np.array([1e-12, 1 - 1e-12])) for draw in file.draws.values()]
        logs = [hasattr(draw, "log_uniform") for draw in file.draws.values()]
        u = np.column_stack([quantiles(*each) for each in zip(draws.T, ranges, logs, strict=True)])
        values = ishigami(*(2 * pi * (u[:, :3].T - 0.5))) if function == "ishigami" else linear(u)
        noise = np.random.default_rng(draw_seed).normal(0.0, 0.2 * values.std(), (len(values), seeds))
        resolved_file = {"method": file.method, "samples": file.samples, "draws": file.draws}
        found = influence("all", resolved_file, draws, values[:, None] + noise, "xte_rms")
        wrong += any(truth[a] <= truth[b] for a, b in claims(found))
        told += found.ordered_pairs
        flawed += bool(found.flaws)
    assert wrong <= 1
    assert flawed <= 2  # an index of 0 may be missed by chance; then nothing is claimed
    if (name, function) == ("importance", "ishigami"):  # no straight line shows it: nothing may be claimed
        assert told == 0
        assert (
            "too few to distinguish any two numbers, so there is no ranking" in importance_texts([found], "xte_rms")[0]
        )
    else:
        assert told > 20 * 2
        assert f" of {d * (d - 1) // 2} pairs differ significantly" in importance_texts([found], "xte_rms")[0]


def test_linear_effects_are_not_ranked_above_larger_nonlinear_effects():
    """Of the Ishigami function, x1 has a slope and x2 has none, but x2 causes two fifths of the variance
    nonlinearly."""
    for seed in range(20):
        x = np.random.default_rng(seed).uniform(-pi, pi, (200, 3))
        found = influence(
            "all", {"method": "screening", "draws": dict.fromkeys("abc")}, x, ishigami(*x.T)[:, None], "m"
        )
        assert found.ordered_pairs == 0
        assert next(share.low for share in found.shares if share.key == "a") > 0.0
        assert found.unexplained > 0.6


def test_variation_between_seeds_is_not_attributed_to_a_parameter():
    """The metric is a line plus noise with a quarter of the variance. A parameter without effect has a total index due
    to noise."""
    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    random = np.random.default_rng(1)
    a, b = random.random((2, 2048, 2))
    rows = [a, np.column_stack([b[:, 0], a[:, 1]]), np.column_stack([a[:, 0], b[:, 1]]), b]  # Saltelli's order
    line = np.sqrt(12 * 0.75) * np.stack(rows, axis=1)[..., 0].ravel()
    found = sobol_shares("ab", line + 0.5 * random.standard_normal(len(line)), 0.25)
    assert [share.share for share in found] == pytest.approx([1.0, 0.0], abs=0.05)
    assert [share.effect for share in found] == pytest.approx([1.0, 0.0], abs=0.1)


def test_regression_residual_is_below_its_bound_in_95_percent_of_cases():
    """There are five parameters with noise at 12 points; the bound is a fraction of the sample variance."""
    random, covered = np.random.default_rng(2), 0
    points = random.standard_normal((12, 5))
    x = sqrt(12) * np.linalg.qr(points - points.mean(axis=0))[0]
    for _ in range(1000):
        y = x.sum(axis=1) + 2.0 * random.standard_normal(12)
        covered += regression(x, (y - y.mean()) / y.std()).left * y.var(ddof=1) > 2.0**2
    assert covered / 1000 == pytest.approx(0.95, abs=0.02)


def quantiles(values, ends, logarithmic):
    """Return the positions of values between two ends, from 0 to 1."""
    values, (low, high) = (np.log(values), np.log(ends)) if logarithmic else (values, ends)
    return (values - low) / (high - low)


def test_indices_out_of_range_or_from_few_samples_are_not_ranked(plan, tmp_path):
    pytest.importorskip("SALib", reason="SALib is not installed: pip install 'agrobot-mj[studies]'")
    found = importance(written(plan(16), tmp_path / "out"))
    assert all(share.rank == "1-3" for each in found for share in each.shares)
    assert [share.key for share in found[0].shares] == list(KEYS)
    text = "\n".join(importance_texts(found, "xte_rms"))
    assert f"16 samples are too few for intervals; use at least {FEWEST}" in text
    assert "Therefore there is no ranking." in text
    assert {row[1] for row in importance_rows(found)[1]} >= {"?"}
    below = Share("mine.key", 0.5, 0.2, 0.9, effect=-0.46, half=0.41)
    text = "mine.key: the first-order index is from -0.87 to -0.05, outside the possible range"
    assert sobol_flaws([below], 256) == (text,)
    assert sobol_flaws([below._replace(effect=-0.3)], 256) == ()


def test_parameters_with_overlapping_intervals_share_a_rank_range():
    shares = [Share(key, (low + high) / 2, low, high, 0.0, 0.0) for key, low, high in INTERVALS]
    assert [(share.key, share.rank) for share in rank_shares(shares, True)] == [
        ("a", "1"), ("d", "2-3"), ("b", "2-4"), ("c", "3-4"),
    ]  # fmt: skip
    assert [(share.key, share.rank) for share in rank_shares(shares, False)] == [(key, "1-4") for key in "bcda"]


INTERVALS = [("b", 0.1, 0.3), ("c", 0.0, 0.15), ("d", 0.2, 0.4), ("a", 0.5, 0.9)]


def test_screening_uses_equal_points_for_every_seed_and_reports_noise(plan, tmp_path):
    made = plan(30, seeds=2, method="screening")
    table = np.array([[run.parameters[key] for key in KEYS] for run in made.runs()]).reshape(2, 30, 2, 3)
    assert np.all(table == table[:1, :, :1])
    cells = np.sort(np.floor((table[0, :, 0] + pi) / (2 * pi) * 30), axis=0)
    assert np.all(cells == np.arange(30)[:, None])  # a Latin hypercube: one point in each of 30 slices of each range
    found = importance(written(made, tmp_path / "out"))
    assert in_file(tmp_path / "out") == plain(found)
    assert found[0].unexplained > 0.5
    head, _ = importance_rows(found)
    assert head[:5] == ["number", "1: rank", "1: fraction of the variance", "1: slope", "1: Spearman"]
    axes = importance_figure(found, "xte_rms").axes[0]
    assert sorted(bar.get_y() + bar.get_height() / 2 for bar in axes.patches) == pytest.approx(axes.get_yticks())


def test_reported_noise_is_the_variance_between_seeds():
    generator = np.random.default_rng(5)
    points, offsets = generator.normal(0.0, 1.0, (4000, 1)), np.array([0.0, 3.0, -1.0])
    values = points + offsets + generator.normal(0.0, 0.5, (4000, 3))
    noise = 0.25 / 3
    assert noise_share(values) == pytest.approx(noise / (1 + noise), rel=0.1)
    assert noise_share(points + offsets) == pytest.approx(0.0, abs=1e-12)
    assert noise_share(points) is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("samples = 9", "samples = 8", "samples: must be at least 9 with screening, 3 per draw, got 8"),
        ("[draws]", '[draws]\n"path.kind" = { choice = ["line", "circle"] }', "path.kind: screening needs numbers"),
    ],
)
def test_screening_that_cannot_be_analysed_is_rejected(plan, tmp_path, old, new, message):
    plan(9, method="screening")
    (tmp_path / "mine.toml").write_text((tmp_path / "mine.toml").read_text().replace(old, new))
    with pytest.raises(ScenarioError, match=message):
        read_sweep(tmp_path / "mine.toml")
