"""Values of sweep axes, and distributions of random parameters."""

from collections.abc import Mapping
from math import floor, isclose, log
from sys import float_info
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from agrobot_mj.core.signals import Array
from agrobot_mj.core.spec import Spec


def _number(given: Any) -> Any:
    if isinstance(given, bool) or not isinstance(given, int | float) or not abs(given) <= float_info.max:
        raise ValueError(f"must be a number, got {given!r:.60}")
    return given


MOST_VALUES = 10**15  # Maximum number of values of an axis [-]. Floats represent all integers up to this number.
Number = Annotated[int | float, BeforeValidator(_number)]
Pair = Annotated[tuple[Number, Number], Field(min_length=2, max_length=2)]


def _ascending(pair: tuple[Number, Number]) -> tuple[Number, Number]:
    if not pair[0] < pair[1] or isclose(*pair, rel_tol=1e-15):
        raise ValueError(f"the first number must be below the second, got {list(pair)}")
    return pair


def _positive(pair: tuple[Number, Number]) -> tuple[Number, Number]:
    if pair[0] <= 0:
        raise ValueError(f"must be above 0, got {pair[0]}")
    return pair


def _check_deviation(pair: tuple[Number, Number]) -> tuple[Number, Number]:
    if pair[1] <= 0:
        raise ValueError(f"the second number, the standard deviation, must be above 0, got {pair[1]}")
    return pair


Limits = Annotated[Pair, AfterValidator(_ascending)]


class ValueList(Spec):
    """Base class of the value sequences of a sweep axis, which have a known length."""

    def __len__(self) -> int:
        raise NotImplementedError

    def at(self, k: int) -> Any:
        """Return value number `k`, counted from 0. Integers remain integers."""
        raise NotImplementedError

    @property
    def written(self) -> list[Any]:
        """All values as a list."""
        return [self.at(k) for k in range(len(self))]


class Listed(ValueList):
    """Explicit list of values, which is a plain list in TOML."""

    values: Annotated[tuple[Any, ...], Field(min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _from_list(cls, given: Any) -> Any:
        return {"values": tuple(given)} if isinstance(given, list) else given

    def __len__(self) -> int:
        return len(self.values)

    def at(self, k: int) -> Any:
        """Return value number `k`, counted from 0."""
        return self.values[k]


class Linspace(ValueList):
    """Equally spaced values from `start` to `stop`, including both ends."""

    start: Number = Field(alias="from")
    """First value of the sequence."""
    stop: Number = Field(alias="to")
    """Last value of the sequence."""
    count: Annotated[int, Field(ge=1, le=MOST_VALUES)]
    """Number of values [-]."""

    def __len__(self) -> int:
        return self.count

    def at(self, k: int) -> Number:
        """Return value number `k`, counted from 0. Integers remain integers."""
        if self.count == 1:
            return self.start
        span, gaps = self.stop - self.start, self.count - 1
        if isinstance(span, int) and span % gaps == 0:
            return self.start + k * (span // gaps)
        return _tidy(self.start + span * k / gaps)


class Steps(ValueList):
    """Values with a given spacing, up to the limit `to`."""

    start: Number = Field(alias="from")
    """First value of the sequence."""
    stop: Number = Field(alias="to")
    """Upper limit of the values, or lower limit if `step` is negative."""
    step: Number
    """Spacing of the values, negative for descending values."""

    @model_validator(mode="after")
    def _check_step(self) -> "Steps":
        if not float(self.step) or self._gaps < 0:
            raise ValueError(f"step: {self.step} never leads from {self.start} to {self.stop}; change its sign or size")
        if self._gaps > MOST_VALUES - 1:
            raise ValueError(
                f"step: gives more than {MOST_VALUES:.0e} values from {self.start} to {self.stop}; increase step"
            )
        return self

    @property
    def _gaps(self) -> float:
        return (float(self.stop) - float(self.start)) / float(self.step)

    def __len__(self) -> int:
        # A step that divides the span, up to rounding errors, reaches the end.
        return floor(self._gaps + 1e-9) + 1

    def at(self, k: int) -> Number:
        """Return value number `k`, counted from 0. Integers remain integers."""
        value = self.start + k * self.step
        return value if isinstance(value, int) else _tidy(value)


def _axis_tag(given: Any) -> str:
    if isinstance(given, list):
        return "list"
    return "steps" if isinstance(given, Mapping) and "step" in given else "linspace"


Axis = Annotated[
    Annotated[Listed, Tag("list")] | Annotated[Linspace, Tag("linspace")] | Annotated[Steps, Tag("steps")],
    Discriminator(_axis_tag),
]


class Draw(Spec):
    """Base class of the probability distributions of a random parameter."""

    def values(self, u: Array) -> list[Any]:
        """Return the quantiles of the distribution at the probabilities `u` in (0, 1), shape (n,)."""
        return [_tidy(value) for value in self._quantiles(u).tolist()]

    def _quantiles(self, u: Array) -> Array:
        raise NotImplementedError

    @property
    def written(self) -> Any:
        """Distribution in the form used in sweep files."""
        return self.model_dump(mode="json", exclude_unset=True)


class Uniform(Draw):
    """Uniform distribution between two limits."""

    uniform: Limits
    """Minimum and maximum value of the distribution."""

    def _quantiles(self, u: Array) -> Array:
        low, high = self.uniform
        return low + (high - low) * u


class LogUniform(Draw):
    """Log-uniform distribution: each decade has the same probability."""

    log_uniform: Annotated[Limits, AfterValidator(_positive)]
    """Minimum and maximum value of the distribution, both above 0."""

    def _quantiles(self, u: Array) -> Array:
        low, high = map(log, self.log_uniform)
        return np.exp(low + (high - low) * u)


class Normal(Draw):
    """Normal distribution, optionally truncated to the range `within`."""

    normal: Annotated[Pair, AfterValidator(_check_deviation)]
    """Mean and standard deviation of the distribution."""
    within: Limits | None = None
    """Minimum and maximum of the truncated distribution. Default: no truncation."""

    def _quantiles(self, u: Array) -> Array:
        from scipy.stats import norm

        mean, deviation = self.normal
        low, high = norm.cdf([(limit - mean) / deviation for limit in self.within or (-np.inf, np.inf)])
        found: Array = mean + deviation * norm.ppf(low + (high - low) * u)
        return found


class Choice(Draw):
    """Discrete distribution with equal probabilities of the listed values."""

    choice: Annotated[tuple[Any, ...], Field(min_length=1)]
    """Possible values."""

    def values(self, u: Array) -> list[Any]:
        """Return a listed value for each `u` in (0, 1), shape (n,). Each value has an equal part of the interval."""
        n = len(self.choice)
        return [self.choice[min(int(value * n), n - 1)] for value in u.tolist()]


def _draw_tag(given: Any) -> str:
    return next((tag for tag in DRAWS if isinstance(given, Mapping) and tag in given), "no distribution")


DRAWS = ("uniform", "normal", "log_uniform", "choice")  # Keys that select a distribution
AnyDraw = Annotated[
    Annotated[Uniform, Tag("uniform")]
    | Annotated[Normal, Tag("normal")]
    | Annotated[LogUniform, Tag("log_uniform")]
    | Annotated[Choice, Tag("choice")],
    Discriminator(_draw_tag),
]


def _tidy(value: float) -> float:
    """Return a value rounded to 12 significant digits, which removes rounding errors: 0.3 for 0.1 * 3."""
    return float(f"{value:.12g}")
