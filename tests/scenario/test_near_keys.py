"""Suggestions for unknown keys, options and names: similar names, starting with names in the same table."""

import re

import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core import walk
from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.scenario.reference import explain_key


def told(key, base="side_slope_10"):
    with pytest.raises(ScenarioError) as error:
        load_scenario(base, {key: 1.0})
    return str(error.value).splitlines()[0]


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("path.ramp", "did you mean 'ramp_s'? ("),  # the name without its unit
        ("tractor.track", "did you mean 'track_m'? ("),
        ("terrain.angle_deg", "did you mean 'grade_deg'? ("),  # not one of path.piece
        ("path.row_m", "unknown key (known"),  # nothing is near
        ("path.width_m", "did you mean 'swath_m' (kind = 'swaths') or 'implement.width_m'? ("),
        ("controller.gain", "did you mean 'kp' or 'kd'? ("),  # not guidance.map.gain
        ("controller.zone", "controller.zone: unknown key (known"),
        ("tractor.weight", "did you mean 'mass_kg'? ("),
        ("guidance.lookahead_m", "it is a key of kind = 'pure_pursuit'"),
        ("steering.relief_pressure_bar", "did you mean 'steering.cylinder.relief_pressure_bar'?"),
        ("plant.track_m", "did you mean 'tractor.track_m'"),
        ("cone_index_kpa", "did you mean 'plant.tyre.cone_index_kpa' or 'terrain.patch.cone_index_kpa'?"),
    ],
)
def test_suggestions_for_an_unknown_key_prefer_the_same_table(key, hint):
    assert hint in told(key)


def test_schema_is_searched_only_once_for_many_unknown_keys():
    walk._key_index.cache_clear()
    assert len({told(f"tractor.mas{k}_kg") for k in range(30)}) == 30
    assert walk._key_index.cache_info().misses == 1


def test_suggestions_for_kind_names_are_case_insensitive(call):
    assert suggestion("STANLEY", ["lqr", "stanley"]) == "; did you mean 'stanley'?"
    status, _, err = call("compare", "circle", "--guidance", "Stanley")
    assert (status, "unknown kind 'Stanley'; did you mean 'stanley'?" in err) == (2, True)


def test_each_unknown_law_of_a_comparison_is_reported(call):
    status, _, err = call("compare", "circle", "--guidance", "zigzag,LQR,lqr")
    lines = err.splitlines()
    assert (status, len(lines)) == (2, 2)
    assert "unknown kind 'zigzag' (known" in lines[0]
    assert "unknown kind 'LQR'; did you mean 'lqr'?" in lines[1]
    assert all(line.endswith("a plugin's kind needs --plugin FILE.py and @register") for line in lines)


def test_words_with_only_two_common_letters_are_not_suggested():
    assert suggestion("pid", ["eso", "nmpc", "lqr"]) == ""


def test_scenario_file_in_the_working_folder_is_found_without_suffix(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "did you mean 'circle'?" in call("run", "circl")[2]
    (tmp_path / "circl.toml").write_text("seed = 4\n", encoding="utf-8")
    assert load_scenario("circl").seed == 4
    (tmp_path / "circle.toml").write_text("seed = 4\n", encoding="utf-8")
    assert load_scenario("circle").seed == 1  # a name of the library goes first


def test_suggested_key_of_another_terrain_kind_names_that_kind():
    assert "did you mean 'grade_deg' (kind = 'slope')? (" in told("terrain.angle_deg", "circle")


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("run", "circle", "--seed", "5"), "use --set seed=5"),
        (("run", "circle", "--duration=9"), "use --set duration_s=9"),
        (("compare", "circle", "--speed", "2"), "use --set path.speed_m_s=2"),
        (("run", "circle", "--antenna-height", "2"), "use --set tractor.antenna_height_m=2"),
        (("compare", "circle", "--laws", "lqr"), "use --guidance"),
        (("run", "circle", "--law", "lqr"), "use --set guidance.kind=lqr"),
        (("run", "circle", "--plants", "a b"), "use --set plant.kind=..."),
        (("run", "circle", "--guidance", "lqr"), "use --set guidance.kind=lqr"),
        (("run", "circle", "--jobs", "3"), "--jobs is an option of compare, sweep, limit, risk, falsify, tune"),
        (("sweep", "validity", "--seeds", "3"), "add seeds = 3 to the sweep file"),
        (("sweep", "validity", "--seeds", "x"), "add seeds = ... to the sweep file"),
        (("sweep", "validity", "--guidance", "lqr"), 'add "guidance.kind" = "lqr" to the sweep file, table [set]'),
        (("list", "--machine"), "use --machines"),
        (("list", "sweeps"), "use --sweeps"),
    ],
)
def test_error_for_an_unknown_option_suggests_the_closest_option(call, arguments, hint):
    status, _, err = call(*arguments)
    assert status == 2
    assert err.splitlines()[-1].endswith(f"; {hint}")


@pytest.mark.parametrize(
    ("arguments", "hint", "reason"),
    [
        (("run", "circle", "--seed", "x"), "use --set seed=...", "seed: must be a whole number, got 'x'"),
        (("run", "circle", "--speed", "50"), "use --set path.speed_m_s=...", "path.speed_m_s: must be at most"),
        (("run", "circle", "--guidance=pid"), "use --set guidance.kind=...", "guidance.kind: unknown kind 'pid'"),
        (("sweep", "validity", "--seed", "x"), 'add "seed" = ... to the sweep file', "seed: must be a whole number"),
    ],
)
def test_suggested_key_for_an_unknown_option_names_its_accepted_values(call, arguments, hint, reason):
    *_, error, last = call(*arguments)[2].splitlines()
    assert f"; {hint}" in error
    assert last.startswith(reason)


@pytest.mark.parametrize(
    "arguments", [("run", "circle", "lqr"), ("run", "circle", "--qqq"), ("run",), ("run", "circle", "--fault", "x")]
)
def test_error_for_an_invalid_value_does_not_suggest_an_option(call, arguments):
    status, _, err = call(*arguments)
    assert (status, "use --" in err) == (2, False)


def test_explain_command_searches_names_before_descriptions():
    named = explain_key("inertia").splitlines()
    assert named[0] == "no key 'inertia'; keys that contain it"
    assert [line.split()[0] for line in named[1:]] == [
        f"tractor.{axis}_inertia_kg_m2" for axis in ("yaw", "roll", "pitch")
    ]
    assert any(line.split()[0] == "tractor.hitch_height_m" for line in explain_key("Hitch").splitlines()[1:])
    described = explain_key("atmosphere")  # in no name
    assert re.search(r"^  \w+\.", described, re.MULTILINE)
    assert all("atmosphere" not in line.split()[0] for line in described.splitlines()[1:])


@pytest.mark.parametrize(
    ("words", "found", "missing"),
    [
        ("weight", "tractor.mass_kg", "controller.network.q_init"),  # the synonym of a name before a description
        ("wheel base", "tractor.wheelbase_m", "tractor.track_m"),
        ("slope", "terrain.slope", "guidance.gain_per_m"),
        ("Slopes", "terrain.grade_deg", "guidance.gain_per_m"),
        ("lqr", "guidance.lqr", "guidance.stanley"),
        ("tire stiffness", "tractor.rear_tyre_stiffness_n_m", "tractor.rear_tyre_damping_n_s_m"),
        ("grip", "plant.tyre.front.lateral.mu", "sensors.gnss.multipath_sigma_m"),  # `mu` is a whole word
    ],
)
def test_explain_command_finds_keys_and_kinds_by_synonyms(words, found, missing):
    first, *lines = explain_key(words).splitlines()
    shown = {line.split()[0] for line in lines}
    assert first.startswith(f"no key '{words}'; keys that contain it")
    assert (found in shown, missing in shown) == (True, False)


def test_explanation_of_a_table_has_the_defaults_of_each_kind():
    lines = [line.split() for line in explain_key("terrain").splitlines() if line.split()[:1] == ["grade_deg"]]
    assert [(line[1], "(slope)" in " ".join(line)) for line in lines] == [("5.0", True), ("0.0", False)]
    sizes = [line.split()[1] for line in explain_key("terrain").splitlines() if line.split()[:1] == ["half_size_m"]]
    assert sizes == ["500.0", "75.0", "60.0"]
