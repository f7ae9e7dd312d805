"""Where `models/` and `scenarios/` lie: inside an installed wheel, or beside the package in a checkout."""

from pathlib import Path

_PACKAGE = Path(__file__).parent


def resource_dir(name: str) -> Path:
    """Folder `name` ("models" or "scenarios")."""
    inside = _PACKAGE / name
    return inside if inside.is_dir() else _PACKAGE.parent / name


MODELS = resource_dir("models")
SCENARIOS = resource_dir("scenarios")
