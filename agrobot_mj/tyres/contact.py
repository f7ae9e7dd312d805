"""MuJoCo's own frictional contact as the tyre: what one gets for free.

It has no slip law: sliding creeps like a viscous fluid, with a cornering stiffness that is proportional to speed and to
`impratio`, and it creeps down a slope when parked. Here for comparison.
"""

from typing import Literal

from agrobot_mj.core.spec import Positive, Spec


class Contact(Spec):
    """Native wheel contact."""

    kind: Literal["contact"] = "contact"
    friction: Positive = 0.8
    """Sliding friction coefficient [-]. Estimate (0.6-0.8 in the field)."""
    impratio: Positive = 1.0
    """Stiffness of friction over that of the normal contact, see MuJoCo's `option` [-]. MuJoCo's default."""
