"""The guidance laws that need no other law inside; a law around another takes one of them."""

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
"""Guidance laws by `kind`, without those that contain another."""
