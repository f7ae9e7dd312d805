"""Commands `field show` and `field compare`, which describe a field and the recorded work on this field."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from agrobot_mj.cli.options import Answer, Out, Quiet, Sets, overrides, results_folder, utf8
from agrobot_mj.cli.panels import help_entry
from agrobot_mj.extensions.fields.commands_drive import COMMANDS as FIELD_WORK
from agrobot_mj.extensions.fields.options import DEFAULT_WIDTH_M, Crs, FieldFile, FieldName, Width

MAP = "map.png"  # File name of the image with the map
COMPARISON = ("recorded.json", "recorded.png")  # File names of results and map of a comparison


def field_show(
    file: FieldFile,
    crs: Crs = "",
    name: FieldName = "",
    sets: Sets = None,
    out: Out = None,
    quiet: Quiet = False,
) -> Answer:
    """Describe a field and the problems of its file.

    Prints area, perimeter, slope, sharp corners and repairs, and writes map.png.
    """
    from agrobot_mj.core.errors import import_extra

    import_extra("shapely", "fields", "field show")
    from agrobot_mj.extensions.fields.describe import draw_field, field_description, lines_of
    from agrobot_mj.extensions.fields.map_position import ground_of, with_terrain
    from agrobot_mj.extensions.fields.reading import read_field
    from agrobot_mj.extensions.fields.slope import relief_of
    from agrobot_mj.simulation.results import results
    from agrobot_mj.studies.style import write_figure

    field = read_field(Path(utf8(str(file), "FILE")), utf8(crs, "--crs"), utf8(name, "--field"))
    given, note = with_terrain(field, overrides(sets))
    ground, notes = ground_of(field, given)
    relief = ground and relief_of(field.boundary, ground, (*filter(None, [note]), *notes))
    content = field_description(field if relief or not note else replace(field, notes=(*field.notes, note)), relief)
    folder = results_folder(out, f"field-{file.absolute().stem}")
    with results(folder, [MAP]):
        picture = write_figure(folder / MAP, draw_field, field, relief)
    return Answer({**content, "folder": str(folder)}, "\n".join([*lines_of(content), str(picture)]))


def field_compare(
    run: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="Folder of a run of the command link.")],
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="AgOpenGPS folder of the field.")],
    width: Width = DEFAULT_WIDTH_M,
    sections: Annotated[
        int | None, typer.Option(min=1, max=16, help="Number of sections. Default: the highest section in use.")
    ] = None,
    out: Out = None,
    quiet: Quiet = False,
) -> Answer:
    """Compare the worked area in AgOpenGPS with the true area.

    The true area is the worked area of a run of the command link. Reads Sections.txt, prints the areas and writes
    recorded.json and recorded.png.
    """
    from agrobot_mj.core.errors import ScenarioError, import_extra

    import_extra("shapely", "fields", "field compare")
    from agrobot_mj.extensions.fields.maps import map_of_areas
    from agrobot_mj.extensions.fields.reading import read_field
    from agrobot_mj.extensions.fields.recorded_work import (
        SECTIONS,
        comparison,
        comparison_lines,
        recorded_strips,
        work_of_run,
    )
    from agrobot_mj.simulation.results import results, write_json
    from agrobot_mj.studies.style import write_figure

    field = read_field(Path(utf8(str(folder), "FOLDER")))
    if field.plane is None or any(field.shift):
        raise ScenarioError(f"{folder}: the position of the field is unknown; add Field.txt with its StartFix")
    strips = recorded_strips(folder / SECTIONS)
    true = work_of_run(run, field.plane, width, sections)
    found = comparison(field, strips, true.passes)
    content = {"field": field.name, "width_m": width, **found.numbers(), "notes": [*field.notes, *true.notes]}
    target = results_folder(out, f"compare-{field.name}")
    with results(target, COMPARISON):
        write_json(target / COMPARISON[0], content)
        picture = write_figure(target / COMPARISON[1], map_of_areas, found.true.field, found.layers())
    return Answer({**content, "folder": str(target)}, "\n".join([*comparison_lines(content), str(picture)]))


COMMANDS = {
    field_show: help_entry(
        "Field work",
        "field show home.geojson",
        "field show TASKDATA --field North --out runs/north",
        "field show home.geojson --set terrain.kind=slope --set terrain.grade_deg=6",
        advanced=True,
    ),
    **FIELD_WORK,
    field_compare: help_entry(
        "Field work",
        "field compare runs/link Fields/Home --width 6",
        "field compare runs/link Fields/Home --sections 4 --json",
        advanced=True,
    ),
}
"""Commands for field work with their help entries."""
