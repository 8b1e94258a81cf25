"""The suite of guidance on maps: ways are walked, and the way out of a zone is measured."""

import numpy as np
import pytest

from benchmarks import map_guidance
from hcbf_robots.maps import MapClass, RankedMap


def test_a_corridor_is_walked_and_a_zone_left_by_the_way_that_the_field_shows():
    floor, (start, goal) = map_guidance.corridor(0.0)
    zone = np.zeros(floor.grid.shape, dtype=np.bool_)
    column = round(floor.grid.to_cells(start[None])[0, 0])
    zone[:, : column + 10] = True  # from the start half a metre towards the goal
    zoned = RankedMap(floor.grid, (*floor.classes, MapClass("zone", 2, "keepout", zone)))
    through = map_guidance.walk(floor, "rom", tuple(start), tuple(goal))
    assert through.arrived
    assert (through.entered, through.out, through.way_out) == (False, 0.0, 0.0)
    left = map_guidance.walk(zoned, "rom", tuple(start), tuple(goal), until_out=True)
    assert left.way_out == pytest.approx(0.5, abs=0.1)
    assert 0.0 < left.out < 5.0
