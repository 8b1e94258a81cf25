"""Maps: occupancy grids, masks and scans, and the ranked shapes that cover them."""

from hcbf_gym.models.grid import Grid
from hcbf_robots.maps.map_class import KINDS, MapClass
from hcbf_robots.maps.paying import Paying, paying
from hcbf_robots.maps.ranked_map import RankedMap
from hcbf_robots.maps.scan import Scan, points_of

__all__ = ["KINDS", "Grid", "MapClass", "Paying", "RankedMap", "Scan", "paying", "points_of"]
