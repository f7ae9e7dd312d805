"""MuJoCo's own frictional contact as the tyre.

The contact has no slip law: sliding is viscous, with a cornering stiffness proportional to speed and to `impratio`, and
the tractor creeps down a slope without the brake. Included for comparison.
"""

from typing import Literal

from agrobot_mj.core.spec import Positive
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.base import NativeContact, Structure, TyreBase
from agrobot_mj.tyres.linear import LinearLaw


class Contact(TyreBase):
    """Native wheel contact."""

    kind: Literal["contact"] = "contact"
    friction: Positive = 0.8
    """Sliding friction coefficient [-]. Assumed value (0.6-0.8 in the field)."""
    impratio: Positive = 1.0
    """Friction stiffness / normal contact stiffness, see MuJoCo's `option` [-]. Assumed value: MuJoCo's default."""

    @property
    def native(self) -> NativeContact:
        """Settings of MuJoCo's contact."""
        return NativeContact(self.friction, self.impratio)

    def structure(self) -> Structure:
        """Return a carcass without compliance:  a relaxation length of one radius, which is unused."""
        return Structure(relaxation_radii=1.0, bristle_damping_s=0.0)

    def coefficients(self, tractor: TractorParameters) -> tuple[LinearLaw, LinearLaw]:
        """Return a law without force."""
        return LinearLaw(0.0, 0.0), LinearLaw(0.0, 0.0)
