"""Maps: occupancy grids, masks and scans, and the ranked shapes that cover them."""

from hcbf_gym.maps.grid import KINDS, Grid, MapClass
from hcbf_gym.maps.ranked_map import RankedMap

__all__ = ["KINDS", "Grid", "MapClass", "RankedMap"]
