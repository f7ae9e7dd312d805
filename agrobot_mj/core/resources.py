"""Folders of data, `models/` and `scenarios/`, inside an installed wheel or beside the package; and plugins."""

from importlib.metadata import EntryPoints, entry_points
from pathlib import Path

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
    """Name to file of every sweep that comes with the package."""
    return {path.stem: path for path in sorted((SCENARIOS / "sweeps").glob("*.toml"))}


def tuning_files() -> dict[str, Path]:
    """Name to file of every tuning that comes with the package."""
    return {path.stem: path for path in sorted((SCENARIOS / "tunings").glob("*.toml"))}


def machine_files() -> dict[str, Path]:
    """Name to file of every machine that comes with the package."""
    return {path.stem: path for path in sorted((SCENARIOS / "machines").glob("*.toml"))}


def installed_plugins() -> EntryPoints:
    """Entry points by which installed packages bring kinds of their own."""
    return entry_points(group="agrobot_mj.plugins")
