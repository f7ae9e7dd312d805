"""Make scenarios/rolling_field.asc: 256 m of rolling farmland, as a digital elevation model of 2 m would have it.

Two broad rises, a shallow valley between them, and undulation of tens of metres; about 9 m from lowest to highest and
at most some 9 degrees. Made up: no place on Earth. Heights in millimetres, zero at the middle.
"""

from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

CELL_M, NODES = 2.0, 129
OUT = Path(__file__).parent.parent / "scenarios" / "rolling_field.asc"


def heights() -> np.ndarray:
    """Shape (rows, columns), row 0 north [m]."""
    along = CELL_M * (np.arange(NODES) - (NODES - 1) / 2)
    x, y = np.meshgrid(along, -along)
    rises = 5.5 * np.exp(-(((x + 70) / 60) ** 2) - ((y - 50) / 75) ** 2)
    rises += 4.5 * np.exp(-(((x - 85) / 70) ** 2) - ((y + 60) / 60) ** 2)
    valley = -2.5 * np.exp(-(((x - 0.4 * y - 5) / 28) ** 2))
    rng = np.random.default_rng(2015)
    undulation = sum(rms * _smooth(rng, length) for rms, length in ((0.5, 25.0), (0.12, 9.0)))
    relief = rises + valley + undulation
    return relief - relief[NODES // 2, NODES // 2]


def _smooth(rng: np.random.Generator, length: float) -> np.ndarray:
    noise = gaussian_filter(rng.normal(size=(NODES, NODES)), length / 2 / CELL_M, mode="reflect")
    return noise / noise.std()


def main() -> None:
    corner = -CELL_M * NODES / 2
    head = f"ncols {NODES}\nnrows {NODES}\nxllcorner {corner:g}\nyllcorner {corner:g}\ncellsize {CELL_M:g}\n"
    rows = "\n".join(" ".join(f"{h:.3f}" for h in row) for row in heights())
    OUT.write_text(f"{head}NODATA_value -9999\n{rows}\n", encoding="ascii")


if __name__ == "__main__":
    main()
