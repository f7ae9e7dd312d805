"""Command-line options of the field commands."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from agrobot_mj.cli.options import finite

PAGE = "docs/extensions/fields/driving.md"
FieldFile = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="Boundary (GeoJSON, KML, shapefile, GML, WKT, CSV, ISO 11783, AgOpenGPS)."),
]
Crs = Annotated[str, typer.Option("--crs", metavar="EPSG:N", help="Coordinate system, if not named in the file.")]
FieldName = Annotated[
    str, typer.Option("--field", metavar="NAME", help="Name of a field in the file. Default: the largest.")
]
DEFAULT_WIDTH_M = 3.0  # Default working width [m]
Width = Annotated[float, typer.Option(min=0.3, max=60, callback=finite, help="Working width [m].")]
PlanWidth = Annotated[
    float | None,
    typer.Option(
        "--width",
        min=0.3,
        max=60,
        callback=finite,
        help="Working width [m]. Default: 3, or the width of the plan.",
    ),
]
Headlands = Annotated[
    int | None, typer.Option(min=0, max=20, help="Number of headland laps. Default: 2, or as many as turns need.")
]
Beyond = Annotated[
    float, typer.Option(min=0, max=20, callback=finite, help="Distance by which turns may leave the field [m].")
]
Turn = Annotated[Literal["omega", "bulb", "clothoid", "k"], typer.Option(help=f"Preferred turn ({PAGE}).")]
NoReverse = Annotated[
    bool, typer.Option("--no-reverse", help="Plan without reverse segments, as for drawn implements.")
]
Order = Annotated[Literal["boustrophedon", "skip"], typer.Option(help="Order of the swaths.")]


def _direction(text: str) -> Any:
    return typer.Option(metavar="DEG", min=-360, max=360, callback=finite, help=text)


Angle = Annotated[float | None, _direction("Direction of the swaths, from east. Default: fewest swaths.")]
Along = Annotated[
    Literal["contours"] | None,
    typer.Option(help="Swaths along the contour lines of the terrain, straight or as arcs."),
]
Radius = Annotated[
    float | None, typer.Option(min=0.5, max=100, callback=finite, help="Turn radius [m]. Default: from the machine.")
]
Speed = Annotated[float, typer.Option(min=0.1, max=5, callback=finite, help="Working speed [m/s].")]
Overlap = Annotated[
    float, typer.Option(min=0, max=5, callback=finite, help="Planned overlap between neighbouring passes [m].")
]
Price = Annotated[
    list[str] | None,
    typer.Option("--price", metavar="NAME=VALUE", help="Price: input_ha, yield_ha (both per hectare) or hour."),
]
RowSpacing = Annotated[
    float | None, typer.Option(min=0.05, max=5, callback=finite, help="Distance between crop rows [m].")
]
RowAngle = Annotated[float | None, _direction("Direction of crop rows, from east. Default: along the swaths.")]
Resume = Annotated[bool, typer.Option("--resume", help="Continue the interrupted drive with the same options.")]
Sections = Annotated[int, typer.Option(min=1, max=200, help="Number of sections of the implement.")]
PlanSections = Annotated[
    int | None,
    typer.Option(
        "--sections", min=1, max=200, help="Number of sections of the implement. Default: 1, or that of the plan."
    ),
]
OnDelay = Annotated[
    float, typer.Option(min=0, max=10, callback=finite, help="Delay from the command until a section works [s].")
]
OffDelay = Annotated[
    float, typer.Option(min=0, max=10, callback=finite, help="Delay from the command until a section stops [s].")
]
LookAhead = Annotated[float, typer.Option(min=0, max=10, callback=finite, help="Look-ahead of section control [s].")]
