"""Terrain from the heights that AgOpenGPS records in Elevation.txt."""

import numpy as np
import pytest

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.geodesy import Origin, to_geodetic
from agrobot_mj.scenario.hints import hints
from agrobot_mj.scenario.loading import load_scenario
from agrobot_mj.terrain import Heightmap, height_and_gradient

START = Origin(52.0, 5.0)
NOISE_M = 0.02
EAST, NORTH = 160.0, 120.0  # Size of the field [m]
OPEN_HEAD = "2026\r\n$FieldDir\r\nElevation\r\n$Offsets\r\n0,0\r\nConvergence\r\n0\r\nStartFix\r\n{0},{1}\r\n"
OPEN_TITLE = "Latitude,Longitude,Elevation,Quality,Easting,Northing,Heading,Roll\r\n"
WEB_HEAD = "\ufeff$Elevation\nTimestamp,2026-05-01 10:00:00\nStartLat,{0:.7f}\nStartLon,{1:.7f}\n"
WEB_TITLE = "Latitude,Longitude,Elevation,FixQuality,Easting,Northing,Heading,Roll\n"


def passes(height, apart=6.0, step=1.7, start=(0.0, 0.0)):
    """Return x, y [m] and noisy heights [m] along parallel passes, shape (n, 3)."""
    x, y = np.meshgrid(np.arange(0, EAST + 1e-9, step), np.arange(apart / 2, NORTH, apart))
    z = height(x, y) + NOISE_M * np.random.default_rng(1).standard_normal(x.shape)
    return np.column_stack([x.ravel() + start[0], y.ravel() + start[1], z.ravel()])


def rows(points, quality=4):
    """Return points as rows of the file. Coordinates above 1 km have thousands separators, as in AgOpenGPS."""
    return "".join(
        f"{lat:.7f},{lon:.7f},{round(z, 3)},{quality},{x:,.2f},{y:,.2f},1.571,0.12\r\n"
        for x, y, z in points.tolist()
        for lat, lon in [to_geodetic(START, x, y)]
    )


def file(folder, body, head=OPEN_HEAD + OPEN_TITLE):
    path = folder / "Elevation.txt"
    path.write_text(head.format(*START) + body, encoding="utf-8", newline="")
    return str(path)


def plane(x, y):
    return 40.0 + 0.06 * x - 0.03 * y


def hill(x, y):
    return 40.0 + 4.0 * np.exp(-((x - 80) ** 2 + (y - 60) ** 2) / (2 * 40.0**2))


def slope_of(height, x, y, step=1e-3):
    """Return the slopes to the east and north of a function by central differences."""
    east = height(x + step, y) - height(x - step, y)
    return np.array([east, height(x, y + step) - height(x, y - step)]) / (2 * step)


def errors(ground, height, start=(0.0, 0.0)):
    """Return the errors of height [m] and slope [-] at points of the whole field, shape (n, 3)."""
    found = []
    for x, y in np.random.default_rng(2).uniform((0, 0), (EAST, NORTH), (2000, 2)).tolist():
        at = height_and_gradient(ground, x + start[0], y + start[1])
        found.append([at[0] - height(x, y), *(np.array(at[1:]) - slope_of(height, x, y))])
    return np.array(found)


@pytest.mark.parametrize("height", [plane, hill])
@pytest.mark.parametrize("head", [OPEN_HEAD + OPEN_TITLE, WEB_HEAD + WEB_TITLE], ids=["agopengps", "agopenweb"])
def test_heights_and_slopes_of_a_known_surface_are_recovered(tmp_path, height, head):
    terrain = Heightmap(file=file(tmp_path, rows(passes(height)), head))
    found = errors(terrain.ground(), height)
    rms = np.sqrt((found**2).mean(axis=0))
    assert rms[0] < NOISE_M / 2
    assert np.abs(found[:, 0]).max() < 2 * NOISE_M
    assert np.degrees(rms[1:]).max() < 0.1
    assert terrain.notes == ("heights are interpolated from 1900 of 1900 points, with a cell size of 2 m",)


def test_wide_passes_are_bridged_and_the_slope_continues_to_the_edge(tmp_path):
    ground = Heightmap(file=file(tmp_path, rows(passes(plane, apart=24.0)))).ground()
    found = errors(ground, plane)
    assert np.abs(found[:, 0]).max() < 0.15  # 12 m beyond the passes
    assert np.degrees(np.abs(found[:, 1:])).max() < 0.5
    assert ground.covers(-185.0, -185.0)
    assert ground.covers(EAST + 185.0, NORTH + 185.0)


def test_heights_without_rtk_outliers_and_damaged_rows_are_omitted(tmp_path):
    points = passes(hill)
    wrong = points[::50] + (0.0, 0.0, 9.0)
    text = rows(points) + rows(wrong) + rows(points + (0, 0, 1.5), quality=5) + rows(points[:7], quality="x")
    text += "0.0000000,0.0000000,0,4,0,0,0,0\r\n" + "nan,5,1,4,0,0,0,0\r\n" + "52.0001,5.00"
    text += "53.0000000,5.0000000,40,4,0,0,0,0\r\n"
    terrain = Heightmap(file=file(tmp_path, text))
    assert np.abs(errors(terrain.ground(), hill)[:, 0]).max() < 2 * NOISE_M
    omitted = "10 damaged, 1900 without an RTK fix, 38 outliers"
    assert terrain.notes == (f"heights are interpolated from 1900 of 3848 points ({omitted}), with a cell size of 2 m",)


def test_wrong_fixes_along_a_pass_are_omitted(tmp_path):
    points = passes(hill)
    points[900:912, 2] += 20.0  # 20 m of one pass
    terrain = Heightmap(file=file(tmp_path, rows(points)))
    assert np.abs(errors(terrain.ground(), hill)[:, 0]).max() < 3 * NOISE_M
    assert "1888 of 1900 points (12 outliers)" in terrain.notes[0]


def test_surface_is_recovered_although_40_percent_of_the_heights_are_wrong(tmp_path):
    points, chance = passes(hill), np.random.default_rng(5)
    wrong = chance.random(len(points)) < 0.4
    points[wrong, 2] += chance.normal(0.0, 3.0, wrong.sum())
    found = errors(Heightmap(file=file(tmp_path, rows(points))).ground(), hill)
    assert np.sqrt((found[:, 0] ** 2).mean()) < 0.04


def test_steep_bank_is_kept_by_the_smoothing_of_heights(tmp_path):
    def bank(x, y):
        return 40.0 + 1.5 * np.tanh((x - 80) / 12)

    terrain = Heightmap(file=file(tmp_path, rows(passes(bank))))
    assert "outliers" not in terrain.notes[0]
    middle = height_and_gradient(terrain.ground(), 80.0, 60.0)
    assert middle[1] == pytest.approx(1.5 / 12, rel=0.15)


def test_repeated_passes_reduce_the_error_and_keep_their_median(tmp_path):
    points = np.vstack([passes(hill) for _ in range(5)])
    points[:, 2] += 0.02 * np.random.default_rng(3).standard_normal(len(points))
    found = errors(Heightmap(file=file(tmp_path, rows(points))).ground(), hill)
    assert np.sqrt((found[:, 0] ** 2).mean()) < NOISE_M / 2


def test_points_far_from_the_start_fix_keep_their_position(tmp_path):
    start = (1500.0, -2200.0)
    terrain = Heightmap(file=file(tmp_path, rows(passes(hill, start=start))), map_origin_m=(1000.0, -2000.0))
    found = errors(terrain.ground(), hill, (500.0, -200.0))
    assert np.abs(found[:, 0]).max() < 0.05


def test_scenario_reports_the_omitted_heights(tmp_path):
    name = file(tmp_path, rows(passes(plane)) + rows(passes(plane), quality=1))
    scenario = load_scenario("straight_line", {"terrain.kind": "heightmap", "terrain.file": name})
    told = "terrain.file: heights are interpolated from 1900 of 3800 points (1900 without an RTK fix)"
    assert any(line.startswith(told) for line in hints(scenario))


LINE = np.column_stack([np.arange(50.0), np.zeros(50), np.zeros(50)])
BAD = {
    "header": ("", "the file has no rows with latitude, longitude, height [m] and quality"),
    "commas": ("52,0123456,5,0123456,40,123,4\r\n" * 20, "write decimal points"),
    "no_rtk": (rows(passes(plane), quality=8), "0 of 1900 points with an RTK fix (quality 4)"),
    "one": (rows(LINE[:1]), "1 of 1 points with an RTK fix"),
    "line": (rows(LINE), "the points are on one line"),
    "apart": (rows(LINE) + rows(LINE + (20_000, 0, 0)), "more than 5 km away from their median; remove distant points"),
    "still": (rows(0 * LINE), "the points are on one line"),
    "feet": (rows(passes(lambda x, y: 60 * np.tanh((x - 80) / 20) / 0.3048)), "set a scale of at most 0."),
    "missing": ("nan,nan,nan,4\r\n" * 20, "the file has no rows"),
}


@pytest.mark.parametrize("name", BAD)
def test_unusable_heights_are_rejected_with_the_fix(tmp_path, name):
    body, message = BAD[name]
    with pytest.raises((ValueError, ScenarioError)) as error:
        Heightmap(file=file(tmp_path, body)).ground()
    assert message in str(error.value)
    assert "Elevation.txt" in str(error.value)


HEADS = {
    "none": ("", "no row Latitude,Longitude,Elevation,Quality"),
    "title": (OPEN_TITLE, "no StartFix with latitude and longitude"),
    "text": (OPEN_HEAD.replace("{0}", "north") + OPEN_TITLE, "no StartFix"),
    "comma": (OPEN_HEAD.replace("{0},{1}", "52,1,5,2") + OPEN_TITLE, "no StartFix"),
    "beyond": (OPEN_HEAD.replace("{0}", "152") + OPEN_TITLE, "the StartFix (152, 5) deg is not on the Earth"),
    "nan": (OPEN_HEAD.replace("{0}", "nan") + OPEN_TITLE, "is not on the Earth"),
}


@pytest.mark.parametrize("name", HEADS)
def test_unusable_head_is_rejected_with_the_fix(tmp_path, name):
    head, message = HEADS[name]
    with pytest.raises(ValueError, match=r"Elevation\.txt") as error:
        Heightmap(file=file(tmp_path, rows(passes(plane)), head)).ground()
    assert message in str(error.value)
