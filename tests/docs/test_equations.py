"""Each equation of the paper occurs once in the code at the location listed in docs/equations.md."""

import ast
import re
from pathlib import Path

import agrobot_mj

PACKAGE = Path(agrobot_mj.__file__).parent
TABLE = PACKAGE.parent / "docs" / "equations.md"
TAG = re.compile(r"# \[agrobots: ([A-Za-z0-9_]+)\]")
ROW = re.compile(r"^\| `([A-Za-z0-9_]+)` \| ([^|]+) \| `([A-Za-z0-9_.]+)` \| ([^|]+) \|$")
IN_CODE = {
    *("kinematicmodeltractor", "kinematicmodeltractor2", "lateralforces", "sondenklem"),
    *("inversekinematicmodeltractor2", "tri1i_alt", "Rahib2_5", "Rahib2_6", "eq19"),
    *("16", "16ek", "enyeni1", "fij", "q_q", "chatter"),
    *("kinematicmodelKF", "kinematicmodelEKF", "generalmodelEKF"),
}
"""Labels of the paper's equations that have a line in the code."""
BESIDE = {
    *("lateralmotionoftractor", "yawmotionoftractor", "sideslipangles"),
    *("kinematicmodeltractorcontrol", "inversekinematicmodeltractor", "triangular1", "Rahib2_7", "4"),
    *("alphaa", "lyapunov", "noise"),
    *("kirkyedi", "kirksekiz", "kirkdokuz", "elliiki", "elliuc", "ellidort", "eq48"),
}
"""Labels of the paper's other equations: derivations, general forms, conditions and proofs."""
GUARDED = {"16", "16ek", "enyeni1", "fij", "q_q", "Rahib2_6"}  # Equations that a guard of the network changes


def functions(tree, prefix=""):
    """Yield first line, last line and qualified name of every function. Inner functions follow their outer function."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            name = f"{prefix}{node.name}"
            if isinstance(node, ast.FunctionDef):
                yield node.lineno, node.end_lineno, name
            yield from functions(node, f"{name}.")


def tags_of(file):
    """Yield tag and `module.function` of every equation tag in a file."""
    text = file.read_text(encoding="utf-8")
    module = ".".join(file.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")
    places = list(functions(ast.parse(text)))
    for number, line in enumerate(text.splitlines(), start=1):
        for tag in TAG.findall(line):
            inside = [name for first, last, name in places if first <= number <= last]
            yield tag, f"{module}.{inside[-1]}" if inside else module


def in_code():
    return [found for file in sorted(PACKAGE.rglob("*.py")) for found in tags_of(file)]


def in_table():
    return [match.groups() for match in map(ROW.match, TABLE.read_text(encoding="utf-8").splitlines()) if match]


def beside_the_table():
    """Return the labels of the second table, whose equations have no separate line."""
    below = TABLE.read_text(encoding="utf-8").partition("## Equations without a separate line")[2]
    rows = [line.split("|")[1] for line in below.splitlines() if line.startswith("| `")]
    return re.findall(r"`([A-Za-z0-9_]+)`", " ".join(rows))


def test_every_equation_tag_occurs_exactly_once_in_the_code():
    assert sorted(tag for tag, _ in in_code()) == sorted(IN_CODE)


def test_paper_equations_without_code_are_listed_below_the_table():
    assert sorted(beside_the_table()) == sorted(BESIDE)


def test_every_equation_tag_is_a_comment_on_a_line_of_code():
    for file in PACKAGE.rglob("*.py"):
        for line in file.read_text(encoding="utf-8").splitlines():
            if "agrobots:" in line:
                assert TAG.search(line), f"{file.name}: {line.strip()}"
                assert line.split("#")[0].strip(), f"{file.name}: {line.strip()}"


def test_equation_table_lists_the_code_location_of_every_tag():
    assert {tag: place for tag, _, place, _ in in_table()} == dict(in_code())


def test_equation_table_lists_each_tag_once_with_a_description():
    rows = in_table()
    assert len({row[0] for row in rows}) == len(rows)
    assert all(len(what.split()) >= 3 for _, what, _, _ in rows)


def test_equation_table_states_each_deviation_of_the_code_from_the_paper():
    deviations = {tag: deviation for tag, _, _, deviation in in_table()}
    assert all(deviation == "none" or len(deviation.split()) >= 2 for deviation in deviations.values())
    assert {tag for tag in GUARDED if deviations[tag] == "none"} == set()
