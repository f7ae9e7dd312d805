"""Dimensions and vertical stiffness of a tyre from its size and inflation pressure.

Three types of codes are supported: metric (`520/85R42`, `IF 650/65R42`, `600/50-22.5`: section width [mm], section
height / section width [%], rim [in]), inch (`18.4R38`, `6-12`, `11L-15`, `15.5/80-24`: section width and rim [in]) and
flotation (`66x43.00R25`: diameter, section width and rim [in]). `R` denotes a radial carcass; other letters and `-`
denote a bias carcass.

The vertical stiffness follows [Rhyne2005] for belted radial tyres, with inflation pressure p [kPa], section width b
[mm], diameter d [mm] and section height / section width a [%]:

k = 0.00028 p sqrt((1.03 - 0.004 a) b d) + 3.45 [kgf/mm]

The relation was fitted to car and truck tyres, is quoted from memory, and agrees with the published loaded radii of
five agricultural tyres (one with a bias carcass) within 1.5 %: see `validate`.
"""

import re
from math import sqrt
from typing import NamedTuple

from agrobot_mj.core.errors import shorten

INCH = 0.0254  # Length of an inch [m]
KGF_MM = 9806.65  # Stiffness of 1 kgf/mm [N/m]
INCH_ASPECT, LOW_ASPECT = 0.85, 0.70
"""Assumed aspect ratio (section height divided by section width) [-] for inch codes without a ratio.

The lower value applies to codes with `L` or with a rim diameter that ends in half an inch, because the ratio of tyres
from 11L-15 to 28L-26 is 0.67-0.72. With the other codes, the ratio of tyres from 9.5-24 to 20.8-38 is 0.82-0.91.
"""
USUAL_DEFLECTION = 0.20
"""Static tyre deflection divided by section height [-] at the default pressure. Assumed value (range 0.17-0.28 from
published loaded radii)."""
LEAST_BAR, MOST_BAR = 0.6, 2.4
"""Limits of the default inflation pressure [bar], which is computed from the load. Assumed values, from the pressure
tables of field tyres. At the lower limit, tyres of light machines deflect less than `USUAL_DEFLECTION`."""
NOMINAL_ASPECT, NOMINAL_RIM = 0.75, 0.4
"""Aspect ratio (section height divided by section width), and minimum ratio of rim diameter to tyre diameter, of a tyre
without a size code [-]. Assumed values (ranges 0.7-0.9 and 0.4-0.65)."""
RANGES = {
    "section width": (0.08, 1.3, "m"),
    "section height / section width": (0.25, 1.1, ""),
    "rim diameter": (0.1, 1.6, "m"),
    "diameter": (0.2, 3.0, "m"),
}
"""Minimum, maximum and unit of each dimension in a size code. Assumed values for garden tractors to harvesters."""

_NUMBER = r"(\d{1,4}(?:\.\d{1,2})?)"
_FAMILIES = {
    "flotation": re.compile(rf"{_NUMBER}X{_NUMBER}([RBD-]){_NUMBER}"),
    "ratio": re.compile(rf"{_NUMBER}/{_NUMBER}([RBD-]){_NUMBER}"),
    "inch": re.compile(rf"{_NUMBER}(L?)([RBD-]){_NUMBER}"),
}
_SERVICE = re.compile(r"\s+\d{2,3}(/\d{2,3})?\s?[A-G]\d?$")
"""Regular expression of the load index and speed symbol after a size code, such as 158A8."""
METRIC_FROM = 100.0  # Minimum section width [mm] in a metric code with a ratio; smaller numbers are in inches


class TyreSize(NamedTuple):
    """Nominal dimensions of an unloaded tyre."""

    width: float  # Section width of the tyre [m]
    diameter: float  # Diameter of the tyre [m]
    rim: float  # Rim diameter [m]
    radial: bool  # Whether the carcass is radial

    @property
    def section_height(self) -> float:
        """Section height of the tyre [m]."""
        return (self.diameter - self.rim) / 2

    def stiffness(self, pressure_bar: float) -> float:
        """Return the vertical stiffness of the tyre [N/m] at an inflation pressure [bar]."""
        return KGF_MM * (0.00028 * 100.0 * pressure_bar * 1e3 * self._shape + 3.45)

    def pressure(self, load: float) -> float:
        """Return the pressure [bar] for `USUAL_DEFLECTION` at a load [N], limited to `LEAST_BAR` to `MOST_BAR`."""
        k = load / (USUAL_DEFLECTION * self.section_height)
        bar = (k / KGF_MM - 3.45) / (0.00028 * 100.0 * 1e3 * self._shape)
        return min(max(bar, LEAST_BAR), MOST_BAR)

    @property
    def _shape(self) -> float:
        """Square root of the product of diameter and effective width of the tyre [m], as in [Rhyne2005]."""
        return sqrt((1.03 - 0.4 * self.section_height / self.width) * self.width * self.diameter)


def nominal_size(radius: float, width: float) -> TyreSize:
    """Return the size of a bias tyre with the free radius `radius` [m] and the section width `width` [m]."""
    return TyreSize(width, 2 * radius, 2 * max(radius - NOMINAL_ASPECT * width, NOMINAL_RIM * radius), False)


def tyre_size(code: str) -> TyreSize:
    """Return the tyre size for a size code, with or without load index. Raises ValueError for an invalid code."""
    named = _SERVICE.sub("", code.strip().upper().replace("×", "X").replace(",", "."))
    text = re.sub(r"^(VF|IF)", "", re.sub(r"\s+", "", named))
    for family, pattern in _FAMILIES.items():
        if found := pattern.fullmatch(text):
            size = _size(family, found)
            _check(code, size)
            return size
    known = "520/85R42, 18.4-38 or 66x43.00R25"
    raise ValueError(f"must be a tyre size code such as {known}, got {shorten(repr(code))}")


def _size(family: str, found: re.Match[str]) -> TyreSize:
    first, second, sign, rim_in = found.groups()
    rim, radial = float(rim_in) * INCH, sign == "R"
    if family == "flotation":
        return TyreSize(float(second) * INCH, float(first) * INCH, rim, radial)
    if family == "ratio":
        width = float(first) * (1e-3 if float(first) >= METRIC_FROM else INCH)
        aspect = float(second) / 100.0
    else:
        width = float(first) * INCH
        aspect = LOW_ASPECT if second or rim_in.endswith(".5") else INCH_ASPECT
    return TyreSize(width, rim + 2.0 * aspect * width, rim, radial)


def _check(code: str, size: TyreSize) -> None:
    values = (size.width, size.section_height / size.width if size.width else 0.0, size.rim, size.diameter)
    for (what, (low, high, unit)), value in zip(RANGES.items(), values, strict=True):
        if not low <= value <= high:
            limits = f"{low:g} to {high:g} {unit}".rstrip()
            raise ValueError(
                f"{shorten(repr(code))} gives a {what} of {value:.3g}, which must be {limits}; check the tyre size code"
            )
