"""Default tyres that several tests simulate."""

from agrobot_mj.scenario.reference import families
from agrobot_mj.tyres.bearing import FIRM


def force_tyres():
    """Return a default instance of every tyre with its own force law, on firm ground."""
    kinds = families()["plant.tyre"].values()
    return [tyre for kind in kinds if (tyre := kind()).judged and tyre.structure().bearing == FIRM]
