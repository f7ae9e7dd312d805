"""Machine files: priority below scenario keys, content in the resolved file, and complete replacement."""

import tomllib

import pytest
import typer
from typer.testing import CliRunner

from agrobot_mj.cli.app import app
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.resources import machine_files
from agrobot_mj.scenario.hints import hints
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.scenario.machines import TABLES
from agrobot_mj.scenario.schema import Scenario, resolve
from agrobot_mj.simulation.feasibility import check_tractor

MINE = """
title = "Mine"
[tractor]
mass_kg = 2000
wheelbase_m = 2.0
[implement]
kind = "mounted"
mass_kg = 150
[driveline]
full_speed_m_s = 6
"""


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "mine.toml").write_text(MINE)
    return str(tmp_path / "mine.toml")


@pytest.mark.parametrize("name", machine_files())
def test_shipped_machine_has_a_title_and_no_hints(name):
    text = machine_files()[name].read_text(encoding="utf-8")
    assert text.startswith("# ")
    assert tomllib.loads(text)["title"]
    assert hints(load_scenario("straight_line", {"machine": name, "implement": {"kind": "none"}})) == []


@pytest.mark.parametrize("name", machine_files())
def test_every_number_of_a_shipped_machine_has_a_source(name):
    """The source is on the same line, or above a group of lines without a gap."""
    sourced = False
    for line in machine_files()[name].read_text(encoding="utf-8").splitlines():
        said = any(word in line for word in ("stimate", "ssumed", "Log", "Code", "Maker", "Regulation", "[Karkee"))
        sourced = said or (sourced and "=" in line)
        assert sourced or " = " not in line or '"' in line, line


def test_default_machine_equals_the_compact_tractor_exactly():
    plain, named = load_scenario("figure_eight"), load_scenario("figure_eight", {"machine": "compact"})
    assert plain.machine == "compact"
    assert plain.model_dump() == named.model_dump()
    assert plain.tractor == Scenario().tractor


def test_scenario_overrides_machine_and_machine_overrides_defaults(mine):
    s = load_scenario("straight_line", {"machine": mine, "tractor.mass_kg": 1900.0})
    assert (s.tractor.mass_kg, s.tractor.wheelbase_m, s.tractor.front_load_fraction) == (1900.0, 2.0, 0.38)
    assert (s.implement.kind, s.implement.mass_kg, s.driveline.full_speed_m_s) == ("mounted", 150.0, 6.0)


@pytest.fixture
def led(tmp_path):
    """Return the file of a machine with its own guidance law."""
    (tmp_path / "led.toml").write_text(MINE + '[guidance]\nkind = "stanley"\ngain_per_s = 0.7\n')
    return str(tmp_path / "led.toml")


def test_guidance_law_of_the_machine_is_the_default_of_the_scenario(led):
    s = load_scenario("bumps", {"machine": led})
    assert (s.law, s.guidance.gain_per_s) == ("stanley", 0.7)
    assert s.changed({"guidance.softening_m_s": 0.4}).guidance.gain_per_s == 0.7
    assert load_scenario("bumps", {"machine": led, "guidance.gain_per_s": 0.5}).guidance.gain_per_s == 0.5


@pytest.mark.parametrize(
    ("given", "law"),
    [
        ({"guidance.kind": "pure_pursuit"}, "pure_pursuit"),
        ({"controller.kind": "pi"}, "kinematic with pi"),
        ({"controller.kp": 0.5}, "kinematic with pd_t2fnn"),
        ({"controller.kind": "pi", "guidance.gain_per_m": 0.5}, "kinematic with pi"),
        ({"controller.kind": "pi", "guidance.kind": "feedforward"}, "feedforward with pi"),
        ({"controller.kind": "pi", "guidance.kind": "stanley"}, "stanley"),
    ],
)
def test_scenario_law_or_yaw_controller_replaces_the_machine_law(led, given, law):
    """The result is the same for an override, a file, and a later change. A yaw controller implies the paper's law."""
    s = load_scenario("bumps", {"machine": led, **given})
    assert s.law == law
    assert load_scenario("bumps", given).changed({"machine": led}).model_dump() == s.model_dump()
    assert load_scenario("bumps", {"machine": led}).changed(given).model_dump() == s.model_dump()
    assert load_scenario("bumps", {"machine": led}).law == "stanley"


def test_setting_a_yaw_controller_does_not_change_the_default_law(led, tmp_path):
    (tmp_path / "field.toml").write_text('machine = "led.toml"\n[controller]\nkind = "pd"\n')
    assert load_scenario(tmp_path / "field.toml").law == "kinematic with pd"


def test_resolved_scenario_keeps_the_guidance_law_of_the_machine(led):
    for given in ({}, {"controller.kind": "pi"}):
        s = load_scenario("bumps", {"machine": led, **given})
        again = resolve(tomllib.loads(s.to_toml()), "again")
        assert (again.model_dump(), again.hash8) == (s.model_dump(), s.hash8)


def test_compared_yaw_controllers_replace_the_law_of_the_machine(led):
    laws = [load_scenario("bumps", {"machine": led, "controller.kind": kind}).law for kind in ("pd", "pd_t2fnn")]
    assert laws == ["kinematic with pd", "kinematic with pd_t2fnn"]


def test_all_shipped_machines_except_the_compact_tractor_use_lqr():
    laws = {name: load_scenario("bumps", {"machine": name}).law for name in machine_files()}
    assert laws.pop("compact") == "kinematic with pd_t2fnn"
    assert set(laws.values()) == {"lqr"}


@pytest.mark.parametrize("name", ["row_crop", "utility"])
def test_estimator_of_the_scenario_replaces_the_machine_estimator(name):
    own = load_scenario("rain", {"machine": name})
    assert (own.estimator.kind, own.estimator.terrain_compensation) == ("ekf_full", True)
    papers = load_scenario("rain", {"machine": name, "estimator.kind": "ekf"}).estimator
    assert (papers.kind, papers.terrain_compensation) == ("ekf", False)
    assert load_scenario("side_slope_10_bias_ekf", {"machine": name}).estimator.kind == "ekf_bias"


def test_scenario_table_of_another_kind_inherits_no_machine_keys(mine):
    assert load_scenario("grain_cart", {"machine": mine}).implement == load_scenario("grain_cart").implement
    assert load_scenario("straight_line", {"machine": mine, "implement.kind": "none"}).implement.kind == "none"


def test_overrides_without_a_kind_apply_to_the_kind_of_the_machine(mine):
    assert load_scenario("straight_line", {"implement.mass_kg": 200.0, "machine": mine}).implement.kind == "mounted"


def test_changing_the_machine_removes_all_keys_of_the_previous_machine(mine):
    own = {"tractor.track_m": 1.3}
    swapped = load_scenario("straight_line", {"machine": mine, **own}).changed({"machine": "compact"})
    assert swapped == load_scenario("straight_line", own)
    assert swapped.changed({"machine": mine}) == load_scenario("straight_line", {"machine": mine, **own})


def test_resolved_scenario_contains_machine_keys_and_gives_equal_runs(mine):
    s = load_scenario("straight_line", {"machine": mine})
    data = tomllib.loads(s.to_toml())
    assert (data["machine"], data["tractor"]["wheelbase_m"], data["steering"]["cylinder"]["bore_mm"]) == (mine, 2.0, 63)
    again = resolve(data, "again")
    assert again.model_dump() == s.model_dump()
    assert again.hash8 == s.hash8


def test_machine_file_is_copied_to_the_results(mine, tmp_path):
    text, files = load_scenario("straight_line", {"machine": mine}).portable()
    assert tomllib.loads(text)["machine"] == "mine.toml"
    assert {name: str(path) for name, path in files.items()} == {"mine.toml": mine}
    assert load_scenario("straight_line", {"machine": "riding"}).portable()[1] == {}


def test_machine_file_in_the_folder_of_the_scenario_is_found(mine, tmp_path):
    (tmp_path / "field.toml").write_text('machine = "mine.toml"\n[path]\nkind = "line"\n')
    assert load_scenario(tmp_path / "field.toml").tractor.mass_kg == 2000.0


@pytest.mark.parametrize(
    ("machine", "message"),
    [
        ("ridng", r"unknown 'ridng'; did you mean 'riding'\? \(known: compact, .*utility\)"),
        ("no/such.toml", "no such file"),
        (3, "machine: must be a string, got 3"),
    ],
)
def test_an_unknown_machine_is_rejected(machine, message):
    with pytest.raises(ScenarioError, match=message):
        load_scenario("straight_line", {"machine": machine})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '[path]\nkind = "line"',
            f"mine.toml: path: unknown table \\(known: title, {', '.join(TABLES)}\\)",
        ),
        ("[tractor]\nmass_kg = -1", "mine.toml: tractor.mass_kg: must be at least 50, got -1"),
        ("[tractor]\nmas_kg = 1000", "mine.toml: tractor.mas_kg: unknown key; did you mean 'mass_kg'"),
        ("[tractor", "mine.toml: not valid TOML"),
    ],
)
def test_machine_file_errors_contain_the_file_name(mine, tmp_path, text, message):
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ScenarioError, match=message):
        load_scenario("straight_line", {"machine": mine})


def test_every_command_with_a_scenario_accepts_the_machine_option():
    commands = typer.main.get_command(app).commands
    options = {name: {option for each in made.params for option in each.opts} for name, made in commands.items()}
    assert {"run", "compare"} <= (driving := {name for name in options if "--set" in options[name]})
    assert {name for name in options if "--machine" in options[name]} == driving


def test_command_line_lists_machines_and_rejects_an_unknown_machine():
    listed = CliRunner().invoke(app, ["list", "--machines"])
    assert [line.split()[0] for line in listed.output.splitlines()] == sorted(machine_files())
    with pytest.raises(ScenarioError, match="known: compact"):
        CliRunner().invoke(app, ["run", "circle", "--machine", "ridng"], catch_exceptions=False)
    with pytest.raises(ScenarioError, match="specify only one of them"):
        CliRunner().invoke(app, ["list", "--machines", "--sweeps"], catch_exceptions=False)


def test_error_for_an_impossible_machine_names_its_scenario(mine):
    impossible = load_scenario("straight_line", {"machine": mine, "tractor.yaw_inertia_kg_m2": 1.0})
    with pytest.raises(
        ScenarioError, match=r"^straight_line, machine .*mine\.toml: tractor: .*for this mass and wheelbase"
    ):
        check_tractor(impossible)


def test_machine_option_is_applied_before_overrides_in_any_order(mine, tmp_path):
    out = ["--set", "duration_s=0.05", "--no-rrd", "--out", str(tmp_path / "out"), "-q", "--set", "plant.settle_s=0"]
    options = ["--set", "implement.mass_kg=130", "--machine", mine, "--set", "tractor.mass_kg=1800"]
    result = CliRunner().invoke(app, ["run", "straight_line", *options, *out], catch_exceptions=False)
    assert result.exit_code in (0, 1)
    ran = tomllib.loads((tmp_path / "out" / "scenario.toml").read_text())
    assert (ran["machine"], ran["tractor"]["mass_kg"], ran["implement"]["mass_kg"]) == ("mine.toml", 1800.0, 130.0)
    assert (tmp_path / "out" / "mine.toml").read_text() == MINE
    heavier = load_scenario("straight_line", {"machine": mine, "tractor.mass_kg": 1800.0})
    short = heavier.changed({"implement.mass_kg": 130.0, "duration_s": 0.05, "plant.settle_s": 0.0})
    assert load_scenario(tmp_path / "out" / "scenario.toml").hash8 == short.hash8


def test_scenario_that_overrides_most_machine_keys_gets_a_hint(mine, tmp_path):
    (tmp_path / "ran.toml").write_text(load_scenario("straight_line", {"machine": "utility"}).to_toml())
    (told,) = [line for line in hints(load_scenario(tmp_path / "ran.toml", {"machine": mine})) if "machine" in line]
    assert told.startswith("machine: the scenario overrides 5 of 5 keys of")
    assert hints(load_scenario(tmp_path / "ran.toml")) == []
    assert hints(load_scenario("straight_line", {"machine": "utility", "tractor.mass_kg": 5400.0})) == []
