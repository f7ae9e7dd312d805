"""Imports point one way, and each heavy library has one owner.

The parts of the package (its modules and subpackages) stand in layers; a part imports only from layers before its own.
"""

import ast
from pathlib import Path

import pytest

import agrobot_mj
from agrobot_mj.compiled import PARTS

PACKAGE = Path(agrobot_mj.__file__).parent
BASE = [
    *("signals", "geometry", "spec", "compiled", "resources", "datafile"),
    *("randomness", "problems", "tractor", "edits"),
]
"""What every stage may use."""
MACHINE = ["terrain", "hydraulics", "driveline", "tyres", "plants"]
"""The physical stages in the order in which they build on each other."""
GUIDANCE = ["sensors", "estimation", "paths", "control", "faults"]
"""The stages on the computer, and what befalls them: none of them knows another, nor the machine."""
AFTER = [
    *("outcomes", "scenario", "log", "crosstrack", "passes", "metrics"),
    *("simulate", "storage", "recording", "report", "progress"),
    *("compare", "rig", "identify", "validation", "cli"),
]
"""What builds on the stages, in order; `metrics` and `report` know of the log only by protocols."""
ALL = [*BASE, *MACHINE, *GUIDANCE, *AFTER]
OWNERS = {
    "mujoco": {"plants", "rig", "validation"},
    "llvmlite": {"plants"},
    "filterpy": {"estimation"},
    "rerun": {"recording"},
    "PIL": {"terrain"},
    "matplotlib": {"report", "rig", "validation"},
    "typer": {"cli"},
    "tomli_w": {"scenario"},
    "numba": {"compiled", "plants"},
}
"""Libraries that only these parts import."""


def part_of(file):
    return file.relative_to(PACKAGE).with_suffix("").parts[0]


def imported(file):
    """Full names of everything that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def parts_imported(part):
    """The other parts that `part` imports, with the file that does."""
    found = {}
    for file in files_of(part):
        for name in imported(file):
            first, *rest = name.split(".")
            if first == "agrobot_mj" and rest and rest[0] not in (part, "__version__"):
                found[rest[0]] = str(file.relative_to(PACKAGE))
    return found


def files_of(part):
    module = PACKAGE / f"{part}.py"
    return [module] if module.is_file() else sorted((PACKAGE / part).rglob("*.py"))


def before(part, order):
    return set(order[: order.index(part)])


def test_every_part_has_its_layer():
    parts = {part_of(file) for file in PACKAGE.rglob("*.py")} - {"__init__", "__main__"}
    assert parts <= set(ALL)


@pytest.mark.parametrize("part", BASE)
def test_the_base_builds_on_itself_alone(part):
    assert set(parts_imported(part)) <= before(part, BASE)


@pytest.mark.parametrize("part", [part for part in MACHINE if files_of(part)])
def test_the_machine_builds_on_the_base_and_on_what_is_below(part):
    assert set(parts_imported(part)) <= set(BASE) | before(part, MACHINE)


@pytest.mark.parametrize("part", GUIDANCE)
def test_stages_of_the_guidance_build_on_the_base_alone(part):
    assert set(parts_imported(part)) <= set(BASE)


@pytest.mark.parametrize("part", AFTER)
def test_the_rest_builds_on_what_comes_before(part):
    assert set(parts_imported(part)) <= {*BASE, *MACHINE, *GUIDANCE} | before(part, AFTER)


def test_controllers_see_neither_truth_nor_simulator():
    for part in ("control", "estimation"):
        for file in files_of(part):
            assert not {name for name in imported(file) if name.endswith(".Truth")}, file


@pytest.mark.parametrize("library", OWNERS)
def test_each_heavy_library_has_its_owners(library):
    users = {part_of(file) for file in PACKAGE.rglob("*.py") if library in {n.split(".")[0] for n in imported(file)}}
    assert users
    assert users <= OWNERS[library]


def test_files_stay_short():
    sizes = {file: len(file.read_text(encoding="utf-8").splitlines()) for file in PACKAGE.rglob("*.py")}
    assert max(sizes.values()) < 360, max(sizes, key=sizes.get)


def test_every_module_says_what_it_is():
    for file in PACKAGE.rglob("*.py"):
        assert ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))), file


def test_the_cache_of_kernels_knows_every_part_that_they_come_from():
    compilers = {"agrobot_mj.compiled.jit", "agrobot_mj.compiled.kernel"}
    kernels = {part for part in ALL if any(compilers & set(imported(file)) for file in files_of(part))}
    assert kernels
    assert kernels <= set(PARTS)
    stages = {part for part in ALL if part in (*MACHINE, "signals", "geometry", "tractor")}
    assert stages <= set(PARTS)
