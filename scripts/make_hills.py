"""The library's digital elevation model, `scenarios/hills.asc`, and two routes over it.

A synthetic landscape that looks like a real one: a ridge and a valley, smooth noise whose power falls with the cube
of the frequency, and a terrace as in old fields. Grid of 2 m as in national height models, heights in centimetres.
One route is drawn across the flanks, the other follows the contour line through the field's middle, a point every 4 m.
"""

from pathlib import Path

import numpy as np
from contourpy import contour_generator
from scipy.interpolate import make_splprep
from scipy.ndimage import gaussian_filter

SCENARIOS = Path(__file__).parent.parent / "scenarios"
CELL_M, ROWS, COLUMNS = 2.0, 81, 101
CORNER = (612_400.0, 5_643_200.0)
"""South-west cell of the grid, in the coordinates of a national grid [m]."""
SEED, ROUGHNESS_M, SMOOTH_M = 11, 1.1, 7.0
POINT_M, ROUTE_M = 4.0, 150.0
ACROSS = ((-80, -50), (-60, -47), (-42, -35), (-32, -16), (-22, 4), (-6, 20), (14, 24), (34, 18), (50, 2), (60, -18))
ACROSS = (*ACROSS, (76, -30))
"""Route across the hills [m]."""


def landscape() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """East and north about the middle [m], and heights [m], shape (rows, columns), row 0 in the south."""
    x = CELL_M * (np.arange(COLUMNS) - (COLUMNS - 1) / 2)
    y = CELL_M * (np.arange(ROWS) - (ROWS - 1) / 2)
    X, Y = np.meshgrid(x, y)
    fx, fy = np.fft.fftfreq(COLUMNS, CELL_M), np.fft.fftfreq(ROWS, CELL_M)
    f = np.hypot(fx[None, :], fy[:, None])
    f[0, 0] = np.inf
    white = np.fft.fft2(np.random.default_rng(SEED).normal(size=X.shape))
    noise = np.real(np.fft.ifft2(white * f**-1.75))
    noise = gaussian_filter(noise, SMOOTH_M / CELL_M)
    ridge = 9.0 * np.exp(-(((Y - 0.25 * X - 55) / 55) ** 2))
    valley = -3.0 * np.exp(-(((X - 30 + 0.4 * Y) / 35) ** 2))
    terrace = 0.6 * np.tanh((Y + 0.15 * X + 32) / 6)
    return x, y, 142.0 + ridge + valley + terrace + ROUGHNESS_M * noise / noise.std()


def route(x: np.ndarray, y: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """The longest contour at the height of the middle, from west to east, shape (n, 2) [m]."""
    level = float(heights[ROWS // 2, COLUMNS // 2])
    line = max(contour_generator(x, y, heights).lines(level), key=len)
    if line[0, 0] > line[-1, 0]:
        line = line[::-1]
    spline, _ = make_splprep(line.T, s=2.0 * len(line))
    dense = spline(np.linspace(0, 1, 4000)).T
    inside = (np.abs(dense[:, 0]) < x[-1] - 12) & (np.abs(dense[:, 1]) < y[-1] - 12)
    dense = dense[inside]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))])
    stations = np.arange(0.0, min(ROUTE_M, way[-1]), POINT_M)
    return np.column_stack([np.interp(stations, way, dense[:, k]) for k in range(2)])


def main() -> None:
    x, y, heights = landscape()
    head = {
        **{"ncols": COLUMNS, "nrows": ROWS, "xllcorner": CORNER[0], "yllcorner": CORNER[1]},
        **{"cellsize": CELL_M, "NODATA_value": -9999},
    }
    lines = [f"{name} {value:g}" if name == "cellsize" else f"{name} {value}" for name, value in head.items()]
    lines += [" ".join(f"{h:.2f}" for h in row) for row in heights[::-1]]
    (SCENARIOS / "hills.asc").write_text("\n".join(lines) + "\n", encoding="utf-8")
    points = route(x, y, heights)
    for name, way in (("hills_contour.csv", points), ("hills_route.csv", ACROSS)):
        text = "x_m,y_m\n" + "".join(f"{a:.2f},{b:.2f}\n" for a, b in way)
        (SCENARIOS / name).write_text(text, encoding="utf-8")
    slope = np.degrees(np.arctan(np.hypot(*np.gradient(heights, CELL_M))))
    print(f"{heights.min():.1f} to {heights.max():.1f} m, slopes to {slope.max():.1f} deg; {len(points)} points")


if __name__ == "__main__":
    main()
