"""Comparisons: effect of options, rejection of unsupported runs, and results of every law."""

import json

import pytest
from typer.main import get_command

from agrobot_mj import load_scenario
from agrobot_mj.cli import app
from agrobot_mj.cli.runs import variants
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.labels import safe_names
from agrobot_mj.studies import compare_plan
from agrobot_mj.studies.compare import compare
from agrobot_mj.studies.compare_plan import MOST_RUNS, plan
from agrobot_mj.studies.sweep.schema import SweepVariant

SHORT = {"duration_s": 1.0, "plant.kind": "bicycle"}


@pytest.fixture(scope="module")
def circle():
    return load_scenario("circle", SHORT)


def laws(found):
    return list(dict.fromkeys(case.law for case in found.cases))


def planned(scenario, *texts, **options):
    return plan(scenario, variants=variants(list(texts)), **{"plants": ["bicycle"], **options})


# --- texts --------------------------------------------------------------------------------------------------------


def test_variant_option_is_parsed_into_a_name_and_toml_values():
    (found,) = variants(['far, wide: path.points=[[0, 0], [9, 1]], title="a, b: c", seed_x=1, tyre=soil, t={a=[1,2]}'])
    assert found.name == "far, wide"
    expected = {"path.points": [[0, 0], [9, 1]], "title": "a, b: c", "seed_x": 1, "tyre": "soil", "t": {"a": [1, 2]}}
    assert found.set == expected
    assert variants(["as it is:"]) == [SweepVariant(name="as it is")]
    assert variants([r'quoted: title="a \", b", x=' + "'c:\\'"])[0].set == {"title": 'a ", b', "x": "c:\\"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("worn", "must have the form"),
        ("worn.valve=1", "must have the form"),
        ("a=1: b=2", "must have the form"),
        (": a=1", "must have the form"),
        ("worn: a", "must have the form key=value"),
        ("worn: a=", "must have the form key=value"),
        ("worn: a=[1, 2", "not valid TOML"),
        ("worn: a=1], b=2", "not valid TOML"),
        ("worn: a={b=1]", "not valid TOML"),
        ('worn: a="b, c=1', "not valid TOML"),
        ("worn: a=[1 2]", "not valid TOML"),
        ("worn: a=1, a=2", "a is given twice"),
        ("two\nlines: a=1", "printable"),
        (f"{'x' * 61}: a=1", "at most 60"),
    ],
)
def test_invalid_variant_option_is_reported(text, message):
    with pytest.raises(ScenarioError, match="--variant") as caught:
        variants([text])
    assert message in str(caught.value)


def test_file_in_a_variant_is_relative_to_the_working_directory(tmp_path, monkeypatch):
    (tmp_path / "hills.npy").write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    (found,) = variants(["hilly: terrain.kind=heightmap, terrain.file=hills.npy"])
    assert found.set["terrain.file"] == str(tmp_path / "hills.npy")


# --- plan ---------------------------------------------------------------------------------------------------------


def test_default_comparison_uses_the_controllers_of_the_paper(circle):
    found = planned(circle, seeds=2)
    assert [(c.law, c.seed, c.folder) for c in found.cases] == [
        ("pd", 1, "bicycle-pd-s1"),
        ("pd", 2, "bicycle-pd-s2"),
        ("pd_t2fnn", 1, "bicycle-pd_t2fnn-s1"),
        ("pd_t2fnn", 2, "bicycle-pd_t2fnn-s2"),
    ]
    assert [case.scenario.seed for case in found.cases] == [1, 2, 1, 2]


def test_guidance_laws_and_yaw_rate_controllers_can_be_compared_together(circle):
    assert laws(planned(circle, guidance=["lqr", "stanley"])) == ["lqr", "stanley"]
    found = planned(circle, controllers=["pd", "pi"], guidance=["lqr"])
    assert [(c.law, c.controller, c.scenario.guidance.kind) for c in found.cases] == [
        ("pd", "pd", "kinematic"),
        ("pi", "pi", "kinematic"),
        ("lqr", None, "lqr"),
    ]


def test_controllers_are_combined_only_with_laws_that_use_a_controller(circle):
    found = planned(circle, controllers=["pd", "pi"], guidance=["feedforward", "lqr"])
    assert laws(found) == ["feedforward-pd", "feedforward-pi", "lqr"]
    assert [case.scenario.controller.kind for case in found.cases][:2] == ["pd", "pi"]
    assert laws(planned(circle, guidance=["feedforward"])) == ["feedforward"]


def test_law_without_a_controller_is_compared_in_one_run(circle):
    stanley = circle.changed({"guidance.kind": "stanley"})
    (case,) = planned(stanley, controllers=["pd", "pi"]).cases
    assert (case.law, case.controller, case.folder) == ("stanley", None, "bicycle-stanley-s1")


def test_each_law_is_simulated_with_each_machine_variant(circle):
    found = planned(circle, "worn: steering.valve.dead_band_v=0.8", "new:", controllers=["pd"], guidance=["lqr"])
    assert laws(found) == ["worn, pd", "worn, lqr", "new, pd", "new, lqr"]
    assert [case.scenario.steering.valve.dead_band_v for case in found.cases][:2] == [0.8, 0.8]
    assert [case.variant for case in found.cases] == ["worn", "worn", "new", "new"]
    assert laws(planned(circle, "worn: steering.valve.dead_band_v=0.8")) == ["worn"]


def test_variant_of_a_law_is_compared_with_the_other_laws(circle):
    found = planned(circle, "calm: guidance.kind=stanley, guidance.gain_per_s=0.2", controllers=["pd"])
    assert laws(found) == ["pd", "calm"]
    assert found.cases[1].scenario.guidance.gain_per_s == 0.2
    assert found.cases[1].scenario.seed == circle.seed


def test_folder_names_of_runs_with_special_characters_are_safe_and_unique(circle):
    found = planned(circle, "a/b:", "A b:", "../..:", "Höhe 5 %:", "坡:")
    folders = [case.folder for case in found.cases]
    expected = ["bicycle-a_b-s1", "bicycle-A_b-2-s1", "bicycle-unnamed-s1", "bicycle-Hohe_5-s1", "bicycle-unnamed-2-s1"]
    assert folders == expected
    assert safe_names(["pd_t2fnn", "mujoco-pd", "x" * 99]) == ["pd_t2fnn", "mujoco-pd", "x" * 60]


@pytest.mark.parametrize(
    ("texts", "options", "message"),
    [
        (["a: plant.kind=mujoco"], {}, "plant.kind: set this key with --plants"),
        (["a: seed=3"], {}, "seed: set this key with --seeds"),
        (["a:", "a:"], {}, "'a': the name is given twice"),
        (["pd: guidance.kind=lqr"], {"controllers": ["pd"]}, "is also the name of a compared law"),
        (["a: steering.valve.dead_band=1"], {}, "did you mean 'dead_band_v'"),
        (["a: guidance.kind=lqg"], {}, "unknown kind 'lqg'"),
        (["a: terrain.kind=slope"], {}, "supports only flat ground"),
        ([], {"guidance": ["lqr", "stanly"]}, "did you mean 'stanley'"),
        ([], {"seeds": 300_000}, "600000 runs are planned (2 laws, 1 plants, 300000 seeds), but the limit is 2000"),
        ([], {"seeds": 3, "most": 5}, "add --max-runs 6"),
    ],
)
def test_invalid_runs_of_a_comparison_are_reported_before_any_run(circle, texts, options, message):
    with pytest.raises(ScenarioError) as caught:
        planned(circle, *texts, **options)
    assert message in str(caught.value)
    assert not texts or "--variant" in str(caught.value)


def test_maximum_number_of_compared_runs_can_be_increased(circle):
    (option,) = (each for each in get_command(app).commands["compare"].params if each.name == "max_runs")
    assert option.default == MOST_RUNS
    assert len(planned(circle, seeds=3, most=6).cases) == 6


def test_seeds_outside_the_valid_range_are_rejected(circle):
    with pytest.raises(ScenarioError, match="set a smaller seed"):
        planned(circle.changed({"seed": 2**63 - 2}), seeds=3)


def test_law_is_skipped_on_a_plant_without_support_for_the_law():
    found = planned(load_scenario("circle"), "tilted: terrain.kind=slope", "level:", plants=None)
    assert [case.folder for case in found.cases] == ["bicycle-level-s1", "mujoco-tilted-s1", "mujoco-level-s1"]
    (line,) = found.left_out
    assert line.startswith("tilted on bicycle is omitted: --variant 'tilted': circle: terrain.kind")


# --- runs ---------------------------------------------------------------------------------------------------------


def test_laws_without_a_yaw_rate_controller_have_table_rows_and_figures(circle, tmp_path):
    found = planned(circle, r"_$a$ | \é: guidance.kind=lqr", controllers=["pd"], guidance=["stanley"], seeds=2)
    rows = compare(found, tmp_path, jobs=1)
    assert rows == json.loads((tmp_path / "comparison.json").read_text())
    named = [(row["controller"], row["guidance"], row["variant"], row["seed"], row["outcome"]) for row in rows[::2]]
    assert named == [
        ("pd", "kinematic", None, 1, "completed"),
        (None, "stanley", None, 1, "completed"),
        (None, "lqr", r"_$a$ | \é", 1, "completed"),
    ]
    assert all((tmp_path / row["folder"] / "signals.parquet").is_file() for row in rows)
    figures = {path.stem for path in tmp_path.glob("*.png")}
    assert figures == {"trajectory", "longitudinal_error", "lateral_error", "control_signals", "yaw_rate_error"}
    assert (tmp_path / "comparison.rrd").stat().st_size > 1000


def test_yaw_rate_figure_is_omitted_without_a_yaw_rate_controller(circle, tmp_path):
    found = planned(circle, guidance=["stanley", "pure_pursuit"])
    found.recorded = False
    compare(found, tmp_path, jobs=1)
    assert {path.stem for path in tmp_path.glob("*.png")} == {
        "trajectory",
        "longitudinal_error",
        "lateral_error",
        "control_signals",
    }


def test_number_of_laws_in_a_figure_is_limited(circle, monkeypatch):
    monkeypatch.setattr(compare_plan, "MOST_DRAWN", 3)
    found = planned(circle, *(f"v{k}:" for k in range(5)), seeds=2)
    assert [found.folder(number) for number in found.drawn] == [f"bicycle-v{k}-s1" for k in range(3)]
