"""Test the command line, simulation components and extensions with hostile inputs: no traceback, hang or silent error.

    python tests/attack [--seed 1] [--inputs 300] [--only toml,nan] [--number 17]

The seed determines all inputs, so that findings can be repeated. Each finding is printed with its class and number, and
`--only CLASS --number N` repeats it. Each class has a summary line. The exit status is 1 if there are findings.
Extensions have separate classes in `tests/extensions/NAME/attack_NAME.py`.
"""

import argparse
import random
import sys
import time
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

from changes import changes
from commands import NEEDED, commands, folders, parquet, result, studies
from judge import LONGEST_S, judged
from plugins import plugins
from processes import kills
from states import STATES, copies, interrupts
from texts import extremes, files, injected, keys, numbers, overrides, sweeps, toml

import agrobot_mj
from agrobot_mj import load_scenario, run

ROOT = Path(__file__).parents[2]
CLASSES: dict[str, tuple] = {
    "overrides": (overrides, 0.12),
    "toml": (toml, 0.09),
    "sweeps": (sweeps, 0.12),
    "files": (files, 0.11),
    "parquet": (parquet, 0.12),
    "plugins": (plugins, 0.06),
    "extremes": (extremes, 0.06),
    "nan": (injected, 0.045),
    "commands": (commands, 0.1),
    "folders": (folders, 0.06),
    "studies": (studies, 0.04),
    "changes": (changes, 0.02),
    "interrupts": (interrupts, 0.06),
    "copies": (copies, 0.06),
    "kills": (kills, 0.005),
}
"""Classes of inputs. Each class has a function that runs one input, a fraction of all inputs, and functions that
prepare the parent process."""
sys.path += [str(ROOT / "examples" / "agopengps_host"), str(ROOT / "tests")]
for file in sorted((ROOT / "tests" / "extensions").glob("*/attack_*.py")):
    sys.path.append(str(file.parent))
    CLASSES |= import_module(file.stem).CLASSES
LONG_S = {
    "kills": 900.0,
    "changes": 300.0,
    "interrupts": 300.0,
    "copies": 300.0,
    "play": 300.0,
    "starts": 300.0,
    "server": 300.0,
}
"""Maximum time of an input in classes whose inputs consist of several commands, runs or requests [s]."""


def load(classes: list[str]) -> None:
    """Load all modules and compile the kernels that some classes need, before processes are forked."""
    for module in walk_packages(agrobot_mj.__path__, "agrobot_mj."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    keys(), numbers()
    for prepare in [each for name in classes for each in CLASSES[name][2:]]:
        prepare()
    for kind in {kind for name in classes for kind in NEEDED.get(name, ())}:
        result(kind)
    tyres = ("linear", "soil", "contact", "ruts") if "extremes" in classes else ()
    for name in STATES if {"interrupts", "copies"} & set(classes) else ():
        run(load_scenario(name, {"duration_s": 0.2, "plant.settle_s": 0.0}))
    for kind in (*tyres, "magic_formula"):
        run(load_scenario("circle", {"duration_s": 0.2, "plant.settle_s": 0.0, "plant.tyre.kind": kind}))
    run(load_scenario("circle", {"duration_s": 0.2, "plant.kind": "bicycle"}))


def main() -> int:
    """Run the attacks and print the findings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--inputs", type=int, default=300, help="of all classes together")
    parser.add_argument("--only", default=",".join(CLASSES), help="some classes, with commas between them")
    parser.add_argument("--number", type=int, help="one input of each class alone")
    given, findings = parser.parse_args(), 0
    load(given.only.split(","))
    for name in given.only.split(","):
        attack, share, *_ = CLASSES[name]
        chosen = range(max(1, round(share * given.inputs))) if given.number is None else [given.number]
        began, before, limit = time.monotonic(), findings, LONG_S.get(name, LONGEST_S)
        for k in chosen:
            if found := judged(attack, random.Random(f"{given.seed} {name} {k}"), limit):
                findings += 1
                print(f"{name} {k}: {found}", flush=True)
        seconds = time.monotonic() - began
        print(f"{name:10} {len(chosen):6} inputs, {findings - before} findings, {seconds:.0f} s", flush=True)
    return int(findings > 0)


if __name__ == "__main__":
    raise SystemExit(main())
