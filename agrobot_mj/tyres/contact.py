"""Tyre model that uses MuJoCo's frictional contact instead of a tyre law, for comparison with the tyre laws.

The contact has no slip law: sliding is viscous, the cornering stiffness is proportional to speed and to `impratio`, and
a tractor without a brake creeps down slopes.
"""

from typing import Literal

from agrobot_mj.core.spec import Positive
from agrobot_mj.machine.tractor import TractorParameters
from agrobot_mj.tyres.base import NativeContact, Structure, TyreBase
from agrobot_mj.tyres.linear import LinearLaw


class Contact(TyreBase):
    """Tyre that uses MuJoCo's contact between wheel and ground."""

    kind: Literal["contact"] = "contact"
    friction: Positive = 0.8
    """Sliding friction coefficient [-]. Assumed value (range 0.6-0.8 in the field)."""
    impratio: Positive = 1.0
    """Friction stiffness divided by normal contact stiffness [-]. Assumed value: the default of the MuJoCo option."""

    @property
    def native(self) -> NativeContact:
        """Settings of the MuJoCo contact between wheel and ground."""
        return NativeContact(self.friction, self.impratio)

    def structure(self) -> Structure:
        """Return carcass parameters without damping, rolling resistance or scrubbing moment."""
        return Structure(relaxation_radii=1.0, bristle_damping_s=0.0)

    def coefficients(self, tractor: TractorParameters) -> tuple[LinearLaw, LinearLaw]:
        """Return tyre laws with zero force for a front and a rear tyre, because MuJoCo computes the force."""
        return LinearLaw(0.0, 0.0), LinearLaw(0.0, 0.0)
