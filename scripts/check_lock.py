"""Check offline that pyproject.toml, uv.lock and the exported files agree. The exit status is 1 if they differ."""

import re
import sys
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
EXPORTS = {"requirements.lock": "build", "requirements-dev.lock": "dev", "requirements-docs.lock": "docs"}
"""Exported requirements files, with the dependency group of each file in pyproject.toml."""


def exported(text: str) -> dict[tuple[str, str], set[str]]:
    """Return the hashes in an exported requirements file, by name and version of the package."""
    found: dict[tuple[str, str], set[str]] = {}
    for block in re.split(r"\n(?=\S)", text):
        if pinned := re.match(r"([A-Za-z0-9._-]+)==([^\s;\\]+)", block):
            found[pinned[1], pinned[2]] = set(re.findall(r"--hash=(sha256:[0-9a-f]{64})", block))
    return found


def locked(text: str) -> dict[tuple[str, str], set[str]]:
    """Return the hashes in uv.lock by name and version of the package, except for the project itself."""
    found = {}
    for package in tomllib.loads(text)["package"]:
        if "registry" in package["source"]:
            files = [*package.get("wheels", []), *([package["sdist"]] if "sdist" in package else [])]
            found[package["name"], package["version"]] = {file["hash"] for file in files}
    return found


def wanted(text: str, group: str) -> list[Requirement]:
    """Return the requirements of a dependency group. Except for the group `docs`, the requirements of the project with
    the extra `all` are included."""
    content = tomllib.loads(text)
    project = content["project"]
    extras = [extra for line in project["optional-dependencies"]["all"] for extra in sorted(Requirement(line).extras)]
    optional = [line for extra in extras for line in project["optional-dependencies"][extra]]
    own = [*project["dependencies"], *optional] if group != "docs" else []
    groups = content["dependency-groups"]
    lines = [
        line
        for entry in groups[group]
        for line in (groups[entry["include-group"]] if isinstance(entry, dict) else [entry])
    ]
    return [Requirement(line) for line in [*own, *lines]]


def optional(text: str) -> set[str]:
    """Return the names of all packages in uv.lock that extras require."""
    packages = {package["name"]: package for package in tomllib.loads(text)["package"]}
    (project,) = (package for package in packages.values() if "registry" not in package["source"])
    todo = [needed for needs in project.get("optional-dependencies", {}).values() for needed in needs]
    found: set[str] = set()
    while todo:
        needed = todo.pop()
        package, extras = packages[needed["name"]], needed.get("extra", [])
        if needed["name"] not in found or extras:
            found.add(needed["name"])
            todo += package.get("dependencies", [])
            todo += [inner for extra in extras for inner in package["optional-dependencies"][extra]]
    return found


def faults(root: Path) -> list[str]:
    """Return a line of text for each difference between uv.lock, the exported files and the declared dependencies."""
    texts = {name: (root / name).read_text(encoding="utf-8") for name in (*EXPORTS, "uv.lock", "pyproject.toml")}
    pins = {name: exported(texts[name]) for name in EXPORTS}
    lock, extras = locked(texts["uv.lock"]), optional(texts["uv.lock"])
    found = []
    for name, group in EXPORTS.items():
        for key, hashes in pins[name].items():
            if lock.get(key) != hashes or not hashes:
                where = "differs from uv.lock" if key in lock else "is not in uv.lock"
                found.append(f"{name}: {key[0]}=={key[1]} {where}")
        for requirement in wanted(texts["pyproject.toml"], group):
            project = re.sub(r"[-_.]+", "-", requirement.name).lower()
            versions = [version for pinned, version in pins[name] if pinned == project]
            if not versions or not all(requirement.specifier.contains(v, prereleases=True) for v in versions):
                found.append(f"pyproject.toml: {requirement}, but locked: {', '.join(versions) or 'nothing'}")
    for key in sorted(lock.keys() - set().union(*pins.values())):
        if key[0] not in extras:
            found.append(f"uv.lock: {key[0]}=={key[1]} is missing from the exported files")
    return found


if __name__ == "__main__":
    problems = faults(ROOT)
    print("\n".join([*problems, "run `make lock`"]) if problems else "lock files agree")
    sys.exit(bool(problems))
