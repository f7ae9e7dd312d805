"""Mutation test, which checks that a test fails when the source is changed in one place.

    python tests/mutate.py [--seed 1] [--count N] [--only GROUP,...] [--out runs/mutants]

Mutants are those of cosmic-ray, and exchanges of names (left and right, x and y), which tests often missed. A sample is
drawn from each group of modules in tests/mutants.toml, which also names the tests of each module. The tests run in a
copy of the tree, first without a mutant. Kernels run as plain Python, because compilation takes a minute. A mutant is
killed if a test fails or takes ten times as long. Mutants that only introduce an undefined name do not count. An
interrupted test continues with the same `--out`.
"""

import argparse
import json
import random
import re
import shlex
import shutil
import subprocess
import time
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator, operator_names
from cosmic_ray.testing import run_tests
from cosmic_ray.work_item import TestOutcome

ROOT = Path(__file__).parents[1]
PARTS = ("agrobot_mj", "models", "scenarios", "tests", "docs", "scripts", "examples", "pyproject.toml", "README.md")
CHANGES = re.compile(
    r"core/(NumberReplacer|AddNot|ZeroIterationForLoop|Replace("
    r"TrueWithFalse|FalseWithTrue|AndWithOr|OrWithAnd|UnaryOperator_USub_UAdd|UnaryOperator_Delete_Not|"
    r"BinaryOperator_(Add_Sub|Sub_Add|Mul_Div|Div_Mul|Pow_Mul|FloorDiv_Mul|Mod_Mul)|"
    r"ComparisonOperator_(Lt_GtE|LtE_Gt|Gt_LtE|GtE_Lt|Eq_NotEq|NotEq_Eq|Is_IsNot|IsNot_Is)))"
)
"""Operators of cosmic-ray in use. Other operators have no effect if both sides are equal, or change only types."""
PAIRS = """
    min max, sin cos, tan sin, degrees radians, searchsorted_left searchsorted_right, area length, width radius, x y,
    vx vy, fl fr, rl rr, rear_x rear_y, east north, left right, front rear, ahead left, upper lower, l_f l_r, C_f C_r,
    A11 A22, A12 A21, B1 B2, gain_left gain_right, steer pedal, steer_voltage pedal_voltage, speed lateral_speed,
    longitudinal lateral, yaw roll, roll pitch
"""
NAMES = dict(pair.split()[::order] for order in (-1, 1) for pair in PAIRS.split(","))
"""Names in the source code, and the names with which a mutant exchanges them."""


class Exchange(Operator):
    """Operator that replaces a name wherever the name is read."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        read = node.type == "name" and node.value in NAMES and not node.is_definition(include_setitem=True)
        if read and not (node.parent.type == "argument" and node.parent.children[0] is node):
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        node.value = NAMES[node.value]
        return node

    @classmethod
    def examples(cls) -> tuple[()]:
        return ()


class Mutant(NamedTuple):
    """Mutant: version of a module that is changed in one place."""

    module: str
    tests: str
    what: str  # description of the change
    source: str
    name: str = ""


def drawn(group: dict[str, Any], seed: str, count: int | None) -> Iterator[Mutant]:
    """Yield a sample of the mutants of a group, in the order of the modules."""
    tests = {module: tests for modules, tests in group.items() if modules != "count" for module in modules.split()}
    operators = [Exchange(), *(get_operator(name)() for name in operator_names() if CHANGES.fullmatch(name))]
    places = []
    for module in tests:
        nodes = list(ast_nodes(get_ast(read(module))))
        for operator in operators:
            found = ((node, start) for node in nodes for start, _ in operator.mutation_positions(node))
            places += [(module, operator, k, start) for k, (node, start) in enumerate(found) if behaves(node)]
    for at in sorted(random.Random(seed).sample(range(len(places)), min(count or group["count"], len(places)))):
        module, operator, k, (line, column) = places[at]
        changed = mutate_code(read(module), operator, k)
        words = read(module).splitlines()[line - 1].strip(), changed.splitlines()[line - 1].strip()
        name = changed.splitlines()[line - 1][column:] if isinstance(operator, Exchange) else ""
        yield Mutant(module, tests[module], f"{line}: {words[0]} -> {words[1]}", changed, re.match(r"\w*", name)[0])


def behaves(node: Any) -> bool:
    """Return whether a node is in a function, but not in a default value, an annotation or a message."""
    if not node.search_ancestor("funcdef", "lambdef"):
        return False
    return not node.search_ancestor("param", "annassign", "raise_stmt", "fstring", "assert_stmt")


def named(entries: list[dict[str, str]]) -> Iterator[Mutant]:
    """Yield the mutants that tests/mutants.toml defines by name."""
    for entry in entries:
        source = read(entry["module"])
        yield Mutant(entry["module"], entry["tests"], entry["what"], source.replace(entry["before"], entry["after"]))


@cache
def read(module: str) -> str:
    return (ROOT / "agrobot_mj" / module).read_text(encoding="utf-8")


class Bench:
    """Copy of the source tree in which mutants are tested one after another."""

    def __init__(self, tree: Path) -> None:
        self.tree, self.usual = tree, {}
        names = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", *PARTS], cwd=ROOT, capture_output=True)
        for name in names.stdout.decode().splitlines():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)
        cache = "core/kernel_cache.py"  # the kernel cache of the unchanged sources serves all mutants
        text = read(cache).replace("digest.hexdigest()[:16]", '"mutants"')
        (tree / "agrobot_mj" / cache).write_text(text, encoding="utf-8")

    def run(self, tests: str, plain: bool, limit_s: float) -> tuple[TestOutcome, str]:
        files = " ".join(f"tests/{name}" for name in tests.split())
        tree, python = shlex.quote(str(self.tree)), shlex.quote(str(ROOT / ".venv/bin/python"))
        pytest = f"{python} -m pytest -x -q -p no:cacheprovider -m 'not slow' {files}"
        return run_tests(f"env -C {tree} PYTHONPATH={tree} NUMBA_DISABLE_JIT={int(plain)} {pytest}", limit_s)

    def killed(self, mutant: Mutant) -> str:
        """Return how a mutant is detected, or an empty string if no test detects the mutant."""
        plain = re.search(r"core\.kernels import .*\b(kernel|jit)|def (force|drag)\(self, slip", mutant.source)
        key = mutant.tests, bool(plain)
        if key not in self.usual:
            began = time.monotonic()
            outcome, output = self.run(*key, 3600.0)
            if outcome != TestOutcome.SURVIVED:
                raise SystemExit(f"{mutant.tests}: fails without a mutant\n{output}")
            self.usual[key] = time.monotonic() - began
        file = self.tree / "agrobot_mj" / mutant.module
        file.write_text(mutant.source, encoding="utf-8")
        try:
            outcome, output = self.run(*key, 10.0 * self.usual[key] + 60.0)
        finally:
            shutil.copy2(ROOT / "agrobot_mj" / mutant.module, file)
        if outcome == TestOutcome.SURVIVED:
            return ""
        absent = mutant.name and re.search(rf"(NameError|AttributeError): .*'{mutant.name}'", output)
        failed = re.search(r"^(FAILED|ERROR) (\S+)", output, re.MULTILINE)
        return "no such name" if absent else failed[2] if failed else "time"


def main() -> None:
    """Draw mutants, test them, and print the result."""
    plan = tomllib.loads((ROOT / "tests" / "mutants.toml").read_text(encoding="utf-8"))
    groups = plan["group"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, help="mutants of each group, instead of the numbers of the plan")
    parser.add_argument("--only", default=",".join(("named", *groups)), help="groups, separated by commas")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "mutants")
    given = parser.parse_args()
    bench, file = Bench(given.out.resolve() / "tree"), given.out / "mutants.json"
    done: dict[str, str] = json.loads(file.read_text()) if file.exists() else {}
    for name in given.only.split(","):
        mutants = named(plan["named"]) if name == "named" else drawn(groups[name], f"{given.seed} {name}", given.count)
        sample = list(mutants)
        keys = [f"{mutant.module}:{mutant.what}" for mutant in sample]
        for key, mutant in zip(keys, sample, strict=True):
            if key not in done:
                done[key] = bench.killed(mutant)
                file.write_text(json.dumps(done, indent=1))
                print(f"{key}: {done[key] or 'SURVIVES'}", flush=True)
        counted = [key for key in keys if done[key] != "no such name"]
        survivors = [key for key in counted if not done[key]]
        print(f"{name}: {len(counted) - len(survivors)} of {len(counted)} killed", *survivors, sep="\n  ", flush=True)


if __name__ == "__main__":
    main()
