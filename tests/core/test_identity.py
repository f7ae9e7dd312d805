"""Identity of a run: its parts that a change affects, and its independence of file locations."""

import json
import sys
from textwrap import dedent

import pytest

from agrobot_mj import load_scenario, run
from agrobot_mj.core import identity as identities
from agrobot_mj.core.identity import Identity, code, read_identity
from agrobot_mj.scenario import plugins
from agrobot_mj.scenario.plugins import load_plugins
from agrobot_mj.simulation.storage import write_log

LAW = """
    from typing import Literal
    from agrobot_mj.control.stanley import Stanley
    class Own(Stanley):
        kind: Literal["{kind}"] = "{kind}"
        gain: float = {gain}
        "Gain of the law [-]."
"""


def differing(one, other):
    """Return the names of the parts in which two run identities differ."""
    return [name for name, a, b in zip(Identity._fields, one, other, strict=True) if a != b]


@pytest.fixture(autouse=True)
def _no_plugins(monkeypatch):
    monkeypatch.setattr(identities, "_plugins", {})
    monkeypatch.setattr(plugins, "_files", {})
    monkeypatch.setattr(sys, "path", list(sys.path))


def test_changed_run_identity_is_attributed_to_scenario_or_files(tmp_path):
    for place, y in (("a", 0), ("b", 0), ("c", 1.5)):
        (tmp_path / place).mkdir()
        (tmp_path / place / "way.csv").write_text(f"x_m,y_m\n0,0\n20,0\n40,{y}\n")
        (tmp_path / place / "s.toml").write_text('duration_s = 3\n[path]\nkind = "waypoints"\nfile = "way.csv"\n')
    first, moved, bent = (load_scenario(tmp_path / place / "s.toml").identity for place in "abc")
    assert first == moved
    assert differing(first, bent) == ["files"]
    longer = load_scenario(tmp_path / "a" / "s.toml", {"duration_s": 4}).identity
    assert differing(first, longer) == ["scenario"]
    assert load_scenario(tmp_path / "a" / "s.toml", {"title": "other"}).identity == first


def test_identity_depends_on_machine_values_and_body_file_content(tmp_path):
    def written(mass, comment=""):
        (tmp_path / "m.toml").write_text(f"# {comment}\n[tractor]\nmass_kg = {mass}\n")
        return load_scenario("straight_line", {"machine": str(tmp_path / "m.toml")}).identity

    first = written(810)
    assert written(810, "same numbers") == first
    assert differing(first, written(811)) == ["scenario"]


def test_edit_that_keeps_file_size_and_time_changes_the_digest(tmp_path):
    import os

    file = tmp_path / "grid.txt"
    file.write_text("1.25")
    first, when = identities.file_digest(file), file.stat().st_mtime_ns
    file.write_text("1.75")
    os.utime(file, ns=(when, when))
    assert identities.file_digest(file) != first


def test_identity_depends_on_modules_imported_by_a_plugin(tmp_path, monkeypatch):
    def loaded(place, kind, gain, constant):
        folder = tmp_path / place
        (folder / f"lib_{place}").mkdir(parents=True)
        (folder / f"lib_{place}" / "__init__.py").write_text("")
        (folder / f"lib_{place}" / "gains.txt").write_text(f"{constant}")
        (folder / f"late_{place}.py").write_text(f"C = {gain}\n")
        text = f"import sys\nsys.path.insert(0, {str(folder)!r})\nimport lib_{place}\n"
        text += f"def later():\n    from late_{place} import C\n    return C\n"
        (folder / "plug.py").write_text(text + dedent(LAW.format(kind=kind, gain=0.7)))
        identities._plugins.clear()
        load_plugins([folder / "plug.py"])
        return sorted(path.name for path in identities._plugins), code()[0]

    names, _ = loaded("one", "own_one", 0.4, 12)
    assert names == ["__init__.py", "gains.txt", "late_one.py", "plug.py"]


def test_identity_depends_on_indirect_imports_of_a_plugin(tmp_path, monkeypatch):
    (tmp_path / "spaced" / "inner").mkdir(parents=True)  # a package without __init__.py
    (tmp_path / "spaced" / "gain.py").write_text("def late():\n    from .inner.deepest import C\n    return C\n")
    (tmp_path / "spaced" / "inner" / "deepest.py").write_text("C = 0.6\n")
    (tmp_path / "by_name.py").write_text("C = 0.4\n")
    text = "import importlib, spaced.gain\nimportlib.import_module('by' + '_name')\n"
    (tmp_path / "plug.py").write_text(text + dedent(LAW.format(kind="own_by_name", gain=0.7)))
    monkeypatch.syspath_prepend(tmp_path)
    identities._plugins.clear()
    load_plugins([tmp_path / "plug.py"])
    assert {path.name for path in identities._plugins} == {"by_name.py", "deepest.py", "gain.py", "plug.py"}


def test_edit_of_any_plugin_file_changes_the_plugin_digest(tmp_path, monkeypatch):
    (tmp_path / "helping.py").write_text("C = 1.0\n")
    (tmp_path / "main_part.py").write_text("import json, numpy, helping\nfrom agrobot_mj.core import spec\n")
    monkeypatch.syspath_prepend(tmp_path)

    def part():
        identities._plugins.clear()
        identities.take_in("main_part")
        return code()[0]

    assert code()[0] == identities.NONE
    first = part()
    assert {path.name for path in identities._plugins} == {"helping.py", "main_part.py"}
    (tmp_path / "helping.py").write_text("C = 1.1\n")
    second = part()
    (tmp_path / "main_part.py").write_text("import helping  # otherwise\n")
    assert len({identities.NONE, first, second, part()}) == 4


def test_identity_depends_on_library_versions(monkeypatch):
    before = load_scenario("circle").identity
    monkeypatch.setattr(identities, "_version", lambda name: "Version: 9.9" if name == "mujoco" else "1")
    identities.libraries.cache_clear()
    try:
        assert differing(before, load_scenario("circle").identity) == ["libraries"]
    finally:
        monkeypatch.undo()
        identities.libraries.cache_clear()
    assert identities._version("mujoco").startswith("Version: ")
    assert identities._version("no-such-library") == "absent"


def test_repeated_run_has_the_same_identity(tmp_path):
    log = run(load_scenario("circle", {"duration_s": 0.5, "plant.kind": "bicycle", "seed": 8}))
    write_log(log, tmp_path / "first")
    said = json.loads((tmp_path / "first" / "metrics.json").read_text())["identity"]
    assert read_identity(said) == log.scenario.identity
    assert (tmp_path / "first" / "scenario.toml").read_text().startswith(f"# identity {said}\n")
    assert run(load_scenario(tmp_path / "first" / "scenario.toml")).metrics["identity"] == said
    assert read_identity("") is read_identity(None) is read_identity("12-34") is None
