"""Schema information on the command line: keys, kinds, the JSON schema and the scenario template."""

import json
import re
import tomllib

import pytest

from agrobot_mj.control import Controller
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.spec import members
from agrobot_mj.core.walk import keys
from agrobot_mj.faults import Fault
from agrobot_mj.faults.line import LineFault
from agrobot_mj.metrics import METRICS
from agrobot_mj.scenario.loading import load_scenario, scenario_files
from agrobot_mj.scenario.reference import explain_key, families, json_schema, kinds_text, known_kinds
from agrobot_mj.scenario.schema import Scenario, resolve
from agrobot_mj.scenario.template import write_template
from agrobot_mj.sensors import Sensors
from agrobot_mj.tyres import Tyre

SCHEMA = json_schema()
TYPES = {
    "number": (int, float),
    "integer": int,
    "string": str,
    "boolean": bool,
    "array": list,
    "object": dict,
    "null": type(None),
}


def conforms(value, schema):
    """Return whether a value conforms to the JSON schema; only the keywords used in the schema are supported."""
    if "$ref" in schema and not conforms(value, SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]]):
        return False
    for word, count in (("oneOf", lambda n: n == 1), ("anyOf", lambda n: n > 0)):
        if word in schema and not count(sum(conforms(value, option) for option in schema[word])):
            return False
    kind = schema.get("type")
    if kind and (not isinstance(value, TYPES[kind]) or (isinstance(value, bool) and kind in ("number", "integer"))):
        return False
    if "const" in schema and value != schema["const"]:
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    if isinstance(value, int | float):
        if not (schema.get("minimum", -1e99) <= value <= schema.get("maximum", 1e99)):
            return False
        if not (schema.get("exclusiveMinimum", -1e99) < value < schema.get("exclusiveMaximum", 1e99)):
            return False
    if isinstance(value, list):
        return all(conforms(item, schema.get("items", {})) for item in value)
    if isinstance(value, dict):
        known = schema.get("properties", {})
        if not set(schema.get("required", ())) <= set(value):
            return False
        if schema.get("additionalProperties") is False and not set(value) <= set(known):
            return False
        return all(conforms(item, known[key]) for key, item in value.items() if key in known)
    return True


# --- JSON schema --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", scenario_files())
def test_every_shipped_scenario_conforms_to_the_json_schema(name):
    assert conforms(tomllib.loads(scenario_files()[name].read_text(encoding="utf-8")), SCHEMA)
    assert conforms(json.loads(json.dumps(tomllib.loads(load_scenario(name).to_toml()))), SCHEMA)


@pytest.mark.parametrize(
    "text",
    [
        "sead = 1",
        "seed = -1",
        "seed = true",
        "seed = 'one'",
        "physics_dt_s = 1.0",
        "[terrain]\nkind = 'hill'",
        "[terrain]\nkind = 'slope'\ngrade_deg = 80",
        "[terrain]\ngrade_deg = 8",
        "[plant.tyre]\nkind = 'linear'\nrelaxation_radi = 1.0",
        "[[fault]]\nstart_s = 3",
    ],
)
def test_json_schema_rejects_scenarios_that_loading_rejects(text):
    data = tomllib.loads(text)
    assert not conforms(data, SCHEMA)
    with pytest.raises(ScenarioError):
        resolve(data, "mine.toml")


def test_the_json_schema_has_descriptions_and_no_generated_titles():
    text = json.dumps(SCHEMA)
    assert '"title": "Wheelbase M"' not in text
    assert SCHEMA["$defs"]["TractorParameters"]["properties"]["wheelbase_m"]["description"]
    assert "title" in SCHEMA["properties"], "the key of that name stays"


# --- kinds and keys -----------------------------------------------------------------------------------------------


def test_plugin_families_equal_the_unions_of_the_schema():
    found = families()
    assert found["plant.tyre"] == members(Tyre)
    assert found["controller"] == members(Controller)
    assert found["fault"] == members(Fault)
    assert {"plant", "terrain", "terrain.patch", "path", "estimator"} <= set(found)


def test_list_of_kinds_has_one_line_per_kind():
    lines = kinds_text().splitlines()
    own = {(kind, part) for kinds in families().values() for kind, part in kinds.items()}
    assert len(lines) == len(own) + len(Sensors.model_fields) + len(METRICS)
    (soil,) = [line for line in lines if line.startswith("plant.tyre ") and line.split()[1] == "soil"]
    assert soil.endswith(members(Tyre)["soil"].__doc__.splitlines()[0])


def test_description_of_each_signal_fault_names_its_signal():
    told = {kind.kind: kind.text for kind in known_kinds() if kind.table == "fault"}
    lines = [kind for kind, part in members(Fault).items() if issubclass(part, LineFault)]
    assert len({told[kind] for kind in lines}) == len(lines) == 34
    assert told["imu_pitch_loss"].startswith("Missing pitch of the inertial unit")
    assert told["gnss_float"].endswith("a weak correction signal.")


ALL_KEYS = list(dict.fromkeys(key.dotted for key in keys(Scenario)))


def test_every_key_can_be_explained():
    assert len(ALL_KEYS) > 250
    for key in ALL_KEYS:
        assert explain_key(key).splitlines()[0] == key


def test_explanation_of_a_key_has_unit_range_default_source_and_kinds():
    text = explain_key("plant.tyre.relaxation_radii")
    assert re.search(r"^  unit +-$", text, re.M)
    assert re.search(r"^  value +number, above 0", text, re.M)
    assert re.search(r"^  source +Assumed", text, re.M)
    kinds = [kind for kind, part in members(Tyre).items() if "relaxation_radii" in part.model_fields]
    assert 0 < len(kinds) < len(members(Tyre))
    for kind in kinds:
        assert re.search(rf"^  with +plant\.tyre\.kind = .*\b{kind}\b", text, re.M)


def test_explanation_of_a_key_lists_its_default_for_each_kind():
    text = explain_key("terrain.grade_deg")
    defaults = {str(part().grade_deg) for part in families()["terrain"].values() if "grade_deg" in part.model_fields}
    assert len(defaults) > 1
    assert set(re.findall(r"^  default +(\S+)$", text, re.M)) == defaults


KEYS = {key.dotted for key in keys(Scenario)}
KINDS = [row for row in known_kinds() if f"{row.table}.{row.kind}" not in KEYS]


@pytest.mark.parametrize("row", KINDS, ids=lambda row: f"{row.table}.{row.kind}")
def test_explain_command_accepts_the_name_of_every_listed_kind(row):
    text = explain_key(f"{row.table}.{row.kind}")
    assert text.splitlines()[0] in (f"{row.table}.kind = {row.kind}", f"metric {row.kind}")
    assert row.text in text


def test_keys_of_one_kind_can_be_explained_by_table_and_kind():
    of_kind = explain_key("fault.gnss_jump.north_m")
    assert of_kind.splitlines()[0] == "fault.north_m"
    assert "fault.kind = gnss_jump" in of_kind
    assert "Cone index" in explain_key("plant.tyre.soil.cone_index_kpa")
    assert explain_key("plant.mujoco.tyre.soil") == explain_key("plant.tyre.soil")
    straight, arc = explain_key("path.piece.straight"), explain_key("path.piece.arc")
    assert "radius_m" in arc
    assert "radius_m" not in straight
    for wrong in ("path.piece.straight.radius_m", "path.piece.no_kind", "fault.gnss_jump.no_key", "metric.no_metric"):
        with pytest.raises(ScenarioError, match="unknown key"):
            explain_key(wrong)


def test_tables_kinds_lists_and_the_whole_scenario_can_be_explained():
    assert "* figure_eight" in explain_key("path")
    assert "* figure_eight" in explain_key("path.kind")
    assert "wheelbase_m" in explain_key("tractor")
    assert explain_key("fault.0.start_s") == explain_key("fault.start_s") == explain_key("fault[3].start_s")
    whole = explain_key("")
    assert all(re.search(rf"^  {key} ", whole, re.M) for key in Scenario.model_fields)


@pytest.mark.parametrize(
    ("key", "near"),
    [
        ("plant.tyre.relaxation_radi", "'plant.tyre.relaxation_radii'"),
        ("path.speed", "'path.speed_m_s'"),
        ("tractor.wheelbase", "'tractor.wheelbase_m'"),
        ("seed.x", "'seed'"),
        ("terrain..", "'terrain'"),
        ("qqqq", "`agrobot-mj explain` lists the tables"),
        (".", "`agrobot-mj explain` lists the tables"),
        ("0", "`agrobot-mj explain` lists the tables"),
        ("[3].1", "`agrobot-mj explain` lists the tables"),
    ],
)
def test_error_for_an_unknown_key_suggests_similar_keys(key, near):
    with pytest.raises(ScenarioError, match=f"^{re.escape(key)}: unknown key") as error:
        explain_key(key)
    assert near in str(error.value)


# --- a file to start from -----------------------------------------------------------------------------------------


def test_scenario_template_equals_the_default_scenario(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write_template("my field")
    text = path.read_text(encoding="utf-8")
    assert path.name == "my field.toml"
    scenario = load_scenario(path)
    assert scenario == Scenario().changed({"name": "my field", "title": "my field"})
    assert all(f"#   {kind} " in text for table in ("path", "plant.tyre", "fault") for kind in families()[table])


def test_every_commented_key_of_the_template_can_be_uncommented(tmp_path):
    """With all keys uncommented, the file states every default and gives the same scenario."""
    text = write_template(str(tmp_path / "mine")).read_text(encoding="utf-8")
    keys = re.sub(r"^# (\w+ = .+)$", r"\1", text.partition("# [[fault]]")[0], flags=re.M)
    assert keys.count("\n# ") < text.count("\n# ") - 30
    (tmp_path / "full.toml").write_text(keys, encoding="utf-8")
    full = load_scenario(tmp_path / "full.toml", {"name": "mine"})
    assert full == load_scenario(tmp_path / "mine.toml")


def test_existing_file_is_not_overwritten_by_the_template(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("seed = 4")
    for name in ("mine", "mine.toml"):
        with pytest.raises(ScenarioError, match=r"^mine\.toml: the file already exists"):
            write_template(name)
    assert (tmp_path / "mine.toml").read_text() == "seed = 4"


@pytest.mark.parametrize("name", ["", ".", "..", ".toml", "x/.toml"])
def test_invalid_template_name_is_rejected(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ScenarioError, match="not a valid name"):
        write_template(name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ['a"b', "a\nb", "ümlaut", "a'''b", "a\\b", "\x07"])
def test_template_with_special_characters_in_its_name_is_valid(name, tmp_path):
    assert load_scenario(write_template(str(tmp_path / name))).seed == 1


def test_excessively_long_key_is_shortened_in_the_error_message():
    with pytest.raises(ScenarioError, match="unknown key") as error:
        explain_key("a." * 100_000)
    assert len(str(error.value)) < 400
