"""Tyre rig: results for each tyre law and for MuJoCo's own contact, and written files."""

from importlib import import_module
from math import exp, radians, tan

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.spec import every
from agrobot_mj.extensions.bench.rig import FRONT, REAR, Rig, Setting, Towed, load_specimen, rig_command
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.simulation.results import MARK
from agrobot_mj.tyres import Contact, Linear, Tyre
from agrobot_mj.tyres.base import Structure

TRACTOR = TractorParameters()
STATIC = {FRONT: TRACTOR.front_axle_load / 2, REAR: TRACTOR.rear_axle_load / 2}
SPEEDS = [0.5, 1.0, 2.0, 4.0]
LAWS = [law() for law in every(Tyre) if law().judged]
both_axles = pytest.mark.parametrize("wheel", [FRONT, REAR])
each_law = pytest.mark.parametrize("tyre", LAWS, ids=lambda tyre: tyre.kind)


@pytest.fixture(scope="module")
def towed():
    return Towed(Contact().native, TRACTOR)


@both_axles
def test_linear_tyre_force_is_proportional_to_slip_at_every_speed(wheel):
    rig, stiffness = Rig(Linear(), TRACTOR, wheel), {FRONT: 7_400.0, REAR: 15_000.0}[wheel]
    slopes = []
    for speed in SPEEDS:
        for angle_deg in (-15, -3, -0.2, 0.2, 3, 15):
            slip = tan(radians(angle_deg))
            slopes.append(-rig.steady(Setting(speed, radians(angle_deg), 0.0, STATIC[wheel])).fy / slip)
    assert np.ptp(slopes) < 0.01 * stiffness
    assert np.mean(slopes) == pytest.approx(stiffness, rel=1e-6)


@each_law
@both_axles
@pytest.mark.parametrize("speed", SPEEDS)
def test_slip_step_reaches_63_percent_after_one_relaxation_length(tyre, wheel, speed):
    rig = Rig(tyre, TRACTOR, wheel)
    setting = Setting(speed, radians(0.5), 0.0, STATIC[wheel])
    force = rig.history(setting, 4 * rig.relaxation)[:, 1] / rig.steady(setting).fy
    travelled = speed * rig.dt * np.arange(1, len(force) + 1)
    assert (np.diff(force) > 0).all()
    stiffness = -rig.steady(setting._replace(slip_angle=1e-4)).fy / 1e-4
    carcass = 0.45 * rig.tyres.stiffness[wheel] if hasattr(tyre, "carcass_lateral") else None
    length = stiffness / carcass if carcass else 1.5 * rig.tyres.radius[wheel]
    assert np.interp(1 - exp(-1), force, travelled) == pytest.approx(length, rel=0.08)


@each_law
def test_tyre_force_is_independent_of_speed(tyre):
    rig = Rig(tyre, TRACTOR)
    settings = [Setting(v, radians(6), 0.08, STATIC[FRONT]) for v in SPEEDS]
    readings = np.array([rig.steady(setting)[:3] for setting in settings])
    assert readings == pytest.approx(np.tile(readings[0], (4, 1)), rel=1e-6)


@each_law
def test_steady_state_rig_measurements_do_not_depend_on_the_time_step(tyre):
    setting = Setting(1.0, radians(-4), -0.1, STATIC[FRONT])
    fine, coarse = (Rig(tyre, TRACTOR, dt=dt).steady(setting) for dt in (0.001, 0.005))
    assert tuple(fine) == pytest.approx(tuple(coarse), rel=1e-8)


def test_rig_applies_the_configured_wheel_load():
    for load in (300.0, 1400.0, 4000.0):
        assert Rig(Linear(), TRACTOR).steady(Setting(1.0, 0.0, 0.0, load)).load == pytest.approx(load)


# --- MuJoCo's own contact -----------------------------------------------------------------------------------------


def test_native_contact_slip_stiffness_scales_with_speed_and_impratio(towed):
    alpha, load = radians(0.02), STATIC[FRONT]
    slopes = np.array([-towed.steady(Setting(v, alpha, 0.0, load)).fy / load / alpha for v in SPEEDS])
    assert slopes / slopes[0] == pytest.approx(np.array(SPEEDS) / SPEEDS[0], rel=0.01)
    assert 100 < slopes[1] < 300
    stiffer = Towed(Contact(impratio=10).native, TRACTOR).steady(Setting(0.5, radians(0.005), 0.0, load)).fy
    assert stiffer / towed.steady(Setting(0.5, radians(0.005), 0.0, load)).fy == pytest.approx(10.0, rel=0.05)


def test_native_contact_force_but_not_tyre_force_depends_on_speed(towed):
    """At eight times the speed and equal slip angle, the contact force is eight times as large."""
    slow, fast = (Setting(v, radians(0.05), 0.0, STATIC[FRONT]) for v in (0.5, 4.0))
    assert towed.steady(fast).fy / towed.steady(slow).fy == pytest.approx(8.0, rel=0.01)
    rig = Rig(Linear(), TRACTOR)
    assert rig.steady(fast).fy / rig.steady(slow).fy == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("angle_deg", [-15, -1, 1, 5, 15])
@pytest.mark.parametrize("speed", [0.5, 4.0])
def test_contact_force_of_a_hopping_wheel_is_within_the_friction_limit(towed, angle_deg, speed):
    reading = towed.steady(Setting(speed, radians(angle_deg), 0.0, STATIC[FRONT]))
    assert reading.load == pytest.approx(STATIC[FRONT], rel=0.05)
    assert 0.7 * 0.8 < -np.sign(angle_deg) * reading.fy / reading.load <= 0.8 + 1e-6
    assert 0.05 < reading.grounded <= 1.0


def test_towed_wheel_rolling_freely_and_straight_has_no_force(towed):
    reading = towed.steady(Setting(1.0, 0.0, 0.0, STATIC[FRONT]))
    assert (reading.fx, reading.fy) == pytest.approx((0.0, 0.0), abs=1.0)
    assert reading.grounded == 1.0


def test_towed_wheel_turning_faster_than_rolling_pushes_forward(towed):
    assert towed.steady(Setting(1.0, 0.0, 0.001, STATIC[FRONT])).fx > 100
    assert towed.steady(Setting(1.0, 0.0, -0.001, STATIC[FRONT])).fx < -100


def test_load_below_the_wheel_weight_is_rejected(towed):
    with pytest.raises(ValueError, match="weight"):
        towed.steady(Setting(1.0, 0.0, 0.0, 100.0))


# --- the command --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    (folder / "firm.toml").write_text('[plant.tyre]\nkind = "magic_formula"\ncarcass_lateral = 0.3\n')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            import_module("agrobot_mj.extensions.bench.rig.sweep"), "CREEP_DEG", (0.0, 0.1, 0.5, 1.5)
        )  # fewer runs of MuJoCo
        files = rig_command(str(folder / "firm.toml"), folder / "out")
    return files, pq.read_table(folder / "out" / "curves.parquet")


def test_tyre_command_writes_only_curves_and_figures(done):
    files, _ = done
    names = [
        "curves.parquet",
        "lateral.png",
        "longitudinal.png",
        "aligning.png",
        "combined.png",
        "step.png",
        "speed.png",
    ]
    assert [file.name for file in files] == names
    assert sorted(file.name for file in files[0].parent.iterdir()) == sorted([*names, MARK])
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in files[1:])


def test_written_curves_equal_the_measurements_of_the_rig(done):
    table = done[1]
    tyre = load_specimen("magic_formula").tyre.model_copy(update={"carcass_lateral": 0.3})
    rigs = {"front": Rig(tyre, TRACTOR), "rear": Rig(tyre, TRACTOR, REAR)}
    rows = table.filter(pc.not_equal(table["test"], "contact"))
    steady = rows.filter(pc.not_equal(rows["test"], "step")).take(list(range(0, 1500, 100))).to_pylist()
    for row in steady:
        setting = Setting(row["speed_m_s"], row["slip_angle_rad"], row["slip_ratio"], row["load_n"])
        reading = rigs[row["axle"]].steady(setting)
        assert (row["fx_n"], row["fy_n"], row["mz_n_m"]) == pytest.approx(tuple(reading[:3]), rel=1e-9, abs=1e-9)


def test_written_curves_cover_every_load_and_speed_of_both_axles(done):
    table = done[1]
    for test in ("lateral", "longitudinal"):
        for axle, wheel in (("front", FRONT), ("rear", REAR)):
            rows = table.filter(pc.and_(pc.equal(table["test"], test), pc.equal(table["axle"], axle)))
            cases = set(zip(rows["speed_m_s"].to_pylist(), rows["load_n"].to_pylist(), strict=True))
            load = STATIC[wheel]
            assert cases == {(1.0, k * load) for k in (0.5, 1.0, 1.5, 2.0)} | {(v, load) for v in SPEEDS}
    assert set(table["tyre"].to_pylist()) == {"magic_formula", "contact"}
    assert table["distance_m"].null_count == table.num_rows - pc.sum(pc.equal(table["test"], "step")).as_py()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('[plant.tyre]\nkind = "soil"\ncone_index_kpa = -1', "plant.tyre.cone_index_kpa: must be above 0, got -1"),
        ('kind = "soil"\n', "kind: unknown key"),
        ('[plant.tyre]\nkind = "sol"', "plant.tyre.kind: unknown kind 'sol'; did you mean 'soil'?"),
        ('[plant.tyre]\nkind = "soil"\nply = 3', "plant.tyre.ply: must be one of 'bias' or 'radial'"),
        ('plant.kind = "bicycle"', "plant.kind: must be 'mujoco', got 'bicycle'"),
        ('[plant.tyre]\nkind = "soil"\n[tractor]\nmass_kg = -1', "tractor.mass_kg: must be at least 50, got -1"),
        ("kind = ", "not valid TOML"),
    ],
)
def test_error_for_an_invalid_tyre_file_names_the_key(tmp_path, text, told):
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(ScenarioError) as error:
        rig_command(str(tmp_path / "bad.toml"), tmp_path / "out")
    assert told in str(error.value)
    assert str(error.value).startswith("bad.toml: ")
    assert not (tmp_path / "out").exists()


def test_error_for_an_unknown_tyre_lists_the_available_tyres(tmp_path):
    with pytest.raises(ScenarioError, match=r"unknown tyre 'liner'; did you mean 'linear'\? \(known: contact, "):
        rig_command("liner", tmp_path)
    with pytest.raises(ScenarioError, match="no such file"):
        rig_command("nowhere.toml", tmp_path)


def test_tractor_table_of_a_tyre_file_replaces_the_default_tractor(tmp_path):
    (tmp_path / "t.toml").write_text('[plant.tyre]\nkind = "soil"\n[tractor]\nmass_kg = 780\n')
    assert load_specimen(str(tmp_path / "t.toml")).tractor.mass_kg == 780
    assert load_specimen("soil").tractor == TRACTOR


@pytest.mark.parametrize("radii", [11.0, 1e9])
def test_relaxation_length_too_long_to_measure_is_rejected(tmp_path, radii):
    file = tmp_path / "tyre.toml"
    file.write_text(f'[plant.tyre]\nkind = "linear"\nrelaxation_radii = {radii}\n')
    with pytest.raises(ScenarioError, match="relaxation_radii: must be at most 10"):
        rig_command(str(file), tmp_path / "out")

    class Long(Linear):
        def structure(self):
            return Structure(radii, 0.02)

    with pytest.raises(ValueError, match="relaxation length must be at most 10 wheel radii"):
        Rig(Long(), TractorParameters())
