"""Texts that describe the same field in every supported file format."""

import json

import numpy as np

from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.extensions.fields.reading import read_field

ORIGIN = Origin(58.4, 26.7)
RING = np.array([(-150, -80), (150, -80), (150, 40), (20, 80), (-150, 80)], dtype=float)
HOLE = np.array([(0, 0), (20, 0), (20, 15), (0, 15)], dtype=float)
"""Boundary and hole of the field [m]. The middle of the bounding box is at (0, 0)."""
AREA = 45_400.0 - 300.0  # Area of the boundary without the hole [m2], from the shoelace formula


def degrees(ring):
    """Return longitude and latitude of the points of a closed ring [deg]."""
    return [list(to_geodetic(ORIGIN, *point)[::-1]) for point in np.array([*ring, ring[0]]).tolist()]


def text_of(ring, form="{:.9f},{:.9f}", between=" "):
    return between.join(form.format(*point) for point in degrees(ring))


def feature(*rings, **properties):
    return {"type": "Feature", "properties": properties, "geometry": {"type": "Polygon", "coordinates": [*rings]}}


def geojson(*features, **more):
    return json.dumps({"type": "FeatureCollection", "features": [*features], **more})


def lsg(kind, ring):
    return f'<LSG A="{kind}">' + "".join(f'<PNT A="2" C="{y:.9f}" D="{x:.9f}"/>' for x, y in degrees(ring)) + "</LSG>"


def task_data(inner, version=4, more=""):
    field = f'<PFD A="PFD1" C="North" D="1"><PLN A="1">{lsg(1, RING)}{inner}</PLN>{more}</PFD>'
    return (
        f'<?xml version="1.0"?><ISO11783_TaskData VersionMajor="{version}" VersionMinor="0">{field}</ISO11783_TaskData>'
    )


def kml_ring(tag, ring):
    return f"<{tag}><LinearRing><coordinates>{text_of(ring, '{:.9f},{:.9f},0')}</coordinates></LinearRing></{tag}>"


GML3 = (
    '<f xmlns:gml="http://www.opengis.net/gml/3.2"><gml:Polygon srsName="urn:ogc:def:crs:EPSG::4326">'
    "{}</gml:Polygon></f>"
)
GML2 = '<f xmlns:gml="http://www.opengis.net/gml"><gml:Polygon srsName="EPSG:4258">{}</gml:Polygon></f>'


def gml3(tag, ring):
    numbers = " ".join(f"{y:.9f} {x:.9f}" for x, y in degrees(ring))
    return f"<gml:{tag}><gml:LinearRing><gml:posList>{numbers}</gml:posList></gml:LinearRing></gml:{tag}>"


def gml2(tag, ring):
    inner = f"<gml:coordinates>{text_of(ring)}</gml:coordinates>"
    return f"<gml:{tag}><gml:LinearRing>{inner}</gml:LinearRing></gml:{tag}>"


WKT = f"POLYGON (({text_of(RING, '{:.9f} {:.9f}', ', ')}), ({text_of(HOLE, '{:.9f} {:.9f}', ', ')}))"
LAT_LON = "lat,lon\n" + "\n".join(f"{y:.9f},{x:.9f}" for ring in (RING, HOLE) for x, y in degrees(ring))
FILES = {
    "a.geojson": geojson(feature(degrees(RING), degrees(HOLE), name="North")),
    "fiboa.json": geojson(feature(degrees(RING), degrees(HOLE)), fiboa_version="0.3.0"),
    "obstacle.geojson": geojson(feature(degrees(RING)), feature(degrees(HOLE))),
    "bare.json": json.dumps({"type": "MultiPolygon", "coordinates": [[degrees(RING), degrees(HOLE)]]}),
    "a.kml": '<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><Polygon>'
    f"{kml_ring('outerBoundaryIs', RING)}{kml_ring('innerBoundaryIs', HOLE)}</Polygon></Placemark></kml>",
    "gml3.gml": GML3.format(gml3("exterior", RING) + gml3("interior", HOLE)),
    "gml2.xml": GML2.format(gml2("outerBoundaryIs", RING) + gml2("innerBoundaryIs", HOLE)),
    "a.wkt": WKT,
    "z.wkt": f"SRID=4326;{WKT}",
    "v4.xml": task_data(lsg(2, HOLE)),
    "v3.xml": task_data("", 3, f'<PLN A="6">{lsg(1, HOLE)}</PLN>'),
    "two_rings.csv": LAT_LON,
}


def field_of(folder, name, content, **options):
    """Return the field read from a file with the given content."""
    (folder / name).write_text(content, encoding="utf-8")
    return read_field(folder / name, **options)


def aog(folder, comma="."):
    """Write a field folder of AgOpenGPS with boundary, hole and headland."""
    folder.mkdir()

    def listed(ring):
        rows = "".join(f"{x:.3f};{y:.3f};1.57080\r\n".replace(".", comma).replace(";", ",") for x, y in ring)
        return f"{len(ring)}\r\n{rows}"

    fix = f"{ORIGIN.latitude:.8f};{ORIGIN.longitude:.8f}".replace(".", comma).replace(";", ",")
    (folder / "Field.txt").write_text(
        f"2026\r\n$FieldDir\r\nx\r\n$Offsets\r\n0,0\r\nConvergence\r\n0\r\nStartFix\r\n{fix}\r\n"
    )
    (folder / "Boundary.txt").write_text(f"$Boundary\r\nFalse\r\n{listed(RING)}False\r\nFalse\r\n{listed(HOLE)}")
    (folder / "Headland.txt").write_text(f"$Headland\r\n{listed(0.8 * RING)}")
    return folder


def elevation(folder, height, quality=4, origin=ORIGIN, apart=10.0):
    """Write the heights of a function of x and y [m] along passes over the field to an Elevation.txt."""
    text = f"2026\r\n$FieldDir\r\nElevation\r\nStartFix\r\n{origin.latitude},{origin.longitude}\r\n"
    text += "Latitude,Longitude,Elevation,Quality,Easting,Northing,Heading,Roll\r\n"
    for y in np.arange(-75.0, 80.0, apart).tolist():
        for x in np.arange(-150.0, 151.0, 3.0).tolist():
            latitude, longitude = to_geodetic(ORIGIN, x, y)
            text += f"{latitude:.7f},{longitude:.7f},{height(x, y):.3f},{quality},{x:,.2f},{y:,.2f},1.571,0\r\n"
    (folder / "Elevation.txt").write_text(text, newline="")
    return folder
