"""Validation faults as sentences: one line per fault, with the key that the user wrote and a remedy."""

import json
from typing import Annotated, Literal

import pytest
from pydantic import Field, ValidationError, model_validator

from agrobot_mj.core.errors import ScenarioError, suggestion
from agrobot_mj.core.messages import explain
from agrobot_mj.core.spec import Fraction, Positive, Spec


class Air(Spec):
    kind: Literal["air"] = "air"
    pressure_bar: Positive = 1.0


class Foam(Spec):
    kind: Literal["foam"] = "foam"
    density: Fraction = 0.5
    colour: Literal["grey", "black"] = "grey"


class Box(Spec):
    filling: Annotated[Air | Foam, Field(discriminator="kind")] = Air()
    width_m: Positive = 1.0
    height_m: Positive = 1.0
    copies: Annotated[int, Field(ge=1, le=9)] = 1
    label: str = ""
    sealed: bool = False
    sides: list[float] = []

    @model_validator(mode="after")
    def _not_too_flat(self) -> "Box":
        if self.height_m < 0.01 * self.width_m:
            raise ValueError("height_m: too flat; raise it")
        return self


class Shelf(Spec):
    box: Box = Box()
    depth_m: Annotated[float, Field(lt=45)] = 1.0


def faults(data):
    """Return the lines of the error message for `data`, which are validated like a scenario."""
    with pytest.raises(ValidationError) as error:
        Shelf.model_validate_json(json.dumps(data))
    return explain(error.value, "shelf.toml", data, Shelf).splitlines()


@pytest.mark.parametrize(
    ("data", "line"),
    [
        ({"box": {"width_m": -1}}, "box.width_m: must be above 0, got -1"),
        ({"depth_m": 80}, "depth_m: must be below 45, got 80"),
        ({"box": {"copies": 0}}, "box.copies: must be at least 1, got 0"),
        ({"box": {"copies": 10}}, "box.copies: must be at most 9, got 10"),
        ({"box": {"copies": 1.5}}, "box.copies: must be a whole number, got 1.5"),
        ({"box": {"width_m": "wide"}}, "box.width_m: must be a number, got 'wide'"),
        ({"box": {"width_m": float("nan")}}, "box.width_m: must be a finite number, got nan"),
        ({"box": {"width_m": float("inf")}}, "box.width_m: must be a finite number, got inf"),
        ({"box": {"label": 3}}, "box.label: must be a string, got 3"),
        ({"box": {"sealed": 1}}, "box.sealed: must be true or false, got 1"),
        ({"box": {"sides": 3}}, "box.sides: must be a list, got 3"),
        ({"box": {"sides": [1.0, "x"]}}, "box.sides[1]: must be a number, got 'x'"),
        ({"box": 3}, "box: must be a table, got 3"),
        ({"box": {"filling": "air"}}, "box.filling: must be a table, got 'air'"),
        ({"box": {"filling": {"kind": "air", "pressure_bar": 0}}}, "box.filling.pressure_bar: must be above 0, got 0"),
        ({"box": {"height_m": 1e-3}}, "box.height_m: too flat; raise it"),
    ],
)
def test_error_message_names_the_key_and_a_remedy(data, line):
    assert [text.replace("0.0", "0").replace("45.0", "45") for text in faults(data)] == [f"shelf.toml: {line}"]


def test_a_misspelt_key_is_reported_with_similar_keys():
    (line,) = faults({"box": {"widht_m": 1}})
    assert line.startswith("shelf.toml: box.widht_m: unknown key; did you mean 'width_m'?")
    assert "height_m" in line


def test_misspelt_key_in_a_union_suggests_keys_of_the_selected_kind():
    (line,) = faults({"box": {"filling": {"kind": "foam", "densty": 0.1}}})
    assert line.startswith("shelf.toml: box.filling.densty: unknown key; did you mean 'density'?")
    assert "pressure_bar" not in line


@pytest.mark.parametrize(
    ("data", "hint"),
    [
        ({"width_m": 1}, "width_m: unknown key; did you mean 'depth_m' or 'box.width_m'?"),
        ({"box": {"depth_m": 1}}, "box.depth_m: unknown key; did you mean 'width_m' or 'depth_m'?"),
        (
            {"box": {"filling": {"kind": "foam", "pressure_bar": 2}}},
            "box.filling.pressure_bar: unknown key; it is a key of kind = 'air'",
        ),
        (
            {"box": {"label": {"copies": 2}}},
            "box.label: must be a string, got {'copies': 2}; did you mean 'box.copies'?",
        ),
    ],
)
def test_suggestions_include_keys_of_other_tables_and_kinds(data, hint):
    (line,) = faults(data)
    assert line.startswith(f"shelf.toml: {hint}")


@pytest.mark.parametrize("filling", [{"kind": "foma"}, {"kind": "foma", "density": 3}])
def test_error_for_an_unknown_kind_lists_the_valid_kinds(filling):
    (line,) = faults({"box": {"filling": filling}})
    said = "shelf.toml: box.filling.kind: unknown kind 'foma'; did you mean 'foam'? (known: air, foam)"
    assert line == f"{said}; a plugin's kind needs --plugin FILE.py and @register"


def test_error_for_an_invalid_choice_lists_the_valid_choices():
    (line,) = faults({"box": {"filling": {"kind": "foam", "colour": "red"}}})
    assert line.startswith("shelf.toml: box.filling.colour: must be one of")
    assert "grey" in line
    assert "black" in line


def test_all_errors_are_reported_at_once():
    lines = faults({"box": {"width_m": -1, "filling": {"kind": "foam", "density": 2}}, "depht_m": 1})
    assert len(lines) == 3
    for key in ("box.width_m", "box.filling.density", "depht_m"):
        assert sum(f" {key}: " in line for line in lines) == 1


def test_error_messages_contain_no_validation_library_jargon():
    words = " ".join(faults({"box": {"filling": 3, "width_m": [1], "copies": "two"}, "depth_m": {}})).lower()
    for jargon in ("input", "validation", "pydantic", "dict", "object", "instance", "https", "discriminator"):
        assert jargon not in words


def test_only_similar_names_are_suggested():
    assert suggestion("figure_eigth", ["circle", "figure_eight"]) == "; did you mean 'figure_eight'?"
    assert suggestion("zebra", ["circle", "figure_eight"]) == ""
    assert suggestion("x", []) == ""


def test_str_of_a_scenario_error_is_its_message():
    assert str(ScenarioError("a: b")) == "a: b"
    assert issubclass(ScenarioError, ValueError)
