"""Command `field show`, which describes a field."""

from dataclasses import replace
from pathlib import Path

from agrobot_mj.cli.options import Answer, Out, Quiet, Sets, overrides, results_folder, utf8
from agrobot_mj.cli.panels import help_entry
from agrobot_mj.extensions.fields.commands_drive import COMMANDS as FIELD_WORK
from agrobot_mj.extensions.fields.options import Crs, FieldFile, FieldName

MAP = "map.png"  # File name of the image with the map


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


COMMANDS = {
    field_show: help_entry(
        "Field work",
        "field show home.geojson",
        "field show TASKDATA --field North --out runs/north",
        "field show home.geojson --set terrain.kind=heightmap --set terrain.file=dem.tif",
        advanced=True,
    ),
    **FIELD_WORK,
}
"""Commands for field work with their help entries."""
