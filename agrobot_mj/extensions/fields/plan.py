"""Plan of field work: a course of arcs and clothoids, and the passes in which the implement works.

Distances are distances travelled by the CG along the course [m]. The implement is behind the CG; a pass starts and ends
at the CG distances at which the implement reaches the ends of the pass. Plan files are in JSON format.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from math import isfinite
from pathlib import Path
from typing import Any, Literal, NamedTuple

from agrobot_mj.core.resources import Stamp, refuse
from agrobot_mj.paths.arc import Pose
from agrobot_mj.paths.track import Course, Piece, chain

FORMAT = "agrobot_mj plan 1"  # Format name at the start of a plan file
SUFFIXES, MAX_BYTES = (".json",), 50_000_000  # File name endings and maximum size [bytes] of a plan file
Part = Literal["headland", "body"]


class PlannedPass(NamedTuple):
    """Section of a plan in which the implement works: a headland lap or a swath."""

    part: Part  # Type of the pass: `headland` for a headland lap, `body` for a swath
    start: float  # Distance travelled by the CG when the implement reaches the pass [m]
    end: float  # Distance travelled by the CG when the implement leaves the pass [m]
    sections: tuple[tuple[float, float], ...]
    """Distances travelled by the CG when each section is switched on and off [m], for sections from left to right."""


@dataclass(frozen=True)
class Plan:
    """Plan of field work, with the machine dimensions used for planning."""

    name: str  # Name of the field
    width: float  # Working width [m]
    behind: float  # Distance of the working point of the implement behind the CG [m]
    cg_to_rear_axle: float  # Distance of the rear axle behind the CG [m]; 0 in plans of version 0.3
    start: Pose  # Initial pose of the CG
    pieces: tuple[Piece, ...]  # Path segments of the course
    passes: tuple[PlannedPass, ...]  # Passes in the order of driving
    pause_s: float = 2.0  # Duration of the standstill at each cusp [s]
    angle_deg: float | None = None
    """Direction of straight swaths, counter-clockwise from east [deg], or None for curved swaths and plans imported
    from other programs."""
    headlands: int = 0  # Number of headland laps, or 0 for an imported plan
    margin: float = 0.0  # Width of the strip along the boundary that is not worked [m]
    overlap: float = 0.0  # Planned overlap between neighbouring passes [m]
    ground: str = ""  # Area of the field without obstacles, as well-known text with coordinates in m
    warnings: tuple[str, ...] = ()
    """Warnings about points at which the plan leaves the field or crosses the field body, and about repairs of an
    imported plan."""

    @cached_property
    def course(self) -> Course:
        """Course of the plan as a chain of path segments."""
        return chain(self.start, self.pieces, self.pause_s)

    @property
    def length(self) -> float:
        """Length of the course, including turns [m]."""
        return sum(piece.length for piece in self.pieces)

    @property
    def sections(self) -> int:
        """Maximum number of sections of a pass."""
        return max((len(each.sections) for each in self.passes), default=1)

    @property
    def working_length(self) -> float:
        """Total length of all passes [m]."""
        return sum(each.end - each.start for each in self.passes)


def to_json(plan: Plan) -> dict[str, Any]:
    """Return a plan as JSON values for a plan file."""
    content = asdict(plan)
    content["pieces"] = [[None if not isfinite(value) else value for value in piece] for piece in plan.pieces]
    content["passes"] = [one._asdict() for one in plan.passes]
    return {"format": FORMAT, **content}


@lru_cache(maxsize=4)
def plan_of(content: Stamp) -> Plan:
    """Return the plan in a plan file. Raise ValueError if the file is invalid."""
    file = Path(content[0])
    try:
        found = json.loads(file.read_text("utf-8"))
        if not isinstance(found, Mapping) or found.get("format") != FORMAT:
            raise ValueError(f"the file is not a plan: its format is not {FORMAT!r}")
        return _plan(found)
    except (ValueError, KeyError, TypeError, RecursionError, OSError) as error:
        reason = f"the plan has no {error}" if isinstance(error, KeyError) else str(error)
        refuse(file, f"{reason}; create the plan again with `agrobot-mj field plan`")


def _plan(found: Mapping[str, Any]) -> Plan:
    inf = float("inf")
    pieces = tuple(Piece(*(inf if value is None else float(value) for value in row)) for row in found["pieces"])
    if not any(piece.length > 0 for piece in pieces):
        raise ValueError("the plan is empty, because it has no path segments")
    passes = tuple(
        PlannedPass(
            one["part"], float(one["start"]), float(one["end"]), tuple((float(a), float(b)) for a, b in one["sections"])
        )
        for one in found["passes"]
    )
    numbers = {key: float(found[key]) for key in ("width", "behind", "pause_s")}
    angle = found.get("angle_deg")
    return Plan(
        name=str(found["name"]),
        cg_to_rear_axle=float(found.get("cg_to_rear_axle", 0.0)),
        start=Pose(*map(float, found["start"])),
        pieces=pieces,
        passes=passes,
        angle_deg=None if angle is None else float(angle),
        headlands=int(found.get("headlands", 0)),
        margin=float(found.get("margin", 0.0)),
        overlap=float(found.get("overlap", 0.0)),
        ground=str(found.get("ground", "")),
        warnings=tuple(map(str, found.get("warnings", ()))),
        **numbers,
    )
