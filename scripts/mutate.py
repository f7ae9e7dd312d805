"""Mutation test: does a test fail when the source is changed in one place?

    python scripts/mutate.py [--seed 1] [--count N] [--only GROUP,...] [--out runs/mutants]
    python scripts/mutate.py --again --whole  those that survived, with the slow tests too

From each group of modules of scripts/mutants.toml a sample is drawn; a module's tests are those named there, not the
whole suite. Each mutant runs in a forked process over a copy of the tree, with the libraries loaded already. Kernels
run as plain Python, since to compile them again takes a minute; other modules run beside the compiled kernels of the
unchanged tree. A mutant counts as killed when a test fails, when it cannot be imported, or when it takes ten times the
CPU time of its tests without it.
"""

import argparse
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
from pathlib import Path
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
from mutants import Mutant, changed, mutants

ROOT = Path(__file__).parents[1]
PARTS = ("agrobot_mj", "models", "scenarios", "tests", "docs", "scripts", "examples", "pyproject.toml", "README.md")
SLOW_S = 1.5
"""CPU time beyond which a test is left out, unless all are asked for [s]."""
LONGEST_S = 1200
"""Longest time of a mutant by the clock [s]."""


class Recorder:
    """Names the first test that fails; finds the slow tests, or leaves them out."""

    def __init__(self, file: Path, slow: set[str], seek_slow: bool) -> None:
        self.file, self.slow, self.seek_slow = file, slow, seek_slow

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = [item for item in items if item.nodeid not in self.slow]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Any:
        def give_up(_: int, frame: FrameType | None) -> None:
            while frame is not None:
                if re.search("numba|llvmlite", frame.f_code.co_filename):  # it compiles: the test starts after that
                    signal.setitimer(signal.ITIMER_VIRTUAL, SLOW_S)
                    return
                frame = frame.f_back
            with self.file.with_name("slow").open("a") as file:
                file.write(f"{item.nodeid}\n")
            pytest.skip("slow")

        if self.seek_slow:
            signal.signal(signal.SIGVTALRM, give_up)
            signal.setitimer(signal.ITIMER_VIRTUAL, SLOW_S)
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.file.exists():
            self.file.write_text(report.nodeid.partition("[")[0])

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed and not self.file.exists():
            self.file.write_text("import")


class Bench:
    """A copy of the tree on which mutants are tried, one after another."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.tree = folder, folder / "tree"
        self.tree.mkdir(parents=True, exist_ok=True)
        self.copy()
        spec = importlib.util.spec_from_file_location("kernels_of_the_copy", self.tree / "agrobot_mj/core/kernels.py")
        assert spec is not None
        assert spec.loader is not None
        self.kernels = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.kernels)
        self.cache: Path = self.kernels.CACHE
        self.known: dict[tuple[str, ...], tuple[set[str], float]] = {}

    def copy(self) -> None:
        """Bring the copy up to date; what is the same keeps its date, so that compiled kernels stay valid."""
        names = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", *PARTS], cwd=ROOT, capture_output=True)
        for name in names.stdout.decode().splitlines():
            source, target = ROOT / name, self.tree / name
            if source.is_file() and (not target.exists() or source.read_bytes() != target.read_bytes()):
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, target)

    def test(
        self, tests: list[str], plain: bool, cpu_s: float, slow: set[str], seek_slow: bool = False
    ) -> tuple[str, float]:
        """Which test fails first, the signal where the time is up, "" where none does; and the CPU time [s]."""
        named = self.folder / "failed"
        named.unlink(missing_ok=True)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        child = os.fork()
        if child == 0:
            self._child(tests, plain, cpu_s, Recorder(named, slow, seek_slow))
        _, status = os.waitpid(child, 0)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        if os.WIFSIGNALED(status):
            return f"signal {signal.Signals(os.WTERMSIG(status)).name}", used
        failed = named.read_text() if named.exists() else ""
        if os.WEXITSTATUS(status) not in (0, 1, 2):
            raise SystemExit(f"pytest cannot run {tests}: see {self.folder / 'output'}")
        return failed or ("import" if os.WEXITSTATUS(status) else ""), used

    def _child(self, tests: list[str], plain: bool, cpu_s: float, recorder: Recorder) -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(cpu_s) + 1, int(cpu_s) + 5))
        signal.alarm(LONGEST_S)
        output = os.open(self.folder / "output", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.chdir(self.tree)
        sys.path.insert(0, str(self.tree))
        sys.dont_write_bytecode = True
        os.environ["PYTHONPATH"] = str(self.tree)
        if plain:
            os.environ["NUMBA_DISABLE_JIT"] = "1"
            numba.config.DISABLE_JIT = 1
        hypothesis.settings.register_profile("mutants", deadline=None, derandomize=True, database=None)
        hypothesis.settings.load_profile("mutants")
        arguments = ["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", *(f"tests/{name}" for name in tests)]
        os._exit(pytest.main(arguments, plugins=[recorder]))

    def baseline(self, tests: list[str], plain: bool, whole: bool) -> tuple[set[str], float]:
        """Slow tests, none for the `whole`, and the CPU time of the others. Raises SystemExit when one fails."""
        key = (*tests, str(plain), str(whole))
        if key not in self.known:
            told = self.folder / "slow"
            told.write_text("")
            failed, used = self.test(tests, plain, 3600.0, set(), not whole)
            if failed:
                raise SystemExit(f"{failed} fails without a mutant: see {self.folder / 'output'}")
            slow = set(told.read_text().splitlines())
            self.known[key] = slow, used - SLOW_S * len(slow)
        return self.known[key]

    def try_out(self, module: str, mutant: Mutant, tests: list[str], whole: bool) -> tuple[str, float]:
        """The mutant's fate, see `test`; `whole` with the slow tests."""
        file = self.tree / "agrobot_mj" / module
        source, dates = file.read_text(encoding="utf-8"), file.stat()
        plain = is_kernel(source)
        slow, usual = self.baseline(tests, plain, whole)
        file.write_text(changed(source, mutant), encoding="utf-8")
        link = self.cache.parent / self.kernels._content()
        try:
            if not plain and link != self.cache:
                shutil.rmtree(link, ignore_errors=True)
                link.symlink_to(self.cache)
            return self.test(tests, plain, 10.0 * usual + 20.0, slow)
        finally:
            file.write_text(source, encoding="utf-8")
            os.utime(file, ns=(dates.st_atime_ns, dates.st_mtime_ns))
            if link.is_symlink():
                link.unlink()


def is_kernel(source: str) -> bool:
    """Whether a file has kernels: it runs as plain Python then."""
    return "core.kernels import kernel" in source or "core.kernels import jit" in source


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


def table(rows: list[dict[str, Any]]) -> str:
    """Mutants by group, and the survivors, as Markdown."""
    lines = ["| group | mutants | killed | share |", "|---|---|---|---|"]
    for name in [*dict.fromkeys(row["group"] for row in rows), "together"]:
        some = [row for row in rows if name in (row["group"], "together")]
        dead = sum(bool(row["killed"]) for row in some)
        lines.append(f"| {name} | {len(some)} | {dead} | {dead / len(some):.0%} |")
    lines += ["", "| survivor | change |", "|---|---|"]
    for row in rows:
        if not row["killed"]:
            change = f"`{row['before']}` becomes `{row['text']}`".replace("|", "\\|").replace("\n", " ")
            lines.append(f"| {row['module']}:{row['line']} | {change} |")
    return "\n".join(lines)


def main() -> None:
    """Draw, try, tell."""
    plan = tomllib.loads((ROOT / "scripts" / "mutants.toml").read_text(encoding="utf-8"))
    groups = plan["group"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, help="mutants of each group, instead of the numbers of the plan")
    parser.add_argument("--only", default=",".join(("named", *groups)), help="groups, separated by commas")
    parser.add_argument("--again", action="store_true", help="only those that survived before")
    parser.add_argument("--whole", action="store_true", help="with the slow tests too")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "mutants")
    given = parser.parse_args()
    bench, file = Bench(given.out.resolve()), given.out / "mutants.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    known = {(row["module"], *row["span"], row["text"]): row for row in rows}
    for name in given.only.split(","):
        sample = named(plan["named"]) if name == "named" else drawn(groups[name], f"{given.seed} {name}", given.count)
        for module, tests, mutant in sample:
            key = (module, *mutant.span, mutant.text)
            row = known.get(key)
            if row["killed"] or not given.again if row else given.again:
                continue
            killed, used = bench.try_out(module, mutant, tests, given.whole)
            known[key] = {
                "group": name,
                "module": module,
                **mutant._asdict(),
                "killed": killed,
                "cpu_s": round(used, 1),
            }
            change = f"{mutant.before!r} -> {mutant.text!r}"
            print(f"{module}:{mutant.line} {change}: {killed or 'SURVIVES'} ({used:.1f} s)", flush=True)
            file.write_text("".join(f"{json.dumps(each)}\n" for each in known.values()))
    print(table(list(known.values())))


if __name__ == "__main__":
    main()
