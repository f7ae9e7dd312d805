"""Common parts of all manoeuvres: checks with acceptance bands, plants and tyres.

A manoeuvre is a file with a function `run(m: Trial) -> Iterator[Check]`. The bands state the accuracy of the simulator
and are never widened. A check outside its band fails. Internal units are SI and radians; each check has its own unit.
"""

from collections.abc import Callable, Iterator
from math import inf, isfinite
from typing import Any, NamedTuple, TypeVar

from agrobot_mj.core.signals import Truth
from agrobot_mj.machine import Machine, TractorParameters
from agrobot_mj.machine.implements import Drawn
from agrobot_mj.plants import Bicycle, BicyclePlant, Clock, MujocoPlant
from agrobot_mj.plants.driver import LEVEL, ORIGIN, STOCK, mujoco_plant
from agrobot_mj.scenario.reference import families
from agrobot_mj.tyres import Linear
from agrobot_mj.tyres.bearing import FIRM

BICYCLE = "bicycle"
"""Subject of checks on the bicycle model. The subject of checks on a MuJoCo tractor is the type of its tyres."""
POWERS = {"_kg": 3, "_kg_m2": 5, "_m": 1}  # Powers of the length scale of quantities, keyed by the suffix of their keys
Scaled = TypeVar("Scaled", TractorParameters, Drawn)


def scale_to_mass(parameters: Scaled, mass_kg: float) -> Scaled:
    """Return a tractor or an implement with masses, inertias and lengths scaled geometrically to a mass [kg]. Tyre keys
    are not scaled."""
    size = (mass_kg / parameters.mass_kg) ** (1 / 3)
    given = {key: value for key, value in parameters.model_dump().items() if value is not None and "tyre_" not in key}
    power = {key: next((n for end, n in POWERS.items() if key.endswith(end)), 0) for key in given}
    return parameters.model_copy(update={key: given[key] * size**n for key, n in power.items() if n})


def machine_of_mass(mass_kg: float) -> Machine:
    """Return the default machine with a tractor scaled to a mass [kg]. Steering and drive follow from the tractor."""
    return Machine(tractor=scale_to_mass(TractorParameters(), mass_kg))


class Check(NamedTuple):
    """Measured value with its theoretical value and its acceptance band."""

    manoeuvre: str
    quantity: str
    subject: str  # Tested plant: `bicycle`, or the kind of tyres of the MuJoCo tractor
    measured: float
    theory: float | None
    unit: str
    low: float  # Lower limit of the band [unit]
    high: float  # Upper limit of the band [unit]
    band: str  # Acceptance limits as text. Without limits, the text is `reported`.

    @property
    def passed(self) -> bool:
        """Whether the measured value is finite and inside its acceptance band."""
        return isfinite(self.measured) and self.low <= self.measured <= self.high

    def judged(self, judged: bool) -> "Check":
        """Return the check unchanged if `judged` is true, otherwise a copy without acceptance limits."""
        return self if judged else self._replace(low=-inf, high=inf, band="reported")

    @property
    def line(self) -> str:
        """Result of the check as one line of text."""
        theory = "" if self.theory is None else f", theory {self.theory:.4g}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.manoeuvre}, {self.subject}: {self.quantity}: {self.measured:.4g}{unit}{theory}, band {self.band}"


class About(NamedTuple):
    """Description of a check: manoeuvre, quantity, subject and unit. The methods return checks of a measured value."""

    manoeuvre: str
    quantity: str
    subject: str
    unit: str

    def near(self, measured: float, theory: float, share: float) -> Check:
        """Return a check whose acceptance band is `theory` plus or minus the fraction `share` of `theory`."""
        room = share * abs(theory)
        return self._check(measured, theory, theory - room, theory + room, f"±{100 * share:g} %")

    def close(self, measured: float, theory: float, room: float) -> Check:
        """Return a check whose acceptance band is `theory` plus or minus `room` [unit of the check]."""
        return self._check(measured, theory, theory - room, theory + room, f"±{room:g} {self.unit}".rstrip())

    def below(self, measured: float, limit: float) -> Check:
        """Return a check that passes if the magnitude of the value is at most `limit` [unit of the check]."""
        return self._check(measured, None, -limit, limit, f"< {limit:g} {self.unit}".rstrip())

    def none(self, measured: float) -> Check:
        """Return a check that passes if the measured count is zero."""
        return self._check(measured, None, 0.0, 0.0, "none")

    def between(self, measured: float, low: float, high: float) -> Check:
        """Return a check whose acceptance band is from `low` to `high` [unit of the check]."""
        return self._check(measured, None, low, high, f"{low:g} to {high:g} {self.unit}".rstrip())

    def above(self, measured: float, limit: float) -> Check:
        """Return a check that passes if the value is at least `limit` [unit of the check]."""
        return self._check(measured, None, limit, inf, f"> {limit:g} {self.unit}".rstrip())

    def reported(self, measured: float, theory: float | None = None) -> Check:
        """Return a check without acceptance limits, for values that are only reported. The value must be finite."""
        return self._check(measured, theory, -inf, inf, "reported")

    def _check(self, measured: float, theory: float | None, low: float, high: float, band: str) -> Check:
        theory = None if theory is None else float(theory)
        return Check(*self[:3], float(measured), theory, self.unit, float(low), float(high), band)


def tyres() -> list[Any]:
    """Return the default tyres of all types for firm ground. Tyres on soft soil have a separate manoeuvre."""
    found: list[Any] = [kind() for kind in families()["plant.tyre"].values()]
    return [tyre for tyre in found if tyre.structure().bearing == FIRM]


def tyre_of(kind: str) -> Any:
    """Return the default tyre of the type `kind`."""
    return families()["plant.tyre"][kind]()


def force_tyres() -> list[Any]:
    """Return the default tyres of all types to which acceptance limits apply, because their force law gives a
    theoretical result."""
    return [tyre for tyre in tyres() if tyre.judged]


class Trial:
    """One execution of a manoeuvre, with its plants, its checks and the curves for its figures."""

    def __init__(self, name: str, quick: bool = False) -> None:
        self.name, self.quick = name, quick
        self.curves: dict[str, Any] = {}
        """Curves for the figures, by subject of the check or by control loop."""
        self.checks: list[Check] = []
        self._plants: list[MujocoPlant] = []
        self._warned = 0

    def drive(self, run: "Run") -> "Trial":
        """Run the manoeuvre `run`, store its checks, and return this trial."""
        self.checks = list(run(self))
        return self

    def about(self, quantity: str, subject: str, unit: str = "") -> About:
        """Return the description of a check of this manoeuvre."""
        return About(self.name, quantity, subject, unit)

    def mujoco(self, tyre: Any, *place: Any, **how: Any) -> tuple[MujocoPlant, Truth]:
        """Return a MuJoCo plant and its initial true state. MuJoCo warnings of the plant are counted in this trial."""
        plant, truth = mujoco_plant(tyre, *place, **how)
        self._plants.append(plant)
        return plant, truth

    def restart(self, plant: MujocoPlant) -> None:
        """Reset the tractor to the origin. Earlier MuJoCo warnings remain counted."""
        self._warned += plant.warnings()
        plant.reset(ORIGIN)

    def level_plants(self, only_linear: bool = False) -> list[tuple[str, Any, Truth]]:
        """Return name, plant and initial true state of the bicycle model and of a MuJoCo tractor for each type of tyre.
        `only_linear` restricts the MuJoCo tractors to the tyre `linear`."""
        bicycle = BicyclePlant(Bicycle(), STOCK, LEVEL.ground(), Clock.of(0.002))
        chosen = [Linear()] if only_linear else tyres()
        return [(BICYCLE, bicycle, bicycle.reset(ORIGIN)), *((tyre.kind, *self.mujoco(tyre)) for tyre in chosen)]

    @property
    def warnings(self) -> int:
        """Number of MuJoCo warnings of all plants in this trial."""
        return self._warned + sum(plant.warnings() for plant in self._plants)


Run = Callable[[Trial], Iterator[Check]]
