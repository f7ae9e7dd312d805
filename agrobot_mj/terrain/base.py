"""What every terrain is: a relief, and patches of special ground on it."""

from functools import lru_cache

from agrobot_mj.spec import Spec
from agrobot_mj.terrain.grid import Ground
from agrobot_mj.terrain.patches import Patch, surface


class Landscape(Spec):
    """A terrain; a kind overrides `relief`."""

    kind: str
    patch: tuple[Patch, ...] = ()
    """Ground with properties of its own; of patches that overlap the last one counts."""

    def relief(self) -> Ground:
        """The height grid alone. Raises ValueError, naming the key, when there is none to be had."""
        raise NotImplementedError

    def stamp(self) -> tuple[object, ...]:
        """Changes whenever a file that the relief or a patch is read from does."""
        return ()

    def ground(self) -> Ground:
        """The height grid with the properties of the ground. Raises ValueError, naming the key."""
        return _ground(self, self.stamp())


@lru_cache(maxsize=4)
def _ground(landscape: Landscape, stamp: tuple[object, ...]) -> Ground:
    relief = landscape.relief()
    return relief._replace(surface=surface(landscape.patch, relief.extent)) if landscape.patch else relief
