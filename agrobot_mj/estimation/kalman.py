"""The two Kalman filters of filterpy, imported without the statistics that only its other members use.

filterpy loads `scipy.stats` and `scipy.ndimage` for densities and discrete filters: half a second, a quarter of a run
of one simulated second. While filterpy is imported, names stand in for the functions that it takes from them; each
fetches the real one when it is called. So all of filterpy works for whoever imports it later.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

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

__all__ = ["ExtendedKalmanFilter", "KalmanFilter"]
