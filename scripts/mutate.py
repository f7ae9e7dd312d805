"""Mutation test: does a test fail when the source is changed in one place?

    python scripts/mutate.py [--seed 1] [--count N] [--only GROUP,...] [--out runs/mutants]
    python scripts/mutate.py --again --slow inf  those that survived, with the slow tests too

From each group of modules of scripts/mutants.toml a sample is drawn; a module's tests are those named there, not the
whole suite. Each mutant runs in a forked process over a copy of the tree, with the libraries loaded already. Kernels
run as plain Python, since to compile them again takes a minute; other modules run beside the compiled kernels of the
unchanged tree. Before that the same tests must pass without a mutant: once to find the slow ones, unless `--out` has
their durations from an earlier call, and once as with a mutant, the quickest first and without the slow ones.

A mutant counts as killed when a test fails, be it that it does not find what it expects or that the program ends with
an error, or when it takes ten times the CPU time of its tests without it. It does not count at all when what fails is
a name that the mutant has brought in and that does not exist there: anything would notice that. One that has run for
`LONGEST_S` by the clock, or that pytest cannot run, is left undecided and tried again by the next call.
"""

import argparse
import gc
import importlib.util
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from math import inf
from pathlib import Path
from time import process_time
from types import FrameType
from typing import Any

import hypothesis
import mujoco  # noqa: F401
import numba
import pyarrow.parquet  # noqa: F401
import pydantic  # noqa: F401
import pytest
import scipy.linalg
import scipy.signal  # noqa: F401
from fates import UNDECIDED, Fate, brings_in_an_absent_name, fate_of, table
from mutants import Mutant, changed, mutants

ROOT = Path(__file__).parents[1]
PARTS = ("agrobot_mj", "models", "scenarios", "tests", "docs", "scripts", "examples", "pyproject.toml", "README.md")
LONGEST_S = 1200
"""Longest time of a mutant by the clock [s]."""


class Recorder:
    """Writes down how the first test fails; runs quick tests first and leaves slow ones out, or finds these."""

    def __init__(self, file: Path, durations: dict[str, float] | None, slow_s: float) -> None:
        self.file, self.durations, self.slow_s = file, durations, slow_s if durations is None else inf
        self.found: dict[str, float] = {}

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        if self.durations is not None:
            time = {item.nodeid: self.durations.get(item.nodeid, 0.0) for item in items}
            items[:] = sorted((item for item in items if time[item.nodeid] < inf), key=lambda item: time[item.nodeid])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Any:
        def give_up(_: int, frame: FrameType | None) -> None:
            while frame is not None:
                if re.search("numba|llvmlite", frame.f_code.co_filename):  # it compiles: the test starts after that
                    signal.setitimer(signal.ITIMER_VIRTUAL, self.slow_s)
                    return
                frame = frame.f_back
            self.found[item.nodeid] = inf
            pytest.skip("slow")

        start = process_time()
        if self.slow_s < inf:
            signal.signal(signal.SIGVTALRM, give_up)
            signal.setitimer(signal.ITIMER_VIRTUAL, self.slow_s)
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
            self.found.setdefault(item.nodeid, process_time() - start)

    def pytest_sessionfinish(self) -> None:
        if self.durations is None:
            self.file.with_name("durations").write_text(json.dumps(self.found))

    def pytest_exception_interact(self, call: Any, report: Any) -> None:
        collected = isinstance(report, pytest.TestReport)
        self.record(report.nodeid.partition("[")[0] if collected else "import", call.excinfo.value)

    def record(self, test: str, error: BaseException) -> None:
        if not self.file.exists():
            self.file.write_text(json.dumps(fate_of(test, error)))


class Bench:
    """A copy of the tree on which mutants are tried, one after another."""

    def __init__(self, folder: Path, slow_s: float) -> None:
        self.folder, self.tree, self.slow_s = folder, folder / "tree", slow_s
        self.tree.mkdir(parents=True, exist_ok=True)
        self.copy()
        spec = importlib.util.spec_from_file_location("kernels_of_the_copy", self.tree / "agrobot_mj/core/kernels.py")
        assert spec is not None
        assert spec.loader is not None
        self.kernels = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.kernels)
        self.cache: Path = self.kernels.CACHE
        self.known: dict[str, tuple[dict[str, float], float]] = {}

    def copy(self) -> None:
        """Bring the copy up to date; what is the same keeps its date, so that compiled kernels stay valid."""
        names = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", *PARTS], cwd=ROOT, capture_output=True)
        for name in names.stdout.decode().splitlines():
            source, target = ROOT / name, self.tree / name
            if source.is_file() and (not target.exists() or source.read_bytes() != target.read_bytes()):
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, target)

    def test(
        self, tests: list[str], plain: bool, cpu_s: float, durations: dict[str, float] | None
    ) -> tuple[Fate, float]:
        """How the first test fails, if one does, and the CPU time [s]."""
        named = self.folder / "failed"
        named.unlink(missing_ok=True)
        gc.freeze()
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        child = os.fork()
        if child == 0:
            self._child(tests, plain, cpu_s, Recorder(named, durations, self.slow_s))
        _, status = os.waitpid(child, 0)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        if os.WIFSIGNALED(status):
            name = signal.Signals(os.WTERMSIG(status)).name
            return Fate(f"signal {name}", name), used
        if named.exists():
            killed, how, absent = json.loads(named.read_text())
            return Fate(killed, how, tuple(absent)), used
        broken = os.WEXITSTATUS(status)
        return (Fate(f"status {broken} of pytest", UNDECIDED[0]) if broken else Fate("")), used

    def _child(self, tests: list[str], plain: bool, cpu_s: float, recorder: Recorder) -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(cpu_s) + 1, int(cpu_s) + 5))
        signal.alarm(LONGEST_S)
        output = os.open(self.folder / "output", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.chdir(self.tree)
        sys.path.insert(0, str(self.tree))
        mutated = recorder.durations is not None  # else what is compiled of the source may stay
        sys.dont_write_bytecode = mutated
        os.environ.update(PYTHONPATH=str(self.tree), PYTHONDONTWRITEBYTECODE="1" if mutated else "")
        if plain:
            os.environ["NUMBA_DISABLE_JIT"] = "1"
            numba.config.DISABLE_JIT = 1
        unhurried = {"deadline": None, "suppress_health_check": list(hypothesis.HealthCheck)}
        hypothesis.settings.register_profile("mutants", derandomize=True, database=None, **unhurried)
        hypothesis.settings.load_profile("mutants")
        try:
            importlib.import_module("agrobot_mj.cli")  # as tests/conftest.py does
        except Exception as error:
            recorder.record("import", error)
            os._exit(1)
        arguments = ["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", *(f"tests/{name}" for name in tests)]
        os._exit(pytest.main(arguments, plugins=[recorder]))

    def baseline(self, tests: list[str], plain: bool) -> tuple[dict[str, float], float]:
        """How long each test takes, infinity for a slow one, and the CPU time of the others [s].

        Raises SystemExit when one fails.
        """
        key = f"{' '.join(tests)}{' as plain Python' * plain}, below {self.slow_s:g} s"
        if key not in self.known:
            file = self.folder / "durations.json"
            before: dict[str, dict[str, float]] = json.loads(file.read_text()) if file.exists() else {}
            if key not in before:
                self._pass(self.test(tests, plain, 3600.0, None)[0])
                before[key] = json.loads((self.folder / "durations").read_text())
                file.write_text(json.dumps(before))
            fate, used = self.test(tests, plain, 3600.0, before[key])  # as with a mutant
            self._pass(fate)
            self.known[key] = before[key], used
            slow = sum(time == inf for time in before[key].values())
            print(f"{key}: {used:.1f} s, {len(before[key])} tests, {slow} slow ones left out", flush=True)
        return self.known[key]

    def _pass(self, fate: Fate) -> None:
        if fate.killed:
            raise SystemExit(f"{fate.killed} fails without a mutant: see {self.folder / 'output'}")

    def try_out(self, module: str, mutant: Mutant, tests: list[str]) -> tuple[Fate, float]:
        """The mutant's fate, see `test`."""
        file = self.tree / "agrobot_mj" / module
        source, dates = file.read_text(encoding="utf-8"), file.stat()
        plain = is_kernel(source)
        durations, usual = self.baseline(tests, plain)
        file.write_text(changed(source, mutant), encoding="utf-8")
        cache = self.cache.parent / self.kernels._content()
        try:
            if not plain and cache != self.cache:  # one of its own: what it compiles must not stay
                shutil.rmtree(cache, ignore_errors=True)
                shutil.copytree(self.cache, cache, copy_function=os.link)
            return self.test(tests, plain, 10.0 * usual + 20.0, durations)
        finally:
            file.write_text(source, encoding="utf-8")
            os.utime(file, ns=(dates.st_atime_ns, dates.st_mtime_ns))
            if cache != self.cache:
                shutil.rmtree(cache, ignore_errors=True)


def is_kernel(source: str) -> bool:
    """Whether a file has kernels, or methods that become some: it runs as plain Python then."""
    return bool(re.search(r"core\.kernels import .*\b(kernel|jit)|def (force|drag)\(self, slip", source))


def named(entries: list[dict[str, str]]) -> Iterator[tuple[str, list[str], Mutant]]:
    """The changes by name. Raises SystemExit when the source no longer has one of them."""
    for entry in entries:
        module, before = entry["module"], entry["before"]
        source = (ROOT / "agrobot_mj" / module).read_text(encoding="utf-8")
        if source.count(before) != 1:
            raise SystemExit(f"{entry['what']}: {module} has {before!r} {source.count(before)} times, not once")
        start = len(source[: source.index(before)].encode())
        line = source[: source.index(before)].count("\n") + 1
        yield (
            module,
            entry["tests"].split(),
            Mutant(line, (start, start + len(before.encode())), entry["after"], before),
        )


def drawn(group: dict[str, Any], seed: str, count: int | None) -> Iterator[tuple[str, list[str], Mutant]]:
    """A sample of the group's mutants, with their modules and tests, in the order of the modules."""
    places = [
        (module, tests.split(), mutant)
        for modules, tests in group.items()
        if modules != "count"
        for module in modules.split()
        for mutant in mutants((ROOT / "agrobot_mj" / module).read_text(encoding="utf-8"))
    ]
    picked = random.Random(seed).sample(range(len(places)), min(count or group["count"], len(places)))
    yield from (places[k] for k in sorted(picked))


def main() -> None:
    """Draw, try, tell."""
    plan = tomllib.loads((ROOT / "scripts" / "mutants.toml").read_text(encoding="utf-8"))
    groups = plan["group"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, help="mutants of each group, instead of the numbers of the plan")
    parser.add_argument("--only", default=",".join(("named", *groups)), help="groups, separated by commas")
    parser.add_argument("--again", action="store_true", help="only those that survived before")
    parser.add_argument("--slow", type=float, default=1.5, help="CPU time beyond which a test is left out [s]")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "mutants")
    given = parser.parse_args()
    bench, file = Bench(given.out.resolve(), given.slow), given.out / "mutants.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    known = {(row["module"], *row["span"], row["text"]): row for row in rows}
    for name in given.only.split(","):
        sample = named(plan["named"]) if name == "named" else drawn(groups[name], f"{given.seed} {name}", given.count)
        for module, tests, mutant in sample:
            key = (module, *mutant.span, mutant.text)
            row = known.get(key)
            if row["killed"] or not given.again if row else given.again:
                continue
            fate, used = bench.try_out(module, mutant, tests)
            change, absent = f"{mutant.before!r} -> {mutant.text!r}", brings_in_an_absent_name(mutant, fate)
            told = f"{fate.killed}, {fate.how}{', no such name' * absent}" if fate.killed else "SURVIVES"
            print(f"{module}:{mutant.line} {change}: {told} ({used:.1f} s)", flush=True)
            if fate.how in UNDECIDED:
                continue
            about = {"group": name, "seed": row["seed"] if row else given.seed, "module": module, **mutant._asdict()}
            known[key] = {**about, "killed": fate.killed, "how": fate.how, "absent": absent, "cpu_s": round(used, 1)}
            file.write_text("".join(f"{json.dumps(each)}\n" for each in known.values()))
    print(table(list(known.values())))


if __name__ == "__main__":
    main()
