"""Files that come with the package, and those that a scenario names: looked at before anything opens them.

`models/` and `scenarios/` lie inside an installed wheel or beside the package.
"""

from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import NoReturn

_PACKAGE = Path(__file__).parents[1]


def resource_dir(name: str) -> Path:
    """Path of the folder `name` ("models" or "scenarios")."""
    inside = _PACKAGE / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


MODELS = resource_dir("models")
SCENARIOS = resource_dir("scenarios")


def is_file(path: Path) -> bool:
    """Whether there is such a file; a name that cannot be one (too long, say) has none."""
    try:
        return path.is_file()
    except OSError:
        return False


def library_file(name: str) -> Path:
    """Path of a data file that a scenario names: as given, or one that comes with the scenarios."""
    given, shipped = Path(name), SCENARIOS / name
    return shipped if not given.is_absolute() and is_file(shipped) else given


def scenario_files() -> dict[str, Path]:
    """Name to file of every scenario that comes with the package."""
    return {path.stem: path for path in sorted(SCENARIOS.glob("*.toml"))}


def sweep_files() -> dict[str, Path]:
    """Name to file of every sweep that comes with the package, those of the extensions among them."""
    files = [*(SCENARIOS / "sweeps").glob("*.toml"), *(_PACKAGE / "extensions").glob("*/sweeps/*.toml")]
    return {path.stem: path for path in sorted(files, key=lambda path: path.stem)}


def tuning_files() -> dict[str, Path]:
    """Name to file of every tuning that comes with the package."""
    return {path.stem: path for path in sorted((SCENARIOS / "tunings").glob("*.toml"))}


def machine_files() -> dict[str, Path]:
    """Name to file of every machine that comes with the package."""
    return {path.stem: path for path in sorted((SCENARIOS / "machines").glob("*.toml"))}


def installed_plugins() -> list[EntryPoint]:
    """Entry points by which extensions and installed packages add kinds."""
    return _present("agrobot_mj.plugins")


def installed_commands() -> list[EntryPoint]:
    """Entry points by which extensions and installed packages add commands."""
    return _present("agrobot_mj.commands")


def installed_reports() -> list[EntryPoint]:
    """Entry points by which extensions and installed packages add pages and sections to reports."""
    return _present("agrobot_mj.reports")


def _present(group: str) -> list[EntryPoint]:
    """Entry points of a group, those of the extensions first; without those of extensions whose folder was removed."""
    ours, theirs = list[EntryPoint](), list[EntryPoint]()
    for entry in entry_points(group=group):
        if not entry.module.startswith("agrobot_mj.extensions."):
            theirs.append(entry)
        elif (_PACKAGE / "extensions" / entry.module.split(".")[2]).is_dir():
            ours.append(entry)
    return ours + theirs


LONGEST_NAME = 80
"""Characters of a name that messages show."""

Stamp = tuple[str, int, int, int]
"""Path of a file, times of its last change and of that of its state [ns], size: the same stamp, the same content."""


def stamp(name: str) -> Stamp | None:
    """Identity of the file's present content; None where there is no such file."""
    path = library_file(name)
    try:
        status = path.stat()
    except (OSError, ValueError):
        return None
    return str(path), status.st_mtime_ns, status.st_ctime_ns, status.st_size


def absence(path: Path) -> str:
    """What to say of a path that is no regular file: a device or a pipe would be read for ever."""
    try:
        return "is not a regular file; name one" if path.exists() else "no such file"
    except OSError:  # as of `is_file`
        return "no such file"


def checked(name: str, kinds: Sequence[str], most_bytes: int) -> Path:
    """The path of a regular file with one of these endings (any, when none is given) and of sensible size.

    Raises ValueError that begins with the file's name and ends with the fix.
    """
    path = library_file(name)
    known = f" ({', '.join(kinds)})" if kinds else ""
    try:
        if path.is_dir():
            refuse(path, f"is a folder; name a file{known}")
        if not path.exists():
            refuse(path, f"no such file in {path.parent.absolute()}; give its path from the folder of the scenario")
        if not path.is_file():
            refuse(path, f"is not a regular file; name one{known}")
        size = path.stat().st_size
    except (OSError, RuntimeError) as error:
        refuse(path, f"cannot be read: {getattr(error, 'strerror', None) or error}; choose another file")
    if kinds and path.suffix.lower() not in kinds:
        refuse(path, f"unknown type {path.suffix!r}; convert it to one of {', '.join(kinds)}")
    if size == 0:
        refuse(path, "is empty; write it again")
    if size > most_bytes:
        refuse(path, f"has {size / 1e6:.3g} MB, the limit is {most_bytes / 1e6:.0f}; crop or thin it out")
    return path


def refuse(path: Path, what: str) -> NoReturn:
    """Raise the ValueError that says `what` is wrong with a file."""
    shown = path.name if len(path.name) <= LONGEST_NAME else path.name[:LONGEST_NAME] + "..."
    raise ValueError(f"{shown}: {what}") from None
