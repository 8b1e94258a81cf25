"""What is at hand of a map, in the filter of N planar double integrators: taken, and told of."""

import numpy as np

from hcbf_gym.arrays import Array, Integers, Record, Records
from hcbf_gym.barriers import mapped
from hcbf_gym.barriers.mapped import Scene
from hcbf_gym.barriers.rows import U_MAX
from hcbf_gym.compilation import kernel
from hcbf_gym.filtering import axle_step
from hcbf_gym.filtering.plants import Drives


@kernel()
def of_plant(c: Record, drives: Drives, scene: Scene, atlas: Array, plant: Record) -> Scene:
    """Return the conditions of a plant, classes of a map replaced by their pieces at hand.

    Args:
        c: `plants.CONSTANTS`.
        drives: None of points, True of robots with an axle.
        scene: the plant's conditions.
        atlas: where the pieces stand.
        plant: `plants.PLANT`, looked at.
    """
    if drives is not None:
        known = axle_step.place(c, plant)
        return mapped.nearby(c, c.axle_rows, c.axle_rows[U_MAX], scene, atlas, known)
    return mapped.nearby(c, c.rows, c.radius, scene, atlas, plant)


@kernel()
def tell(source: Integers, part: Records, rows: Records) -> None:
    """Write what is said of the pieces at hand into the rows of their classes.

    A class is told the most that one of its pieces pays and reserves, and the least h and ψ of
    them; a class of which nothing is near pays and reserves nothing, and its h and ψ are infinite.

    Args:
        source: (M,) which condition each row stands for, ascending.
        part: (M,) `report.ROW`.
        rows: (m,) `report.ROW`, written to.
    """
    slack, delta, margin = rows["slack"], rows["delta"], rows["margin"]
    h, psi, conditioning = rows["h"], rows["psi"], rows["conditioning"]
    slack[:], delta[:], margin[:], conditioning[:] = 0.0, 0.0, 0.0, 0.0
    h[:], psi[:] = np.inf, np.inf
    for r in range(source.size):
        k = source[r]
        if r == 0 or k != source[r - 1]:  # of all that is no class, the only one
            rows[k] = part[r]
            continue
        slack[k] = max(slack[k], part["slack"][r])
        delta[k] = max(delta[k], part["delta"][r])
        margin[k] = max(margin[k], part["margin"][r])
        h[k], psi[k] = min(part["h"][r], h[k]), min(part["psi"][r], psi[k])
        conditioning[k] = max(conditioning[k], part["conditioning"][r])
