"""Maps: occupancy grids, masks and scans, and the ranked shapes that cover them."""

from hcbf_gym.maps.map_class import KINDS, MapClass
from hcbf_gym.maps.paying import Paying, paying
from hcbf_gym.maps.ranked_map import RankedMap
from hcbf_gym.maps.scan import Scan, points_of
from hcbf_gym.models.grid import Grid

__all__ = ["KINDS", "Grid", "MapClass", "Paying", "RankedMap", "Scan", "paying", "points_of"]
