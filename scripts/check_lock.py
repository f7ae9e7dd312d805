"""Do pyproject.toml, uv.lock and requirements.lock agree? Needs no network; status 1 when they do not."""

import re
import sys
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
ADVICE = "run `make lock`"


def exported(text: str) -> dict[tuple[str, str], set[str]]:
    """Name and version to hashes, from requirements.lock."""
    found: dict[tuple[str, str], set[str]] = {}
    for block in re.split(r"\n(?=\S)", text):
        if pinned := re.match(r"([A-Za-z0-9._-]+)==([^\s;\\]+)", block):
            found[pinned[1], pinned[2]] = set(re.findall(r"--hash=(sha256:[0-9a-f]{64})", block))
    return found


def locked(text: str) -> dict[tuple[str, str], set[str]]:
    """Name and version to hashes, from uv.lock, without the project itself."""
    found = {}
    for package in tomllib.loads(text)["package"]:
        if "registry" in package["source"]:
            files = [*package.get("wheels", []), *([package["sdist"]] if "sdist" in package else [])]
            found[package["name"], package["version"]] = {file["hash"] for file in files}
    return found


def wanted(text: str) -> list[Requirement]:
    """Requirements of pyproject.toml: dependencies and the dev group."""
    content = tomllib.loads(text)
    lines = [*content["project"]["dependencies"], *content["dependency-groups"]["dev"]]
    return [Requirement(line) for line in lines]


def optional(text: str) -> set[str]:
    """Names of what the extras of the project in uv.lock need: locked, but not installed by default."""
    packages = {package["name"]: package for package in tomllib.loads(text)["package"]}
    (project,) = (package for package in packages.values() if "registry" not in package["source"])
    todo = [needed["name"] for needs in project.get("optional-dependencies", {}).values() for needed in needs]
    found: set[str] = set()
    while todo:
        name = todo.pop()
        if name not in found:
            found.add(name)
            todo += [needed["name"] for needed in packages[name].get("dependencies", [])]
    return found


def faults(root: Path) -> list[str]:
    """All disagreements, one line each."""
    pins = exported((root / "requirements.lock").read_text(encoding="utf-8"))
    text = (root / "uv.lock").read_text(encoding="utf-8")
    lock, extras = locked(text), optional(text)
    found = []
    for key in sorted(pins.keys() | lock.keys()):
        if key not in pins and key[0] in extras:
            continue
        if pins.get(key) != lock.get(key) or not pins[key]:
            where = "differs from uv.lock" if key in pins and key in lock else "is in one lock file only"
            found.append(f"requirements.lock: {key[0]}=={key[1]} {where}")
    for requirement in wanted((root / "pyproject.toml").read_text(encoding="utf-8")):
        name = re.sub(r"[-_.]+", "-", requirement.name).lower()
        versions = [version for pinned, version in pins if pinned == name]
        if not versions or not all(requirement.specifier.contains(v, prereleases=True) for v in versions):
            found.append(f"pyproject.toml: {requirement}, but locked: {', '.join(versions) or 'nothing'}")
    return found


if __name__ == "__main__":
    problems = faults(ROOT)
    print("\n".join([*problems, ADVICE]) if problems else "lock files agree")
    sys.exit(bool(problems))
