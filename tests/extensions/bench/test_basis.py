"""Sources of the parameters of a machine, read from the comments of its file and the docstrings of its keys."""

import pytest

from agrobot_mj.core.resources import machine_files
from agrobot_mj.extensions.bench.datasheet import SAYS, bases, basis_of, comments
from agrobot_mj.scenario.loading import load_scenario

FILE = """title = "One"
[tractor]
mass_kg = 900 # Measured on a scale.
wheelbase_m = 1.5 # [KarkeeSteward2010]: table 1.
front_wheel_radius_m = 0.3 # Estimate: 6-12.
front_wheel_width_m = 0.16
[steering.valve] # Identified from a log.
delay_s = 0.2
[driveline]
full_speed_m_s = 4.0
"""


def found(machine):
    scenario = load_scenario("straight_line", {"machine": str(machine)})
    return {parameter.key: parameter.basis for parameter in bases(str(machine), scenario)}


def test_source_of_a_value_is_read_from_its_comment_or_docstring(tmp_path):
    (tmp_path / "one.toml").write_text(FILE)
    basis = found(tmp_path / "one.toml")
    assert basis["tractor.mass_kg"] == "measured"
    assert basis["tractor.wheelbase_m"] == "printed"
    assert basis["tractor.front_wheel_radius_m"] == basis["tractor.front_wheel_width_m"] == "assumed"
    assert basis["steering.valve.delay_s"] == "identified"
    assert basis["driveline.full_speed_m_s"] == "not stated"
    assert basis["tractor.steer_limit_deg"] == "printed"
    assert basis["tractor.roll_inertia_kg_m2"] == basis["driveline.pump_time_constant_s"] == "assumed"


def test_published_and_assumed_values_of_a_machine_are_distinguished():
    basis = found("row_crop")
    assert {key for key, value in basis.items() if value == "printed" and key.startswith("tractor.")} >= {
        "tractor.mass_kg",
        "tractor.yaw_inertia_kg_m2",
        "tractor.front_load_fraction",
    }
    assert basis["tractor.track_m"] == basis["driveline.power_limit_kw"] == "assumed"


@pytest.mark.parametrize("machine", machine_files())
def test_every_number_of_a_shipped_machine_has_a_stated_source(machine):
    assert set(found(machine).values()) <= set(SAYS)


@pytest.mark.parametrize(
    ("comment", "basis"),
    [
        ("Log: by regression.", "measured"),
        ("Maker: 5.5 mph.", "printed"),
        ("as usual", "not stated"),
        ("", "not stated"),
    ],
)
def test_first_words_of_a_comment_determine_the_kind_of_source(comment, basis):
    assert basis_of(comment) == basis


def test_keys_in_tables_have_dotted_names():
    assert comments(FILE)["steering.valve.delay_s"] == "identified"
