"""Files of a user-defined body: all files that MuJoCo opens are checked, hashed and copied."""

from pathlib import Path

import mujoco
import pytest

from agrobot_mj import load_scenario
from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.plants.mujoco.own_files import own_files
from agrobot_mj.scenario.overrides import files, relocate_files

TEMPLATE = Path(__file__).parents[2] / "examples" / "own_body.xml"
WEDGE = "v 0 0 0\nv 0.6 0 0\nv 0 0.4 0\nv 0 0 0.3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
INCLUDE = '<include xmlns="urn:any" file="{}"/>'
ATTACH = '<frame pos="0.4 0 1.1"><attach model="{0}" body="{0}" prefix="{0}_"/></frame>'
CHASSIS = '<geom name="hood_contact"'


def mesh(name):
    return f'<asset><mesh name="{name}" file="{name}.obj"/></asset>'


def model(name, more="", inside=""):
    """Return a model with one body, which has a mesh."""
    body = f'<body name="{name}"><geom type="mesh" mesh="{name}" mass="2"/>{inside}</body>'
    return f'<mujoco model="{name}">{more}{mesh(name)}<worldbody>{body}</worldbody></mujoco>'


def write(folder, assets="", on_chassis="", **others):
    """Write the template with additional assets, parts on its chassis and files. Return its path."""
    text = TEMPLATE.read_text(encoding="utf-8")
    text = text.replace("<worldbody>", f"{assets}<worldbody>", 1).replace(CHASSIS, f"{on_chassis}{CHASSIS}", 1)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "mine.xml").write_text(text, encoding="utf-8")
    for name, content in others.items():
        (folder / name.replace("__", ".")).write_text(content, encoding="utf-8")
    return folder / "mine.xml"


def layered(folder):
    """Write a body with an included file, an attached file, and nested attached and included files."""
    rack = model("rack", INCLUDE.format("more.xml") + '<asset><model name="lamp" file="lamp.xml"/></asset>')
    rack = rack.replace("</body>", ATTACH.format("lamp") + "</body>")
    return write(
        folder,
        INCLUDE.format("parts.xml"),
        ATTACH.format("rack"),
        parts__xml='<mujocoinclude><asset><model name="rack" file="rack.xml"/></asset></mujocoinclude>',
        more__xml=f"<mujocoinclude>{mesh('crate')}</mujocoinclude>",
        rack__xml=rack,
        lamp__xml=model("lamp"),
        **{f"{name}__obj": WEDGE for name in ("rack", "lamp", "crate")},
    )


def test_files_of_a_body_equal_the_dependencies_listed_by_mujoco(tmp_path):
    main, others = own_files(str(layered(tmp_path / "body")))
    assert {main, *others} == {main.parent / name for name in mujoco.mju_getXMLDependencies(str(main))}
    assert len(others) == 7


def test_moved_results_folder_with_body_files_can_be_run_again(tmp_path, call, monkeypatch):
    body = layered(tmp_path / "there" / "body")
    (tmp_path / "there" / "machine.toml").write_text('[tractor]\nmjcf = "body/mine.xml"\n', encoding="utf-8")
    text = 'machine = "machine.toml"\nduration_s = 0.3\n[path]\nkind = "line"\n'
    (tmp_path / "there" / "s.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert call("run", "there/s.toml", "--no-rrd", "--out", "first")[0] == 0
    assert {path.name for path in body.parent.iterdir()} | {"machine.toml"} <= {p.name for p in Path("first").iterdir()}
    (tmp_path / "there").rename(tmp_path / "gone")
    Path("first").rename("moved")
    status, _, told = call("run", "moved/scenario.toml", "--no-rrd", "--out", "second")
    assert status == 0, told
    assert Path("second/signals.parquet").read_bytes() == Path("moved/signals.parquet").read_bytes()


def test_list_of_scenario_files_contains_machine_file_and_body_files(tmp_path):
    body = layered(tmp_path)
    machine = tmp_path / "machine.toml"
    machine.write_text('[tractor]\nmjcf = "mine.xml"\nmachine = "./machine.toml"\n', encoding="utf-8")
    found = files({"machine": str(machine), "path": {"kind": "waypoints", "file": "/x/way.csv"}})
    assert set(found) == {machine, body, *own_files(str(body)).others, Path("/x/way.csv")}
    assert len(found) == len(set(found))


def test_change_of_an_indirectly_included_body_file_changes_the_hash(tmp_path):
    scenario = load_scenario("straight_line", {"tractor.mjcf": str(layered(tmp_path)), "duration_s": 1.0})
    before = scenario.hash8
    (tmp_path / "lamp.obj").write_text(WEDGE.replace("0.6", "0.7"), encoding="utf-8")
    assert scenario.hash8 != before


def test_two_bodies_with_different_files_of_the_same_name_are_rejected(tmp_path):
    bodies = [write(tmp_path / side, mesh("crate"), crate__obj=WEDGE) for side in ("left", "right")]
    data = [{"mjcf": str(body)} for body in bodies]
    with pytest.raises(ScenarioError, match=r"right.crate\.obj: has the same name as .*left.crate\.obj.*rename one"):
        relocate_files(data)


def test_data_file_with_the_name_of_a_body_file_is_renamed(tmp_path):
    body = write(tmp_path / "body", mesh("crate"), crate__obj=WEDGE)
    data = {"a": {"file": "/elsewhere/crate.obj"}, "tractor": {"mjcf": str(body)}}
    assert relocate_files(data)["crate.obj"] == body.parent / "crate.obj"
    assert data == {"a": {"file": "crate-2.obj"}, "tractor": {"mjcf": "mine.xml"}}


REFUSED = {
    "absolute path in an include": (
        INCLUDE.format("inc.xml"),
        {"inc__xml": '<mujocoinclude><asset><mesh name="a" file="/srv/a.obj"/></asset></mujocoinclude>'},
        "'/srv/a.obj': must be in the folder of the body",
    ),
    "folder of an attached model": (
        '<asset><model name="rack" file="rack.xml"/></asset>',
        {"rack__xml": model("rack", '<compiler assetdir="/srv"/>'), "rack__obj": WEDGE},
        "<compiler assetdir>: all files must be next to the body",
    ),
    "path of an attached model": ('<asset><model file="sub/rack.xml"/></asset>', {}, "'sub/rack.xml': must be in"),
    "attached model without its mesh": (
        '<asset><model file="rack.xml"/></asset>',
        {"rack__xml": model("rack")},
        "rack.obj: no such file",
    ),
    "model that attaches itself": (
        '<asset><model file="rack.xml"/></asset>',
        {"rack__xml": model("rack", '<asset><model file="rack.xml"/></asset>'), "rack__obj": WEDGE},
        "rack.xml: the file includes or attaches itself",
    ),
    "plugin in an attached model": (
        '<asset><model file="rack.xml"/></asset>',
        {"rack__xml": model("rack", '<extension><plugin plugin="p"/></extension>'), "rack__obj": WEDGE},
        "<plugin>: plugins are not supported in a body",
    ),
    "too large a texture": (
        '<asset><texture name="t" type="2d" builtin="flat" width="60000" height="60000"/></asset>',
        {},
        "<texture width>: must be at most 5000",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_invalid_body_files_are_rejected_with_the_reason(case, tmp_path):
    assets, others, expected = REFUSED[case]
    with pytest.raises(ScenarioError) as error:
        load_scenario("straight_line", {"tractor.mjcf": str(write(tmp_path, assets, **others))})
    assert expected in str(error.value)
    assert all("tractor.mjcf: " in line for line in str(error.value).split("\n"))


def test_body_element_limit_includes_replicates_and_attached_models(tmp_path):
    nested = '<replicate count="70">' * 3 + '<site size="0.01"/>' + "</replicate>" * 3
    many = '<replicate count="90">' + ATTACH.format("rack") + "</replicate>"
    sites = 300 * '<site size="0.01"/>'
    rack = '<asset><model name="rack" file="rack.xml"/></asset>'
    for on_chassis, assets, others in (
        (nested, "", {}),
        (many, rack, {"rack__xml": model("rack", inside=sites), "rack__obj": WEDGE}),
    ):
        with pytest.raises(ValueError, match="more than 20000 elements with replicates and attached models"):
            own_files(str(write(tmp_path, assets, on_chassis, **others)))


def test_body_files_in_every_declared_xml_encoding_are_read(tmp_path):
    text = '<?xml version="1.0" encoding="utf-16"?><mujoco><compiler meshdir="/srv"/></mujoco>'
    (tmp_path / "mine.xml").write_bytes(text.encode("utf-16"))
    with pytest.raises(ValueError, match="<compiler meshdir>"):
        own_files(str(tmp_path / "mine.xml"))


def test_xml_comment_that_mentions_a_doctype_is_accepted(tmp_path):
    body = write(tmp_path, "<!-- no <!DOCTYPE here -->")
    assert own_files(str(body)).others == ()
