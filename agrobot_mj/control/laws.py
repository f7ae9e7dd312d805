"""Built-in guidance laws that do not wrap another law, and can be wrapped by laws of the extensions."""

from agrobot_mj.control.feedforward import Feedforward
from agrobot_mj.control.kinematic import Kinematic
from agrobot_mj.control.lqr import Lqr
from agrobot_mj.control.nmpc import Nmpc
from agrobot_mj.control.pure_pursuit import PurePursuit
from agrobot_mj.control.stanley import Stanley

InnerLaw = (
    Kinematic
    | Feedforward
    | PurePursuit
    | Stanley
    | Lqr
    | Nmpc
)  # fmt: skip
"""Union type of the guidance laws that do not wrap another law; the key `kind` selects the law."""
