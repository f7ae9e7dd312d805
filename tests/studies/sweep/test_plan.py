"""Sweep plan: every combination occurs once, and all combinations are checked before any run."""

import numpy as np
import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import sweep_files
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.studies.sweep.plan import SweepPlan
from agrobot_mj.studies.sweep.schema import read_sweep


@pytest.fixture
def plan(tmp_path):
    """Return a function that reads the plan from the text of a sweep file."""

    def read(text):
        file = tmp_path / "mine.toml"
        file.write_text(text, encoding="utf-8")
        return SweepPlan(read_sweep(file))

    return read


def faults(plan, text):
    """Return the errors of a sweep, one per line, without the file name."""

    def check():
        found = plan(text)
        found.check_size()
        found.check()

    with pytest.raises(ScenarioError) as caught:
        check()
    lines = str(caught.value).splitlines()
    assert all(line.startswith(("mine.toml: ", "  ")) for line in lines)
    return [line.removeprefix("mine.toml: ") for line in lines]


PLANTS = ("bicycle", "mujoco")
EXAMPLE = """
base = "side_slope"
seeds = 10
[set]
duration_s = 60
[axes]
"terrain.grade_deg" = { from = 0, to = 15, count = 4 }
"controller.kind" = ["pd", "pd_t2fnn"]
[draws]
"tractor.mass_kg" = { uniform = [650, 850] }
[[variant]]
name = "as it is"
[[variant]]
name = "lqr, worn valve"
set = { "guidance.kind" = "lqr", "steering.valve.dead_band_v" = 0.8 }
"""


def test_sweep_has_one_run_per_combination_of_axis_values(plan):
    found = plan(EXAMPLE)
    found.check()
    runs = list(found.runs())
    assert len(runs) == found.total == 2 * 4 * 2 * 10
    places = {(r.variant, r.parameters["terrain.grade_deg"], r.parameters["controller.kind"], r.seed) for r in runs}
    assert len(places) == found.total
    assert [run.seed for run in runs[:10]] == list(range(1, 11))
    assert {run.parameters["terrain.grade_deg"] for run in runs} == {0, 5, 10, 15}
    last = found.sweep.base.changed(runs[-1].overrides)
    assert (last.duration_s, last.guidance.kind, last.controller.kind) == (60, "lqr", "pd_t2fnn")
    assert (last.terrain.grade_deg, last.steering.valve.dead_band_v, last.seed) == (15, 0.8, 10)
    assert last == load_scenario("side_slope", {"duration_s": 60, **runs[-1].overrides})


def test_sampled_values_differ_between_runs_unless_they_are_paired(plan):
    masses = [run.parameters["tractor.mass_kg"] for run in plan(EXAMPLE).runs()]
    assert len(set(masses)) == 160
    assert 650 <= min(masses) < 670 < 830 < max(masses) <= 850
    paired = plan("paired = true\n" + EXAMPLE)
    by_seed = {}
    for run in paired.runs():
        by_seed.setdefault(run.seed, set()).add(run.parameters["tractor.mass_kg"])
    assert all(len(values) == 1 for values in by_seed.values())
    assert len(set.union(*by_seed.values())) == 10


def test_sampled_values_depend_only_on_the_file_and_its_draw_seed(plan):
    first, again = (list(plan(EXAMPLE).runs()) for _ in range(2))
    assert first == again
    assert first != list(plan("draw_seed = 2\n" + EXAMPLE).runs())


@pytest.mark.parametrize("method", ["latin_hypercube", "sobol"])
def test_space_filling_samples_have_one_value_per_equal_interval(plan, method):
    found = plan(f"""
base = "side_slope"
samples = 16
method = "{method}"
[draws]
"tractor.mass_kg" = {{ uniform = [0, 16] }}
"terrain.grade_deg" = {{ uniform = [0, 16] }}
""")
    for key in ("tractor.mass_kg", "terrain.grade_deg"):
        assert sorted(np.floor([run.parameters[key] for run in found.runs()])) == list(range(16))


def test_override_of_a_kind_is_applied_before_overrides_of_its_keys(plan):
    found = plan("""
base = "figure_eight"
[axes]
"guidance.gain_per_s" = [0.7]
"guidance.kind" = ["stanley"]
""")
    found.check()
    assert found.sweep.base.changed(found.run(0).overrides).guidance.gain_per_s == 0.7


@pytest.mark.parametrize("seeds", ["0", "true", "100000000000000000000"])
def test_invalid_or_excessive_number_of_seeds_is_rejected(plan, seeds):
    assert "seeds: must be a number of runs from 1" in faults(plan, f'base = "circle"\nseeds = {seeds}\n')[0]


def test_number_too_large_for_a_float_is_rejected(plan):
    text = f'base = "circle"\n[axes]\n"path.radius_m" = {{ from = 5, to = 1{"0" * 400}, count = 3 }}\n'
    assert "must be a number, got 1000" in faults(plan, text)[0]


def test_all_errors_of_a_sweep_file_are_reported_at_once(plan):
    text = """
base = "side_slope"
seeds = 0
keeep = "signals"
[axes]
"terrain.grade_deg" = []
"path.speed_m_s" = { from = 0, to = 1, count = 0 }
"tractor.mass_kg" = { from = 0, to = 1, step = -1 }
[draws]
x = { unifrom = [1, 2] }
y = { uniform = [2, 1] }
z = { log_uniform = [0, 1] }
"""
    found = faults(plan, text)
    keys = [line.partition(": ")[0] for line in found]
    named = {"axes.terrain.grade_deg", "axes.path.speed_m_s.count", "draws.x", "draws.y.uniform"}
    assert set(keys) >= {"seeds", "keeep", *named}
    assert "axes.terrain.grade_deg: has no values; list at least one, or omit the axis" in found
    assert any(line.startswith("keeep: unknown key; did you mean 'keep'?") for line in found)
    assert any(line.startswith("axes.tractor.mass_kg: step: -1 never leads from 0 to 1") for line in found)
    assert any(line.startswith("draws.z.log_uniform: must be above 0") for line in found)


def test_unknown_sweep_key_is_reported_once_with_the_valid_keys(plan):
    (line,) = faults(plan, 'base = "side_slope"\nseeds = 3\n[axes]\n"terrain.grade" = [1, 2, 3]\n')
    assert line.startswith("terrain.grade: unknown key; did you mean 'grade_deg'?")


def test_error_lists_exactly_the_combinations_that_cannot_run(plan):
    text = """
base = "side_slope"
seeds = 5
[axes]
"plant.kind" = ["bicycle", "mujoco"]
"terrain.kind" = ["flat", "slope"]
"path.speed_m_s" = [1.0, -1.0]
"""
    found = faults(plan, text)
    backwards = [f"  plant.kind={p}, terrain.kind={t}, path.speed_m_s=-1.0" for p in PLANTS for t in ("flat", "slope")]
    assert found[0].startswith("path.speed_m_s: must be at least 0.001, got -1.0, in 4 combinations:")
    assert found[1:5] == backwards
    assert found[5].startswith("terrain.kind: the bicycle plant supports only flat ground, got 'slope'")
    assert found[6:] == ["  plant.kind=bicycle, terrain.kind=slope, path.speed_m_s=1.0"]


def test_key_specified_in_two_parts_of_a_sweep_is_rejected(plan):
    text = EXAMPLE.replace('"steering.valve.dead_band_v" = 0.8', '"tractor.mass_kg" = 700.0, "terrain.grade_deg" = 3')
    found = faults(plan, text)
    assert found == [
        "axes.terrain.grade_deg: the key is also in variant 'lqr, worn valve'; specify it once",
        "draws.tractor.mass_kg: the key is also in variant 'lqr, worn valve'; specify it once",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seeds = [1, 7, 1, 1]\n", "seeds: 1 is listed more than once; list each value once"),
        ('[axes]\n"guidance.kind" = ["lqr", "stanley", "lqr"]\n', 'axes.guidance.kind: "lqr" is listed more than once'),
        ('[axes]\n"path.speed_m_s" = [1, 1.0]\n', "axes.path.speed_m_s: 1 is listed more than once"),
        ('[[variant]]\nname = "a"\nset = { seed = 4 }\n', "variant 'a': seed: has no effect; set seeds"),
    ],
)
def test_sweep_with_duplicate_runs_is_rejected(plan, text, message):
    with pytest.raises(ScenarioError) as caught:
        plan(f'base = "circle"\n{text}')
    assert message in str(caught.value)


def test_rejection_of_a_sweep_of_a_billion_runs_states_their_number(plan):
    axis = "{ from = 1.0, to = 2.0, count = 1000 }"
    keys = ("path.speed_m_s", "tractor.mass_kg", "terrain.grade_deg")
    text = 'base = "side_slope"\n[axes]\n' + "\n".join(f'"{key}" = {axis}' for key in keys)
    (line,) = faults(plan, text)
    assert line.startswith(
        "the sweep has 1,000,000,000 runs (1,000 path.speed_m_s x 1,000 tractor.mass_kg x 1,000 terrain.grade_deg"
    )
    assert line.endswith("--max-runs 1000000000")
    plan(text).check_size(10**9)


def test_axis_of_a_billion_values_is_not_stored_in_memory(plan):
    found = plan('base = "side_slope"\n[axes]\n"path.speed_m_s" = { from = 1.0, to = 2.0, count = 1000000001 }')
    assert found.run(500_000_000).parameters == {"path.speed_m_s": 1.5}


@pytest.mark.parametrize("count", [30, pytest.param(100, marks=pytest.mark.slow)])
def test_sweep_of_thousands_of_combinations_can_be_checked(plan, count):
    grades, speeds = f"{{ from = 0, to = 15, count = {count} }}", f"{{ from = 0.5, to = 1.5, count = {count} }}"
    found = plan(f'base = "side_slope"\n[axes]\n"terrain.grade_deg" = {grades}\n"path.speed_m_s" = {speeds}')
    found.check()
    assert found.total == count**2


def test_error_names_an_invalid_or_unknown_base_scenario(plan):
    assert faults(plan, "[axes]\nseed = [1]")[0].startswith("base: the key is missing; specify a scenario")
    (line,) = faults(plan, 'base = "side_slop"')
    assert line.startswith("base: unknown scenario 'side_slop'; did you mean 'side_slope")
    (line,) = faults(plan, 'base = "side_slope"\n[set]\n"terrain.grade_deg" = 80')
    assert "terrain.grade_deg: must be below 45, got 80" in line


def test_data_file_paths_are_relative_to_the_sweep_file(plan, tmp_path):
    np.save(tmp_path / "field.npy", np.zeros((50, 50)))
    found = plan('base = "hills"\n[axes]\n"terrain.file" = ["field.npy", "hills.asc"]')
    assert [run.parameters["terrain.file"] for run in found.runs()] == [str(tmp_path / "field.npy"), "hills.asc"]


@pytest.mark.parametrize("name", sweep_files())
def test_every_shipped_sweep_is_valid(name):
    found = SweepPlan(read_sweep(name))
    found.check_size()
    found.check()
    assert found.file.title


def test_impossible_tractors_are_reported_before_any_run(plan):
    """A chassis without inertia, an unstable tyre or an extreme payload follows from the complete tractor, not from
    single keys of the plan."""
    inertia = faults(
        plan, 'base = "figure_eight"\n[axes]\n"tractor.yaw_inertia_kg_m2" = { from = 100, to = 900, count = 9 }'
    )
    assert "give an impossible inertia of the chassis" in inertia[0]
    places = [line.strip() for line in inertia if line.startswith("  ")]
    assert "tractor.yaw_inertia_kg_m2=100" in places
    assert "tractor.yaw_inertia_kg_m2=400" not in places
    drawn = faults(plan, 'base = "circle"\nset = { "plant.kind" = "bicycle" }\naxes = { "tractor.track_m" = [1, 3] }')
    assert "give an impossible inertia of the chassis" in drawn[0]
    (stiff, *where) = faults(
        plan, 'base = "figure_eight"\n[axes]\n"tractor.rear_tyre_damping_n_s_m" = [2e3, 1e6]\n"path.radius_m" = [9, 10]'
    )
    assert "otherwise this tractor and tyre would be unstable at physics_dt_s" in stiff
    assert len(where) == 2
    (light,) = faults(
        plan, 'base = "figure_eight"\nseeds = 3\n[set]\nfault = [{ kind = "payload", mass_kg = -690, start_s = 1.0 }]'
    )
    assert light.startswith("fault[0].mass_kg: only ")


@pytest.mark.parametrize("number", ["9" * 5000, "0x" + "f" * 5000], ids=["decimal", "hexadecimal"])
def test_number_with_thousands_of_digits_in_a_sweep_is_reported(plan, number):
    with pytest.raises(ScenarioError) as told:
        plan(f'base = "circle"\n[axes]\n"path.radius_m" = [{number}]')
    assert str(told.value).startswith("mine.toml: ")
    assert len(str(told.value)) < 300


DRAW = '[draws]\n"path.radius_m" = { uniform = [14, 16] }\n'
VARIANT = '[[variant]]\nname = "a"\nset = { "path.radius_m" = 15 }\n'


@pytest.mark.parametrize("changes", [DRAW, VARIANT], ids=["draw", "variant"])
def test_override_of_a_table_is_applied_before_overrides_of_its_keys(plan, changes):
    axis = '[axes]\npath = [{ kind = "circle", radius_m = 11 }, { kind = "figure_eight", radius_m = 12 }]\n'
    found = plan(f'base = "circle"\n{axis}{changes}')
    for run in found.runs():
        assert run.parameters["path"]["radius_m"] < 14 <= found.sweep.base.changed(run.overrides).path.radius_m <= 16
