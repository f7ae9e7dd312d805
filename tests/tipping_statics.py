"""Static tip-over angles of a parked tractor, including its roll on the tyres, the compliance of the carcasses and the
pivot of the front axle."""

from math import cos, radians, sin, sqrt

from scipy.optimize import brentq

from agrobot_mj.extensions.bench.manoeuvres.theory import parts
from agrobot_mj.machine.tractor import GRAVITY


def twist(wheel):
    """Return the stiffness of a contact patch against turning [N m/rad], for a slip stiffness of 10 times the load."""
    a = sqrt(2 * wheel.radius * wheel.deflection)
    return 10 * wheel.load * (a / 3 + wheel.width**2 / (12 * a))


def tipping_deg(tractor, carcass, hold=True, share=0.45):
    """Return the slope [deg] at which the moments of the body about the line from the pivot to the rear patch balance.

    `share` is the lateral stiffness of the carcass divided by its vertical stiffness [-]. With `carcass`, the load
    follows the lateral deflection of the carcass.

    The rear, on one wheel, yields more to the side than the front. With `hold` the patches resist this yaw,
    by a moment that also acts about the inclined line, and the brake holds the weight along the tractor at that wheel.
    """
    body, L, T, k = parts(tractor), tractor.wheelbase_m, tractor.track_m, tractor.rear_wheel.stiffness
    on_front, on_rear = (
        tractor.mass_kg * tractor.front_load_fraction,
        tractor.mass_kg * (1 - tractor.front_load_fraction),
    )
    turning = 2 * twist(tractor.front_wheel) + twist(tractor.rear_wheel)
    rear, front = share * k, 2 * share * tractor.front_wheel.stiffness

    def righting(deg):
        across, down = GRAVITY * sin(radians(deg)), GRAVITY * cos(radians(deg))
        beside = T / 2 - (on_rear * across / rear if carcass else 0.0)
        net = turning - tractor.mass_kg * across * beside if hold else 0.0
        q = net / L**2
        apart = across * (on_rear / rear - on_front / front) / (1 + q / rear + q / front)
        yaw = apart / L if hold else 0.0
        load = on_rear * down + tractor.mass_kg * across * yaw * tractor.cg_height_m / L
        aside = (on_rear * across - q * apart) / rear if carcass else 0.0
        rise = (on_rear * GRAVITY - load) / (2 * k)
        arm = body.body_z - body.pivot_z * body.body_x / L + rise * (1 - body.body_x / L)
        lean = load / (k * (T - aside))  # only the carcass of the loaded lower wheel is deflected
        held = net * yaw * body.pivot_z / L
        return load * (T / 2 - aside) + held - body.body_kg * arm * (across + down * lean)

    return brentq(righting, 1.0, 60.0)
