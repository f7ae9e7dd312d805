"""Tyres defined by size code and pressure: dimensions, published loaded radii, and effects on the machine."""

from math import sqrt

import numpy as np
import pytest
from pydantic import ValidationError

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.machine.fitting import fit_warnings
from agrobot_mj.machine.tractor import GRAVITY, TractorParameters
from agrobot_mj.machine.tyre_size import nominal_size, tyre_size
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.tyres import MagicFormula, Soil
from agrobot_mj.tyres.laws import tyre_set

LARGE = {"mass_kg": 9391.0, "wheelbase_m": 2.9, "front_load_fraction": 0.414, "track_m": 1.93}
TYRES = {"front_tyre": "420/85R30", "rear_tyre": "520/85R42"}


@pytest.mark.parametrize(
    ("code", "width", "diameter", "radial"),
    [
        ("520/85R42", 0.520, 1.951, True),
        ("VF 380/90 R46 173D", 0.380, 1.852, True),
        ("600/50-22.5", 0.600, 1.172, False),
        ("18.4-38", 0.467, 1.760, False),
        ("18.4r38", 0.467, 1.760, True),
        ("11L-15", 0.279, 0.772, False),
        ("15.5/80-24", 0.394, 1.240, False),
        ("66x43.00R25", 1.092, 1.676, True),
        ("26x12.00-12", 0.305, 0.660, False),
    ],
)
def test_tyre_dimensions_are_derived_from_size_codes_of_every_family(code, width, diameter, radial):
    size = tyre_size(code)
    assert size[:2] == pytest.approx((width, diameter), abs=6e-4)
    assert size.radial is radial


@pytest.mark.parametrize(("code", "printed_m"), [("18.4R38", 1.750), ("13.6R24", 1.210), ("16.9R30", 1.475)])
def test_diameters_from_inch_codes_agree_with_data_sheets_within_2_percent(code, printed_m):
    assert tyre_size(code).diameter == pytest.approx(printed_m, rel=0.02)


@pytest.mark.parametrize("code", ["", "tall", "520/85", "520/5R42", "9999/85R42", "520/85R99", "0-0", "1x1-1"])
def test_error_for_an_invalid_tyre_size_code_names_key_and_remedy(code):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("straight_line", {"tractor.rear_tyre": code})
    assert str(caught.value).count("\n") == 0
    assert "tractor.rear_tyre: " in str(caught.value)


def test_wide_tyre_without_a_size_code_has_a_rim_of_minimum_diameter():
    size = nominal_size(0.3, 0.4)
    assert (size.diameter, size.width, size.rim, size.radial) == pytest.approx((0.6, 0.4, 0.24, False))


@pytest.mark.parametrize("keys", [{"rear_tyre": "9.5-16"}, {"axle_pivot_radii": 0.2}])
def test_tyre_keys_are_rejected_with_a_user_defined_mjcf_body(keys):
    with pytest.raises(ValidationError, match=f"omit {next(iter(keys))}"):
        TractorParameters(mjcf="own.xml", **keys)


def test_overridden_tyre_size_is_unchanged_by_writing_and_reading(tmp_path):
    changed = {"machine": "row_crop", "tractor.rear_tyre": "480/80R46", "tractor.rear_tyre_pressure_bar": 0.9}
    scenario = load_scenario("straight_line", changed)
    assert scenario.tractor.rear_wheel.radius == pytest.approx((46 * 0.0254 + 2 * 0.8 * 0.48) / 2)
    (tmp_path / "again.toml").write_text(scenario.to_toml())
    assert load_scenario(tmp_path / "again.toml").tractor.rear_wheel == scenario.tractor.rear_wheel


@pytest.mark.parametrize(
    ("code", "kg", "bar", "printed_m"),
    [
        ("380/90R46", 3000, 1.6, 0.846),
        ("380/90R50", 3250, 1.6, 0.888),
        ("380/90R54", 3450, 1.6, 0.930),
        ("650/65R42", 4250, 1.6, 0.858),
        ("12-16.5", 2800, 5.52, 15.1 * 0.0254),
    ],
)
def test_loaded_radii_agree_with_data_sheets_within_1_5_percent(code, kg, bar, printed_m):
    """Loads of the first four tyres are typical of this pressure; load and pressure of the last are published."""
    size = tyre_size(code)
    assert size.diameter / 2 - GRAVITY * kg / size.stiffness(bar) == pytest.approx(printed_m, rel=0.015)


def test_tyres_at_default_pressure_deflect_by_a_fifth_of_section_height():
    for wheel in TractorParameters(**LARGE, **TYRES).wheels:
        assert wheel.deflection / wheel.size.section_height == pytest.approx(0.2)
    light = TractorParameters(rear_tyre="520/85R42")
    assert light.rear_wheel.stiffness == pytest.approx(tyre_size("520/85R42").stiffness(0.6))


def test_lower_pressure_lengthens_contact_patch_and_relaxation_length():
    def fitted(bar):
        return tyre_set(MagicFormula(), TractorParameters(**LARGE, **TYRES, rear_tyre_pressure_bar=bar))

    soft, hard = fitted(0.8), fitted(2.0)
    ratio = hard.stiffness[2] / soft.stiffness[2]
    assert 1.5 < ratio < 2.5
    assert soft.patch_half_length[2] / hard.patch_half_length[2] == pytest.approx(sqrt(ratio))
    assert soft.relaxation[2] == pytest.approx(ratio * hard.relaxation[2])
    assert np.array_equal(soft.stiffness[:2], hard.stiffness[:2])


def test_specified_tyre_stiffness_takes_precedence_over_pressure():
    given = TractorParameters(**LARGE, **TYRES, rear_tyre_stiffness_n_m=3e5)
    assert given.rear_wheel.stiffness == 3e5
    assert given.rear_wheel.size == tyre_size("520/85R42")


def test_soil_law_uses_section_height_and_carcass_of_the_size_code():
    tractor = TractorParameters(**LARGE, **TYRES)
    _, rear = Soil().coefficients(tractor)
    assert (rear.h, rear.radial) == (pytest.approx(0.442), 1.0)
    assert Soil(ply="bias").coefficients(tractor)[1].radial == 0.0


def test_hint_for_an_underinflated_tyre_states_its_pressure():
    vehicle = load_scenario("straight_line", {"machine": "row_crop", "tractor.rear_tyre": "520/85R42"}).vehicle
    flat = vehicle._replace(tractor=TractorParameters(**LARGE, **TYRES, rear_tyre_pressure_bar=0.3))
    assert any(line.startswith("tractor.rear_tyre_pressure_bar: ") for line in fit_warnings(flat, True, 1.0))
    assert not list(fit_warnings(vehicle, True, 1.0))
