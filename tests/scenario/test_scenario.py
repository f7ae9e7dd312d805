"""Scenario schema: names, overrides, kinds, faults, and the round trip through TOML."""

import re
import tomllib
from pathlib import Path

import pytest

from agrobot_mj import __version__, load_scenario
from agrobot_mj.control import Controller
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import TICK_S
from agrobot_mj.core.spec import every, members
from agrobot_mj.paths import Path as PathUnion
from agrobot_mj.plants import Plant
from agrobot_mj.scenario.loading import scenario_files
from agrobot_mj.scenario.overrides import absolute_paths
from agrobot_mj.scenario.schema import Scenario, resolve
from agrobot_mj.terrain import Terrain
from agrobot_mj.tyres import Tyre

SHIPPED = ("circle", "figure_eight", "step_steer", "straight_line")


def write(folder, text):
    file = folder / "mine.toml"
    file.write_text(text)
    return file


def leaves(data, prefix=""):
    """Yield dotted key and value of all entries in nested tables."""
    for key, value in data.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def refused(source, overrides=None):
    """Return the error message for an invalid scenario."""
    with pytest.raises(ScenarioError) as error:
        load_scenario(source, overrides)
    return str(error.value)


def all_models(model=Scenario, seen=None):
    """Return all Spec classes in the schema."""
    seen = {} if seen is None else seen
    if model not in seen:
        seen[model] = None
        for field in model.model_fields.values():
            for inner in members(field.annotation).values():
                all_models(inner, seen)
    return list(seen)


# --- what ships ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenarios_load_and_describe_their_purpose(name):
    file = scenario_files()[name]
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.title
    assert file.read_text().startswith("# ")
    assert "Look at:" in file.read_text()


def test_figure_eight_scenario_has_two_laps_of_120_s_on_mujoco():
    scenario = load_scenario("figure_eight")
    assert (scenario.plant.kind, scenario.controller.kind, scenario.path.turns) == ("mujoco", "pd_t2fnn", 2)
    first = scenario.path.turns_s[0]
    assert first[1] - first[0] == pytest.approx(120, abs=2)
    assert scenario.ticks == pytest.approx((240 + 13.7) / TICK_S, abs=20), "two turns and the run-in"


def test_empty_file_is_a_valid_scenario_with_default_values():
    assert resolve({}, "empty") == Scenario()


def test_every_key_has_a_description():
    for model in all_models():
        for name, field in model.model_fields.items():
            if name != "kind" and not members(field.annotation):
                assert model.describe(name), f"{model.__name__}.{name} lacks a docstring"


@pytest.mark.parametrize("suffix", ["_m", "_s", "_deg", "_kg", "_v", "_hz"])
def test_description_of_a_key_with_a_unit_suffix_has_the_unit_in_brackets(suffix):
    for model in all_models():
        for name in model.model_fields:
            if name.endswith(suffix):
                assert "[" in model.describe(name), f"{model.__name__}.{name}"


# --- files and names ----------------------------------------------------------------------------------------------


def test_scenario_file_is_loaded_by_path_and_named_after_the_file(tmp_path):
    scenario = load_scenario(write(tmp_path, 'seed = 7\n[path]\nkind = "circle"\nradius_m = 12\n'))
    assert (scenario.name, scenario.seed, scenario.path.radius_m) == ("mine", 7, 12.0)
    assert load_scenario(str(tmp_path / "mine.toml")) == scenario


def test_error_for_an_unknown_scenario_suggests_the_closest_name():
    message = refused("figure_eigth")
    assert "figure_eigth" in message
    assert "did you mean 'figure_eight'?" in message


@pytest.mark.parametrize("source", ["no/such/file", "nothing.toml"])
def test_missing_scenario_file_is_reported_as_missing(source):
    assert refused(source) == f"{source}: no such file; specify an existing file"


def test_folder_as_scenario_is_rejected(tmp_path):
    assert "folder" in refused(tmp_path)


@pytest.mark.parametrize("content", [b"a = = 3", b"[path\nkind = 1", b"\xff\xfe\x00", b"seed = 1\nseed = 2"])
def test_error_for_invalid_toml_names_the_file(tmp_path, content):
    file = tmp_path / "broken.toml"
    file.write_bytes(content)
    assert refused(file).startswith("broken.toml: not valid TOML: ")


# --- overrides ----------------------------------------------------------------------------------------------------


def test_overrides_use_dotted_keys():
    scenario = load_scenario(
        "straight_line", {"seed": 9, "plant.tyre.relaxation_radii": 0.3, "plant.tyre.kind": "linear"}
    )
    assert scenario.seed == 9
    assert scenario.plant.tyre.relaxation_radii == 0.3


def test_override_may_replace_a_whole_table():
    scenario = load_scenario("straight_line", {"path": {"kind": "circle", "radius_m": 7.0}})
    assert (scenario.path.kind, scenario.path.radius_m) == ("circle", 7.0)


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("step_steer", {"plant.kind": "bicycle"}),
        ("step_steer", {"controller.kind": "pd"}),
        ("figure_eight", {"path.kind": "line"}),
        ("circle", {"path.kind": "figure_eight"}),
        ("step_steer", {"plant.tyre.kind": "contact"}),
    ],
)
def test_changing_the_kind_removes_keys_of_the_old_kind(name, overrides):
    """This includes files without a kind, which use the default kind."""
    (key, kind), *_ = overrides.items()
    part = load_scenario(name, overrides)
    for step in key.split("."):
        part = getattr(part, step)
    assert part == kind


def test_changing_the_kind_keeps_keys_common_to_both_kinds():
    scenario = load_scenario("straight_line", {"path.speed_m_s": 0.7}).changed({"path.kind": "circle"})
    assert scenario.path.speed_m_s == 0.7


@pytest.mark.parametrize("plant", every(Plant))
@pytest.mark.parametrize("controller", every(Controller))
def test_every_plant_and_controller_can_be_selected_by_name(plant, controller):
    kinds = {
        "plant.kind": plant.model_fields["kind"].default,
        "controller.kind": controller.model_fields["kind"].default,
    }
    scenario = load_scenario("figure_eight").changed(kinds)
    assert isinstance(scenario.plant, plant)
    assert isinstance(scenario.controller, controller)


@pytest.mark.parametrize(
    ("table", "union"), [("terrain", Terrain), ("plant.tyre", Tyre), ("path", PathUnion), ("controller", Controller)]
)
def test_every_kind_of_a_family_can_be_selected_by_name(table, union):
    for member in every(union):
        part = load_scenario("straight_line", {f"{table}.kind": member.model_fields["kind"].default})
        for step in table.split("."):
            part = getattr(part, step)
        assert type(part) is member


def test_table_without_a_kind_key_has_the_default_kind():
    assert load_scenario("straight_line", {"terrain.half_size_m": 77.0}).terrain.half_size_m == 77.0


@pytest.mark.parametrize("tyre", [member.model_fields["kind"].default for member in every(Tyre)])
def test_overriding_one_key_leaves_all_other_keys_at_their_defaults(tyre):
    """This includes tables whose default differs from the default of their class, such as the gains of one loop."""
    default = load_scenario("straight_line", {"plant.tyre.kind": tyre})
    for key, value in leaves(default.model_dump(mode="json", exclude_none=True)):
        if not key.endswith("kind"):
            assert load_scenario("straight_line", {"plant.tyre.kind": tyre, key: value}) == default, key


def test_changed_copy_of_a_scenario_does_not_modify_the_original():
    scenario = load_scenario("straight_line")
    assert scenario.changed({"seed": 5}).seed == 5
    assert scenario.seed == 1
    assert scenario.changed({}) == scenario


# --- faults -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "key", "fix"),
    [
        ({"sead": 1}, "sead", "seed"),
        (
            {"plant.tyre.kind": "linear", "plant.tyre.relaxation_radi": 1.0},
            "plant.tyre.relaxation_radi",
            "relaxation_radii",
        ),
        ({"seed": "one"}, "seed", "whole number"),
        ({"seed": -1}, "seed", "at least 0"),
        ({"seed": 10**30}, "seed", "at most 9.22337e+18"),
        ({"seed": True}, "seed", "whole number"),
        ({"path.speed_m_s": "fast"}, "path.speed_m_s", "number"),
        ({"path.speed_m_s": True}, "path.speed_m_s", "number"),
        ({"path.speed_m_s": float("nan")}, "path.speed_m_s", "finite"),
        ({"duration_s": float("inf")}, "duration_s", "finite"),
        ({"duration_s": 0}, "duration_s", "above 0"),
        ({"duration_s": 1e9}, "duration_s", "at most 86400"),
        ({"terrain": {"kind": "slope", "grade_deg": 80}}, "terrain.grade_deg", "below 45"),
        ({"terrain.kind": "hill"}, "terrain.kind", "flat"),
        ({"plant.kind": "bicicle"}, "plant.kind", "bicycle"),
        ({"plant.kind": 3}, "plant.kind", "bicycle"),
        ({"plant": "bicycle"}, "plant", "table"),
        ({"plant.tyre": "linear"}, "plant.tyre", "table"),
        ({"sensors": 3}, "sensors", "table"),
        ({"controller.kind": "pd_t2fn"}, "controller.kind", "pd_t2fnn"),
        ({"path.kind": "circle", "path.radius_m": 1.0}, "path", "larger radius"),
        ({"path.start_x_m": 700.0}, "path", "terrain larger"),
        ({"path.start_x_m": 1e4}, "path", "shift the path"),
        ({"estimator.yaw_rate_source": "gyro"}, "estimator.yaw_rate_source", "sensors.gyro.enabled"),
        ({"tractor.front_load_fraction": 0.99}, "tractor.front_load_fraction", "0.95"),
        ({"plant.kind": "bicycle", "terrain.kind": "slope"}, "terrain.kind", "flat"),
    ],
)
def test_error_message_names_the_file_the_key_and_a_remedy(overrides, key, fix):
    message = refused("straight_line", overrides)
    assert message.startswith(f"straight_line.toml: {key}: ")
    assert fix in message
    assert "\n" not in message


def test_bicycle_plant_rejects_sloped_terrain_in_any_order_of_keys():
    slope = load_scenario("straight_line", {"terrain.kind": "slope"})
    with pytest.raises(ScenarioError, match=r"terrain\.kind: the bicycle plant supports only flat ground, got 'slope'"):
        slope.changed({"plant.kind": "bicycle"})


@pytest.mark.parametrize("step", [0.003, 0.0035, 0.0049, 0.0011, 0.000123])
def test_error_for_a_time_step_not_dividing_the_tick_suggests_a_step(step):
    message = refused("straight_line", {"physics_dt_s": step})
    assert message.startswith(f"straight_line.toml: physics_dt_s: {step:g} does not divide the 0.05 s tick; try ")
    better = float(re.search(r"try ([0-9.e-]+)$", message).group(1))
    assert better <= step
    assert load_scenario("straight_line", {"physics_dt_s": better}).physics_dt_s == better


@pytest.mark.parametrize("step", [0.005, 0.0025, 0.002, 0.001, 0.05 / 3 / 4])
def test_physics_time_step_that_divides_the_tick_is_accepted(step):
    scenario = load_scenario("straight_line", {"physics_dt_s": step})
    assert scenario.steps_per_tick * step == pytest.approx(TICK_S)


@pytest.mark.parametrize(
    ("changes", "step"),
    [
        ({}, 0.002),
        ({"physics": "fast"}, 0.005),
        ({"physics": "fast", "plant.kind": "bicycle"}, 0.005),
        ({"physics": "fast", "implement.kind": "drawn"}, 0.0025),
        ({"physics": "fast", "plant.tyre.kind": "ruts"}, 0.002),
        ({"physics": "fast", "plant.tyre.kind": "ruts", "implement.kind": "drawn"}, 0.002),
        ({"physics_dt_s": 0.001}, 0.001),
    ],
)
def test_physics_time_step_follows_from_the_physics_setting(changes, step):
    scenario = load_scenario("straight_line", changes)
    assert scenario.step_s == step
    assert scenario.steps_per_tick == round(TICK_S / step)


def test_physics_key_together_with_a_physics_time_step_is_rejected():
    message = refused("straight_line", {"physics": "fast", "physics_dt_s": 0.002})
    assert message.endswith("physics: 'fast' and physics_dt_s = 0.002 both set the step; omit one")


def test_all_errors_of_a_file_are_in_one_message(tmp_path):
    file = write(tmp_path, 'duraton_s = 3\n[terrain]\nkind = "slope"\ngrade_deg = 80\n[path]\nspeed_m_s = "fast"\n')
    lines = refused(file).splitlines()
    assert len(lines) == 3
    assert all(line.startswith("mine.toml: ") for line in lines)
    assert {line.split(": ")[1] for line in lines} == {"duraton_s", "terrain.grade_deg", "path.speed_m_s"}


def test_all_conflicts_between_keys_are_in_one_message(tmp_path):
    file = write(tmp_path, 'physics_dt_s = 0.003\n[plant]\nkind = "bicycle"\n[terrain]\nkind = "slope"\n')
    lines = refused(file).splitlines()
    assert {line.split(": ")[1] for line in lines} == {"physics_dt_s", "terrain.kind"}
    assert all(line.startswith("mine.toml: ") for line in lines)


@pytest.mark.parametrize("key", ["seed.x", "a..b", ".seed", "seed."])
def test_an_override_of_an_unknown_key_is_reported(key):
    assert f"--set {key}" in refused("straight_line", {key: 1})


@pytest.mark.parametrize(
    "overrides",
    [
        {"steering.valve.delay_s": 1e12},
        {"plant.settle_s": 1e9},
        {"physics_dt_s": 1e-12},
        {"path": {"kind": "circle", "radius_m": 1e6, "speed_m_s": 0.01, "turns": 1000}, "terrain.half_size_m": 1e7},
    ],
    ids=["delay", "settling", "step", "duration"],
)
def test_values_that_would_exhaust_memory_or_run_for_years_are_rejected(overrides):
    """Each value would exhaust the memory or run for years."""
    refused("circle", overrides)


# --- round trip ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_resolved_scenario_is_read_back_unchanged(name, tmp_path):
    scenario = load_scenario(name, {"seed": 12, "tractor.mass_kg": 731.123456789012})
    file = write(tmp_path, scenario.to_toml())
    assert load_scenario(file) == scenario
    assert load_scenario(file).hash8 == scenario.hash8
    written = tomllib.loads(scenario.to_toml())
    assert (written["version"], written["seed"], written["name"]) == (__version__, 12, name)
    assert written["tractor"]["mass_kg"] == 731.123456789012


@pytest.mark.parametrize("table_union", [("terrain", Terrain), ("path", PathUnion), ("controller", Controller)])
def test_every_kind_is_unchanged_by_writing_and_reading_toml(table_union, tmp_path):
    table, union = table_union
    for member in every(union):
        scenario = load_scenario("straight_line", {f"{table}.kind": member.model_fields["kind"].default})
        assert load_scenario(write(tmp_path, scenario.to_toml())) == scenario.changed({"name": "straight_line"})


def test_scenario_hash_depends_on_settings_but_not_on_titles():
    scenario = load_scenario("straight_line")
    assert re.fullmatch("[0-9a-f]{8}", scenario.hash8)
    assert scenario.changed({"title": "other", "name": "else", "version": "0"}).hash8 == scenario.hash8
    changed = [{"seed": 2}, {"duration_s": 3.0}, {"tractor.mass_kg": 751.0}, {"plant.kind": "bicycle"}]
    assert len({scenario.changed(change).hash8 for change in changed} | {scenario.hash8}) == 5


def test_scenarios_are_immutable():
    with pytest.raises(ValueError, match="frozen"):
        load_scenario("circle").seed = 3


def test_run_duration_defaults_to_the_duration_of_the_path():
    assert load_scenario("circle").ticks == round(load_scenario("circle").path.duration_s / TICK_S)
    assert load_scenario("circle", {"duration_s": 2}).ticks == 40
    assert load_scenario("circle", {"duration_s": 1e-3}).ticks == 1


def test_shipped_scenario_files_are_found():
    assert set(SHIPPED) <= set(scenario_files())
    assert all(isinstance(path, Path) and path.suffix == ".toml" for path in scenario_files().values())


# --- data files of a scenario -------------------------------------------------------------------------------------

ROUTE = "0,0\n10,0\n20,{}\n"


def field_with_routes(folder):
    """Return a folder with special characters, a scenario and its route, and a folder with another route."""
    field, elsewhere = folder / "Übungs feld", folder / "elsewhere"
    field.mkdir()
    elsewhere.mkdir()
    (field / "weg.csv").write_text(ROUTE.format(0))
    (elsewhere / "other.csv").write_text(ROUTE.format(1))
    (field / "mine.toml").write_text('[path]\nkind = "waypoints"\nfile = "weg.csv"\n', encoding="utf-8")
    return field, elsewhere


def test_data_files_next_to_the_scenario_are_found_from_any_folder(tmp_path, monkeypatch):
    field, elsewhere = field_with_routes(tmp_path)
    monkeypatch.chdir(elsewhere)
    scenario = load_scenario(field / "mine.toml")
    assert scenario.path.file == str(field / "weg.csv")
    assert load_scenario(field / "mine.toml", {"path.file": "weg.csv"}) == scenario


def test_override_file_path_is_relative_to_the_working_directory(tmp_path, monkeypatch):
    field, elsewhere = field_with_routes(tmp_path)
    monkeypatch.chdir(elsewhere)
    given = {"path": {"kind": "waypoints", "file": "other.csv"}}
    scenario = load_scenario(field / "mine.toml", given)
    assert scenario.path.file == str(elsewhere / "other.csv")
    assert given["path"]["file"] == "other.csv"
    written = tmp_path / "scenario.toml"
    written.write_text(scenario.to_toml(), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert load_scenario(written).hash8 == scenario.hash8
    assert "nowhere.csv: no such file in" in refused(field / "mine.toml", {"path.file": "nowhere.csv"})


def test_excessive_nesting_in_a_scenario_is_rejected(tmp_path):
    assert "nested too deeply" in refused(write(tmp_path, ""), {"a." * 5000 + "b": 1})
    assert refused(write(tmp_path, "title = " + "[" * 5000 + "]" * 5000))


def test_data_files_in_the_folder_take_precedence_over_shipped_files(tmp_path):
    (tmp_path / "waypoints.csv").write_text("x_m,y_m\n0,0\n6,0\n")
    for folder, name, expected in (
        (tmp_path, "waypoints.csv", str(tmp_path / "waypoints.csv")),
        (tmp_path / "empty", "waypoints.csv", "waypoints.csv"),
        (tmp_path, "nowhere.csv", str(tmp_path / "nowhere.csv")),
    ):
        data = {"path": {"kind": "waypoints", "file": name}}
        absolute_paths(data, folder)
        assert data["path"]["file"] == expected
