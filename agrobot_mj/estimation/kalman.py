"""The two Kalman filters of filterpy with compiled steps, imported without what only its other members use.

`CompiledKalman` and `CompiledEkf` are filterpy's classes with the same hooks and results; their matrix algebra runs in
`equations`, and they keep only what these estimators read. A test compares them with their bases.

filterpy loads `scipy.stats` and `scipy.ndimage` for densities and discrete filters: half a second, a quarter of a run
of one simulated second. While filterpy is imported, names stand in for the functions that it takes from them; each
fetches the real one when it is called. So all of filterpy works for whoever imports it later.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

from agrobot_mj.core.signals import Array
from agrobot_mj.estimation.equations import extended_tick, innovation, linear_tick, posterior, prior

LATER = {"scipy.stats": ("norm", "multivariate_normal"), "scipy.ndimage": ("convolve", "shift")}
"""Names that filterpy takes from each module."""


class _Later:
    """A function of a module, or one below it, that is fetched when it is called."""

    def __init__(self, module: str, *names: str) -> None:
        self._module, self._names = module, names

    def __getattr__(self, name: str) -> "_Later":
        return _Later(self._module, *self._names, name)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        found: Any = import_module(self._module)
        if isinstance(found, _StandIn):  # filterpy tries once whether scipy is newer than 2014
            return None
        for name in self._names:
            found = getattr(found, name)
        return found(*args, **kwargs)


class _StandIn(ModuleType):
    """Module of names that are fetched later."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.__dict__.update({part: _Later(name, part) for part in LATER[name]})


@contextmanager
def _deferred() -> Iterator[None]:
    names = [name for name in LATER if name not in sys.modules]
    sys.modules.update({name: _StandIn(name) for name in names})
    try:
        yield
    finally:
        for name in names:
            del sys.modules[name]


with _deferred():
    from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter


class CompiledKalman(KalmanFilter):  # type: ignore[misc]
    """filterpy's linear filter."""

    x: Array
    """Mean, shape (n,)."""
    P: Array
    """Covariance, shape (n, n)."""

    def predict(self, F: Array, Q: Array) -> None:
        """Prior of the transition F (n, n) with process noise Q (n, n)."""
        self.x, self.P = prior(self.x, self.P, F, Q)

    def update(self, z: Array | None, R: Array) -> None:
        """Posterior of a measurement (m,) with noise R (m, m) that sees H; the prior where there is none."""
        if z is not None:
            self.x, self.P, *_ = posterior(self.x, self.P, self.H, innovation(z, self.H, self.x), R)

    def advance(self, F: Array, Q: Array, z: Array | None, R: Array) -> None:
        """`predict`, then `update`, as one call."""
        if z is None:
            self.predict(F, Q)
        else:
            self.x, self.P = linear_tick(self.x, self.P, F, Q, z, self.H, R)


class CompiledEkf(ExtendedKalmanFilter):  # type: ignore[misc]
    """filterpy's extended filter; a kind overrides `predict_x`, filterpy's hook, and sets F and Q there."""

    x: Array
    """Mean, shape (n,)."""
    P: Array
    """Covariance, shape (n, n)."""
    nis: float
    """Normalised innovation squared of the last measurement [-]."""

    def predict(self, u: Any) -> None:
        """Prior for the inputs `u`."""
        self.predict_x(u)
        _, self.P = prior(self.x, self.P, self.F, self.Q)

    def update(
        self, z: Array | None, HJacobian: Callable[[Array], Array], Hx: Callable[[Array], Array], R: Array
    ) -> None:
        """Posterior of a measurement (m,) with noise R (m, m); the prior where there is none."""
        if z is not None:
            self.y = z - Hx(self.x)
            self.x, self.P, self.S, self.nis = posterior(self.x, self.P, HJacobian(self.x), self.y, R)

    def advance(
        self, u: Any, z: Array | None, HJacobian: Callable[[Array], Array], Hx: Callable[[Array], Array], R: Array
    ) -> None:
        """`predict`, then `update`, as one call."""
        if z is None:
            self.predict(u)
            return
        self.predict_x(u)
        self.y, H = z - Hx(self.x), HJacobian(self.x)
        self.x, self.P, self.S, self.nis = extended_tick(self.x, self.P, self.F, self.Q, self.y, H, R)


__all__ = ["CompiledEkf", "CompiledKalman", "ExtendedKalmanFilter", "KalmanFilter"]
