"""The drawing of the default tractor as MJCF for MuJoCo's own viewer: models/drawn/, included by tractor.xml."""

from collections.abc import Iterable
from pathlib import Path

from agrobot_mj.machine.tractor import COMPACT
from agrobot_mj.plants.mujoco.bodywork import STRAIGHT, Panel, bodies

FOLDER = Path(__file__).parent.parent / "models" / "drawn"
ORIGIN = "Written by `make reference` from plants/mujoco/bodywork.py."


def files() -> dict[Path, str]:
    """Every file and its text."""
    return {FOLDER / f"{body}.xml": mjcf(drawn) for body, drawn in bodies(COMPACT).items()}


def mjcf(drawn: Iterable[Panel]) -> str:
    """Geoms of one body."""
    lines = "\n".join(f"  <geom {attributes(part)}/>" for part in drawn)
    return f"<mujocoinclude>\n  <!-- {ORIGIN} -->\n{lines}\n</mujocoinclude>\n"


def attributes(part: Panel) -> str:
    """Attributes of one geom."""
    values = {"name": part.name, "type": part.kind, "size": numbers(part.size), "material": part.paint}
    if part.ends:
        values["fromto"] = numbers(part.ends)
    else:
        values["pos"] = numbers(part.pos)
        if part.quat != STRAIGHT:
            values["quat"] = numbers(part.quat)
    return " ".join(f'{name}="{value}"' for name, value in values.items())


def numbers(values: Iterable[float]) -> str:
    """Values with four decimals at most."""
    return " ".join(f"{round(float(value), 4) + 0.0:g}" for value in values)
