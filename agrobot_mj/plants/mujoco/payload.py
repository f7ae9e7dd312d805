"""Payload: point masses that are added to or removed from the chassis during a run.

A payload changes mass, centre of mass and inertia. Derived quantities of MuJoCo (`mj_setConst`) are computed with a
separate MjData, so that the state is unchanged.
"""

from collections.abc import Iterable
from typing import NamedTuple

import mujoco
import numpy as np

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.signals import Array, PointMass
from agrobot_mj.plants.mujoco.clearance import quat_of, rotation_of
from agrobot_mj.plants.mujoco.model import is_physical_inertia, steiner
from agrobot_mj.plants.mujoco.views import CHASSIS

LEAST_KG = 1.0  # Minimum mass of the chassis [kg]


class Inertial(NamedTuple):
    """Mass properties of a body in its own frame."""

    mass: float  # Mass of the body [kg]
    centre: Array  # Centre of mass [m], shape (3,)
    inertia: Array  # Inertia about the centre of mass in body axes [kg m2], shape (3, 3)


def with_payload(bare: Inertial, payload: tuple[PointMass, ...]) -> Inertial:
    """Return the mass properties of a body with a payload. Raises `ScenarioError` if the result is not physical."""
    mass = bare.mass + sum(load.kg for load in payload)
    if mass < LEAST_KG:
        raise ScenarioError(f"mass_kg: only {mass:.0f} of {bare.mass:.0f} kg of the chassis remain; remove less mass")
    found = _join_masses(bare, payload, mass)
    if not is_physical_inertia(found.inertia):
        principal = np.round(np.linalg.eigvalsh(found.inertia), 1).tolist()
        raise ScenarioError(
            f"mass_kg: the resulting inertia of the chassis is not physical (principal moments {principal} kg m2); "
            f"use at most {100 * _fitting_share(bare, payload):.0f} % of this mass there, or move it towards the centre"
        )
    return found


def _fitting_share(bare: Inertial, payload: tuple[PointMass, ...]) -> float:
    """Return the maximum fraction of a payload for which the body is physically possible [-], in steps of 0.01."""
    for share in (percent / 100 for percent in range(99, 0, -1)):
        some = tuple(load._replace(kg=share * load.kg) for load in payload)
        if is_physical_inertia(_join_masses(bare, some, bare.mass + sum(load.kg for load in some)).inertia):
            return share
    return 0.0


def _join_masses(bare: Inertial, payload: tuple[PointMass, ...], mass: float) -> Inertial:
    """Return the mass properties of a body with its payload, without checks; `mass` is the total mass [kg]."""
    places = [np.array(load[1:]) for load in payload]
    moments = [load.kg * place for load, place in zip(payload, places, strict=True)]
    centre = (bare.mass * bare.centre + sum(moments, np.zeros(3))) / mass
    inertia = bare.inertia + steiner(bare.mass, bare.centre - centre)
    for load, place in zip(payload, places, strict=True):
        inertia = inertia + steiner(load.kg, place - centre)
    return Inertial(mass, centre, inertia)


def check_payloads(bare: Inertial, loadings: Iterable[tuple[int, tuple[PointMass, ...]]]) -> None:
    """Raise a ValueError with the key of the fault if one of the payloads makes the chassis physically impossible."""
    for k, payload in loadings:
        try:
            with_payload(bare, payload)
        except ValueError as error:
            raise ValueError(f"fault[{k}].{error}") from None


class Chassis:
    """Chassis of a MuJoCo model in a run, with its payload."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.payload: tuple[PointMass, ...] = ()
        self.written = [array[CHASSIS].copy() for array in self._arrays]
        mass, centre, principal, quat = self.written
        axes = rotation_of(quat)
        self.bare = Inertial(float(mass), centre, axes @ np.diag(principal) @ axes.T)

    @property
    def _arrays(self) -> tuple[Array, Array, Array, Array]:
        m = self.model
        return m.body_mass, m.body_ipos, m.body_inertia, m.body_iquat

    def carry(self, payload: tuple[PointMass, ...]) -> None:
        """Replace the payload of the chassis. Raises ValueError if the result is physically impossible."""
        if payload == self.payload:
            return
        for array, value in zip(self._arrays, self._values(payload), strict=True):
            array[CHASSIS] = value
        self.model.body_sameframe[CHASSIS] = 0  # the axes of the inertia now differ from those of the body
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))
        self.payload = payload

    def _values(self, payload: tuple[PointMass, ...]) -> list[Array]:
        """Return the mass, centre of mass, principal moments and axes (quaternion) of the chassis with a payload."""
        if not payload:
            return self.written
        mass, centre, inertia = with_payload(self.bare, payload)
        principal, axes = np.linalg.eigh(inertia)
        axes[:, 2] *= np.linalg.det(axes)  # right-handed
        return [np.array(mass), centre, principal, quat_of(axes)]
