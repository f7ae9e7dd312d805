"""Build wheel and sdist, and check them in empty environments with several versions of Python.

uv provides the Python versions. Each environment contains only the package and its run-time dependencies. The commands
of the wheel are run, and the sdist must install the same files as the wheel. The last check has no home folder and no
cache folder. If all checks pass, the sizes of dependencies and extras are printed; otherwise the exit status is 1. The
files remain in dist/.
"""

import os
import subprocess
import sys
import tempfile
import tomllib
from functools import partial
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
UV = os.environ.get("UV", "uv")
PYTHONS = os.environ.get("PYTHONS", "3.11 3.12 3.13").split()
"""Python versions, or paths of interpreters, with which the package is checked."""
KEPT = ("UV_", "PIP_", "SSL_")  # Prefixes of environment variables that configure the package index
SHORT = ("--set", "duration_s=2", "-q")
COMMANDS = (
    ("--version",),
    ("list",),
    ("explain", "plant.tyre.kind"),
    ("run", "circle", *SHORT, "--out", "run"),
    ("compare", "circle", "--controllers", "pd", *SHORT, "--out", "compared"),
)
"""Commands that must work without extras."""
COMPLETE = (
    ("run", "circle", *SHORT, "--set", "estimator.kind=ukf", "--out", "all"),
    ("compare", "circle", "--controllers", "pd", *SHORT, "--out", "drawn"),
    ("report", "drawn"),
    ("rig", "linear", "-q", "--out", "rig"),
)
"""Commands that must work if the extra `all` is installed."""
REFUSED = (("report", "compared"), ("rig", "linear", "--out", "none"), ("export", "run", "--mcap"))
"""Commands that must fail with status 2 and name a missing extra."""


tell = partial(print, flush=True)


def call(command: list[str | Path], folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command without the Python-specific environment variables of this process, and return the completed
    process."""
    keep = {name: value for name, value in os.environ.items() if name in ("PATH", "HOME") or name.startswith(KEPT)}
    return subprocess.run(
        list(map(str, command)), cwd=folder, env={**keep, **environment}, capture_output=True, text=True, check=False
    )


def must(command: list[str | Path], folder: Path, **environment: str) -> str:
    """Run a command and return its standard output. Raises RuntimeError with the output if the command fails."""
    done = call(command, folder, **environment)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}: status {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def environment(package: str | Path, python: str, folder: Path) -> Path:
    """Install a package in a virtual environment, which is created if missing. Return the folder of its executables."""
    if not (folder / "venv").exists():
        folder.mkdir(parents=True, exist_ok=True)
        must([UV, "venv", "--quiet", "--python", python, folder / "venv"], folder)
    must([UV, "pip", "install", "--quiet", "--python", folder / "venv" / "bin" / "python", package], folder)
    return folder / "venv" / "bin"


def works(programs: Path, folder: Path) -> None:
    """Check that commands work without extras, and that commands that need an extra name it in their error messages."""
    for arguments in COMMANDS:
        must([programs / "agrobot-mj", *arguments], folder)
    must_exist(folder, "run/signals.parquet", "compared/comparison.json")
    if (folder / "run/run.rrd").exists():
        raise RuntimeError("run/run.rrd: the file was written without the extra")
    for arguments in REFUSED:
        done = call([programs / "agrobot-mj", *arguments], folder)
        if done.returncode != 2 or "pip install" not in done.stderr or "Traceback" in done.stderr:
            raise RuntimeError(f"{' '.join(arguments)}: status {done.returncode}, stderr {done.stderr!r}")


def must_exist(folder: Path, *names: str) -> None:
    for name in names:
        if not (folder / name).is_file():
            raise RuntimeError(f"{name}: is missing")


def works_with_all(programs: Path, folder: Path) -> None:
    """Check commands that need the extra `all`."""
    for arguments in COMPLETE:
        must([programs / "agrobot-mj", *arguments], folder)
    must_exist(folder, "all/run.rrd", "drawn/comparison.rrd", "drawn/lateral_error.png", "rig/curves.parquet")


def works_without_a_cache(programs: Path, folder: Path) -> None:
    """Check a run that cannot cache kernels: without home folder, and with a file in place of the cache folder."""
    (folder / "no-folder").touch()
    bare = {"PATH": os.environ["PATH"], "XDG_CACHE_HOME": str(folder / "no-folder"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [str(programs / "agrobot-mj"), "run", "circle", *SHORT, "--no-rrd", "--out", "bare"]
    done = subprocess.run(command, cwd=folder, env=bare, capture_output=True, text=True, check=False)
    if done.returncode or done.stderr or not (folder / "bare" / "signals.parquet").is_file():
        raise RuntimeError(f"without a cache: status {done.returncode}\n{done.stdout}{done.stderr}")
    if kept := [file for file in programs.parent.rglob("*.nb[ic]") if file.is_file()]:
        raise RuntimeError(f"without a cache: {kept[0]} was written")


def files(programs: Path) -> dict[str, bytes]:
    (site,) = (programs.parent / "lib").glob("python*/site-packages")
    found = (file for file in (site / "agrobot_mj").rglob("*") if file.is_file() and "__pycache__" not in file.parts)
    return {str(file.relative_to(site)): file.read_bytes() for file in found}


def table(wheel: Path, python: str, folder: Path) -> list[str]:
    """Return lines of text with the size of each dependency and extra [MB]. A size includes the requirements that no
    earlier line counts."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    rows, whole = dict[str, float](), 0.0
    for needed in (*project["dependencies"], str(wheel)):
        programs = environment(needed, python, folder / "alone")
        before, whole = whole, megabytes(programs.parent / "lib")
        rows[wheel.stem if needed == str(wheel) else Requirement(needed).name] = whole - before
    rows["in all"] = whole
    for extra in project["optional-dependencies"]:
        programs = environment(f"{wheel}[{extra}]", python, folder / extra)
        rows[extra] = megabytes(programs.parent / "lib") - whole
    return [f"{size:6.1f} MB  {name}" for name, size in rows.items()]


def megabytes(place: Path) -> float:
    files = [place] if place.is_file() else [file for file in place.rglob("*") if file.is_file()]
    return sum(file.stat().st_size for file in files) / 1e6


def main() -> int:
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        for old in (*DIST.glob("*.whl"), *DIST.glob("*.tar.gz")):
            old.unlink()
        must([sys.executable, "-m", "build", "--no-isolation", "--outdir", DIST, ROOT], folder)
        (wheel,), (sdist,) = DIST.glob("*.whl"), DIST.glob("*.tar.gz")
        tell(f"built {wheel.name} ({megabytes(wheel):.1f} MB), {sdist.name} ({megabytes(sdist):.1f} MB)")
        for python in PYTHONS:
            place = folder / f"python-{PYTHONS.index(python)}"
            other = place / "sdist"
            (place / "work").mkdir(parents=True)
            try:
                programs = environment(wheel, python, place)
                works(programs, place / "work")
                tell(f"{python}: the wheel works, {must([programs / 'agrobot-mj', '--version'], folder).strip()}")
                from_source = environment(sdist, python, other)
                must([from_source / "agrobot-mj", "list"], other)
                if files(programs) != files(from_source):
                    raise RuntimeError("the sdist and the wheel install different files")
                tell(f"{python}: the sdist installs the same files")
                if python == PYTHONS[-1]:
                    works_with_all(environment(f"{wheel}[all]", python, place / "all"), place / "work")
                    tell(f"{python}: the extra all works")
                    works_without_a_cache(programs, place / "work")
                    tell(f"{python}: works without a cache")
            except RuntimeError as error:
                tell(f"{python}: FAILED\n{error}")
                failed = 1
        if not failed:
            tell("\n".join(table(wheel, PYTHONS[-1], folder / "sizes")))
    return failed


if __name__ == "__main__":
    sys.exit(main())
