"""Imports follow the layers of the package, and each heavy library is imported only by permitted folders.

A folder imports only from folders of lower layers.
"""

import ast
import re
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

import agrobot_mj
from agrobot_mj.core.kernel_cache import MAKES_KERNELS, PARTS
from agrobot_mj.core.resources import entry_points_of

PACKAGE = Path(agrobot_mj.__file__).parent
LAYERS = [
    *("core", "machine", "terrain", "tyres", "plants"),
    *("sensors", "estimation", "paths", "control", "faults"),
    *("metrics", "scenario", "simulation", "recording", "studies", "cli", "extensions"),
]
"""Folders of the package, from the lowest to the highest layer."""
STAGES = ["sensors", "estimation", "paths", "control", "faults"]
"""Control components of a tick. They import neither each other nor ground, tyres and plants."""
EXTENSIONS = sorted(path.name for path in (PACKAGE / "extensions").iterdir() if (path / "__init__.py").is_file())
OWNERS = {
    "mujoco": {"plants", "extensions"},
    "llvmlite": {"core", "plants"},
    "filterpy": {"estimation"},
    "rerun": {"recording"},
    "PIL": {"terrain", "recording"},
    "matplotlib": {"studies", "extensions"},
    "typer": {"cli", "extensions"},
    "tomli_w": {"scenario", "studies", "extensions"},
    "plotly": {"studies"},
    "distributed": {"studies"},
    "numba": {"core", "plants"},
}
"""Libraries that only these folders import."""


def part_of(file):
    return file.relative_to(PACKAGE).with_suffix("").parts[0]


@cache
def parsed(file):
    """Return the syntax tree of a file."""
    return ast.parse(file.read_text(encoding="utf-8"))


@cache
def imported(file):
    """Return the full names of everything that a file imports."""
    names = []
    for node in ast.walk(parsed(file)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "required":  # a library of an extra
            names += [given.value for given in node.args[:1] if isinstance(given, ast.Constant)]
    return tuple(names)


def parts_imported(part):
    """Return the other parts of the package that `part` imports, each with an importing file."""
    found = {}
    for file in files_of(part):
        for name in imported(file):
            first, *rest = name.split(".")
            if first == "agrobot_mj" and rest and rest[0] != part:
                found[rest[0]] = str(file.relative_to(PACKAGE))
    return found


def files_of(part):
    module = PACKAGE / f"{part}.py"
    return [module] if module.is_file() else sorted((PACKAGE / part).rglob("*.py"))


def test_package_contains_exactly_the_documented_folders():
    parts = {part_of(file) for file in PACKAGE.rglob("*.py")} - {"__init__", "__main__"}
    assert parts == set(LAYERS)
    assert len([entry for entry in PACKAGE.iterdir() if entry.name != "__pycache__"]) <= 22


@pytest.mark.parametrize("name", EXTENSIONS)
def test_extensions_do_not_import_each_other(name):
    own = f"agrobot_mj.extensions.{name}"
    for file in (PACKAGE / "extensions" / name).rglob("*.py"):
        others = [each for each in imported(file) if each.startswith("agrobot_mj.extensions.")]
        assert [each for each in others if not f"{each}.".startswith(f"{own}.")] == [], file


def test_core_code_does_not_mention_kinds_defined_in_extensions():
    import_module("agrobot_mj.scenario")  # loads the kinds; one that is imported first would import itself
    entries = [entry for entry in entry_points_of("plugins") if entry.module.startswith("agrobot_mj.extensions.")]
    kinds = [kind.model_fields["kind"].default for entry in entries for kind in entry.load()]
    assert "learned_feedforward" in kinds or "learners" not in EXTENSIONS
    core = [file for part in LAYERS[:-1] for file in files_of(part)]
    named = {
        (file.name, kind) for file in core for kind in kinds if re.search(f"[\"'`]{kind}\\b", file.read_text("utf-8"))
    }
    assert named == set()


@pytest.mark.parametrize("part", LAYERS)
def test_each_folder_imports_only_from_folders_listed_before_it(part):
    allowed = {"core", "machine"} if part in STAGES else set(LAYERS[: LAYERS.index(part)])
    above = {name: file for name, file in parts_imported(part).items() if name not in allowed}
    assert not above


def test_controllers_import_neither_true_state_nor_simulator_modules():
    for part in ("control", "estimation"):
        for file in files_of(part):
            assert not {name for name in imported(file) if name.endswith(".Truth")}, file


@pytest.mark.parametrize("library", OWNERS)
def test_each_heavy_library_is_imported_only_by_permitted_packages(library):
    users = {part_of(file) for file in PACKAGE.rglob("*.py") if library in {n.split(".")[0] for n in imported(file)}}
    assert users
    assert users <= OWNERS[library]


def test_no_two_public_classes_share_a_name():
    places = {}
    for file in PACKAGE.rglob("*.py"):
        for node in parsed(file).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(str(file.relative_to(PACKAGE)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def test_every_module_has_a_docstring():
    for file in PACKAGE.rglob("*.py"):
        assert ast.get_docstring(parsed(file)), file


def test_kernel_cache_key_depends_on_all_files_with_kernels():
    compilers = {"agrobot_mj.core.kernels.jit", "agrobot_mj.core.kernels.kernel"}
    makers = {part: [file for file in files_of(part) if compilers & set(imported(file))] for part in LAYERS}
    assert {"core", "machine", "terrain", "tyres", "plants"} <= set(PARTS)
    assert any(makers.values())
    for part, files in makers.items():
        for file in files if part not in PARTS else []:
            assert MAKES_KERNELS in file.read_bytes(), file


def test_names_that_scripts_import_from_the_package_exist():
    """Scripts are not type-checked. Imports from a removed extension are omitted."""
    missing = []
    for file in (PACKAGE.parent / "scripts").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            parts = node.module.split(".") if isinstance(node, ast.ImportFrom) and node.module else [""]
            if parts[0] != PACKAGE.name or (parts[1:2] == ["extensions"] and parts[2] not in EXTENSIONS):
                continue
            module = import_module(node.module)
            names = [each.name for each in node.names if not hasattr(module, each.name)]
            missing += [f"{file.name}: {node.module}.{name}" for name in names]
    assert missing == []
