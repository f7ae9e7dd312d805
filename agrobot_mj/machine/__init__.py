"""Parameters of the tractor and its actuators, shared by all plants."""

from typing import NamedTuple

from agrobot_mj.machine.driveline import Driveline
from agrobot_mj.machine.hydraulics import LITRE_PER_MINUTE, Cylinder, Valve
from agrobot_mj.machine.implements import ImplementBase, NoImplement
from agrobot_mj.machine.linkage import Linkage
from agrobot_mj.machine.tractor import TractorParameters


class Machine(NamedTuple):
    """Parameters of the tractor, its actuators and its implement, shared by all plants."""

    tractor: TractorParameters = TractorParameters()  # Geometry, masses and tyres of the tractor
    valve: Valve = Valve()  # Steering valve and pump
    cylinder: Cylinder = Cylinder()
    driveline: Driveline = Driveline()  # Driveline, from the pedal to the rear wheels
    implement: ImplementBase = NoImplement()  # Implement at the hitch
    linkage: Linkage = Linkage()  # Kingpins and steering linkage

    @property
    def steering_rate(self) -> float:
        """Steering rate at the maximum flow of the valve [rad/s]."""
        return self.valve.largest_flow * LITRE_PER_MINUTE / self.cylinder.displacement


__all__ = ["Cylinder", "Driveline", "Linkage", "Machine", "TractorParameters", "Valve"]
