"""Generation of models/drawn/: visual geoms of the default tractor in MJCF, included by tractor.xml for the viewer."""

from pathlib import Path

from agrobot_mj.machine.tractor import COMPACT
from agrobot_mj.plants.mujoco.bodywork import STRAIGHT, Panel, bodies

FOLDER = Path(__file__).parent.parent / "models" / "drawn"
ORIGIN = "Written by `make reference` from plants/mujoco/bodywork.py."


def files() -> dict[Path, str]:
    texts = {body: "\n".join(map(geom, drawn)) for body, drawn in bodies(COMPACT).items()}
    head, foot = f"<mujocoinclude>\n  <!-- {ORIGIN} -->", "</mujocoinclude>\n"
    return {FOLDER / f"{body}.xml": f"{head}\n{text}\n{foot}" for body, text in texts.items()}


def geom(part: Panel) -> str:
    """Return a visual part as an MJCF geom element, with numbers rounded to four decimals."""
    values = {"name": part.name, "type": part.kind, "size": part.size, "material": part.paint}
    values |= {"fromto": part.ends} if part.ends else {"pos": part.pos}
    if not part.ends and part.quat != STRAIGHT:
        values["quat"] = part.quat
    texts = {
        k: v if isinstance(v, str) else " ".join(f"{round(float(x), 4) + 0.0:g}" for x in v) for k, v in values.items()
    }
    return "  <geom " + " ".join(f'{name}="{text}"' for name, text in texts.items()) + "/>"
