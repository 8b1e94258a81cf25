"""Draw the floor plans that ship with the package, as map files of Nav2, from rectangles in metres.

`python scripts/floor_plans.py` writes `hcbf_robots/maps/plans/`; a test holds the two together.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Rectangle = tuple[float, float, float, float]
"""Least x and y, greatest x and y [m]."""
Image8 = NDArray[np.uint8]

FOLDER = Path(__file__).parents[1] / "hcbf_robots" / "maps" / "plans"
RESOLUTION = 0.05
"""Side of a cell [m]."""
FREE, UNKNOWN, OCCUPIED = 254, 205, 0
"""Grey values of Nav2's trinary maps."""
YAML = """\
image: {image}
mode: trinary
resolution: 0.05
origin: [{x}, {y}, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


@dataclass(frozen=True)
class Plan:
    """A floor as rectangles, drawn one kind after the other.

    Args:
        size: of the image [m].
        house: what is wall where nothing is carved out of it; beyond it nothing is known.
        rooms: free.
        doors: free, through walls.
        things: furniture, shelves and pillars, occupied.
        zones: name → what its mask holds.
        origin: where the image's lower left corner lies in the world [m].
    """

    size: tuple[float, float]
    house: Rectangle
    rooms: tuple[Rectangle, ...]
    doors: tuple[Rectangle, ...]
    things: tuple[Rectangle, ...]
    zones: Mapping[str, tuple[Rectangle, ...]] = field(default_factory=dict)
    origin: tuple[float, float] = (0.0, 0.0)

    def images(self) -> dict[str, Image8]:
        """Return suffix → image, the upper row first: "" is the map, others are masks."""
        floor = self._paint(UNKNOWN, {OCCUPIED: (self.house,)})
        for value, rectangles in ((FREE, (*self.rooms, *self.doors)), (OCCUPIED, self.things)):
            for rectangle in rectangles:
                floor[self._cells(rectangle)] = value
        masks = {
            f"_{name}": self._paint(FREE, {OCCUPIED: zone}) for name, zone in self.zones.items()
        }
        return {suffix: image[::-1] for suffix, image in ({"": floor} | masks).items()}

    def _paint(self, ground: int, colors: Mapping[int, tuple[Rectangle, ...]]) -> Image8:
        columns, rows = (round(side / RESOLUTION) for side in self.size)
        image = np.full((rows, columns), ground, dtype=np.uint8)
        for value, rectangles in colors.items():
            for rectangle in rectangles:
                image[self._cells(rectangle)] = value
        return image

    @staticmethod
    def _cells(rectangle: Rectangle) -> tuple[slice, slice]:
        x0, y0, x1, y1 = (round(side / RESOLUTION) for side in rectangle)
        return slice(y0, y1), slice(x0, x1)


FLAT = Plan(
    size=(13.0, 10.0),
    house=(0.4, 0.4, 12.6, 9.6),
    origin=(-6.5, -5.0),
    rooms=(
        (0.6, 0.6, 6.4, 4.8),  # living room
        (6.55, 0.6, 9.8, 4.8),  # kitchen
        (9.95, 0.6, 12.4, 4.8),  # bathroom
        (0.6, 4.95, 12.4, 6.8),  # hall
        (0.6, 6.95, 5.0, 9.4),  # bedroom
        (5.15, 6.95, 8.6, 9.4),  # study
        (8.75, 6.95, 12.4, 9.4),  # nursery
    ),
    doors=(
        (2.4, 4.8, 4.0, 4.95),
        (7.2, 4.8, 8.8, 4.95),
        (10.4, 4.8, 12.0, 4.95),
        (6.4, 1.8, 6.55, 3.4),
        (2.6, 6.8, 4.2, 6.95),
        (6.0, 6.8, 7.6, 6.95),
        (10.0, 6.8, 11.6, 6.95),
    ),
    things=(
        (0.6, 0.6, 1.4, 2.8),  # sofa
        (3.0, 1.2, 4.2, 2.0),  # table
        (0.6, 4.2, 1.8, 4.8),  # shelf
        (6.55, 0.6, 9.8, 1.2),  # worktop
        (8.9, 3.2, 9.8, 4.2),  # table
        (11.6, 0.6, 12.4, 2.3),  # bath tub
        (9.95, 0.6, 10.5, 1.2),  # basin
        (0.6, 7.5, 2.6, 9.4),  # bed
        (4.4, 7.9, 5.0, 9.4),  # wardrobe
        (7.2, 8.7, 8.6, 9.4),  # desk
        (5.15, 8.2, 5.6, 9.4),  # shelf
        (8.75, 8.4, 10.5, 9.4),  # bed
        (0.6, 4.95, 1.0, 5.6),  # chest of drawers
    ),
    zones={
        "keepout": ((11.2, 7.8, 12.4, 9.4), (5.2, 0.6, 6.4, 1.6)),  # toys, plants
        "avoid": ((2.0, 2.3, 4.0, 3.2), (9.95, 1.6, 11.2, 3.0)),  # carpet, wet floor
        "slow": ((4.0, 4.95, 12.4, 6.8),),
    },
)

OFFICE = Plan(
    size=(24.0, 16.0),
    house=(0.4, 0.4, 23.6, 15.6),
    origin=(-2.0, -8.0),
    rooms=(
        (0.6, 7.0, 23.4, 9.0),  # corridor
        (0.6, 9.2, 5.6, 15.4),  # four offices
        (5.8, 9.2, 10.8, 15.4),
        (11.0, 9.2, 16.0, 15.4),
        (16.2, 9.2, 23.4, 15.4),
        (0.6, 0.6, 13.6, 6.8),  # open plan
        (13.8, 0.6, 18.6, 6.8),  # meeting room
        (18.8, 0.6, 23.4, 6.8),  # kitchen
    ),
    doors=(
        (2.4, 9.0, 4.0, 9.2),
        (7.4, 9.0, 9.0, 9.2),
        (12.6, 9.0, 14.2, 9.2),
        (18.0, 9.0, 19.6, 9.2),
        (2.0, 6.8, 4.0, 7.0),
        (10.0, 6.8, 12.0, 7.0),
        (15.2, 6.8, 16.8, 7.0),
        (20.2, 6.8, 21.8, 7.0),
        (13.6, 2.4, 13.8, 4.0),
    ),
    things=(
        *((x, 13.2, x + 1.8, 14.0) for x in (1.6, 7.4, 12.6, 17.4, 20.4)),  # desks
        *((x, 14.9, x + 3.0, 15.4) for x in (1.6, 6.8, 12.0)),  # shelves
        *((x, y, x + 1.6, y + 1.6) for x in (1.8, 5.4, 9.0) for y in (1.6,)),  # desk islands
        *((x, 4.4, x + 1.6, 5.0) for x in (5.4, 7.8)),
        (15.8, 2.6, 17.2, 4.2),  # meeting table
        (22.6, 0.6, 23.4, 5.0),  # worktop
        (19.6, 2.4, 21.0, 3.6),  # table
        (6.0, 7.0, 6.4, 7.4),  # pillars
        (11.2, 8.6, 11.6, 9.0),
        (17.4, 7.0, 17.8, 7.4),
    ),
    zones={
        "keepout": ((21.6, 10.0, 23.4, 13.0), (0.6, 0.6, 1.4, 4.0)),  # servers, plants
        "avoid": ((13.8, 5.0, 15.0, 6.8), (8.6, 10.4, 10.8, 12.8), (18.8, 3.8, 20.0, 5.6)),
        "slow": ((9.0, 7.0, 18.0, 9.0), (18.8, 0.6, 23.4, 6.8)),
    },
)

WAREHOUSE = Plan(
    size=(30.0, 20.0),
    house=(0.4, 0.4, 29.6, 19.6),
    origin=(-15.0, -10.0),
    rooms=(
        (0.6, 0.6, 29.4, 15.0),  # hall
        (0.6, 15.2, 10.0, 19.4),  # office
        (10.2, 15.2, 20.0, 19.4),  # packing
        (20.2, 15.2, 29.4, 19.4),  # loading
    ),
    doors=((4.0, 15.0, 6.0, 15.2), (13.6, 15.0, 16.6, 15.2), (23.0, 15.0, 27.0, 15.2)),
    things=(
        *((x, 3.0, x + 1.2, 7.4) for x in (3.0, 7.0, 11.0, 15.0, 19.0, 23.0)),  # racks
        *((x, 9.6, x + 1.2, 12.8) for x in (3.0, 7.0, 11.0, 15.0, 19.0, 23.0)),
        *((x, 7.4, x + 0.4, 7.8) for x in (3.4, 11.4, 19.4)),  # pillars
        (1.4, 17.6, 3.4, 18.6),  # desks
        (6.0, 17.6, 8.0, 18.6),
        (11.4, 16.6, 15.0, 17.6),  # packing tables
        (17.2, 18.0, 19.2, 19.4),
        (20.2, 18.4, 22.0, 19.4),  # pallets
        (27.6, 15.2, 29.4, 16.8),
    ),
    zones={
        "keepout": ((26.4, 0.6, 29.4, 5.0), (0.6, 12.0, 2.0, 15.0)),  # charging, switchboard
        "avoid": ((24.6, 6.4, 29.4, 9.6), (8.4, 13.2, 13.0, 15.0)),  # forklifts, goods in
        "slow": ((2.0, 7.4, 24.6, 9.6), (22.0, 13.2, 28.0, 16.4)),  # crossing, gate
    },
)

PLANS = {"flat": FLAT, "office": OFFICE, "warehouse": WAREHOUSE}


def main(folder: Path = FOLDER) -> None:
    """Write the files of all plans."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, plan in PLANS.items():
        x, y = plan.origin
        for suffix, image in plan.images().items():
            file = folder / f"{name}{suffix}.png"
            Image.fromarray(image).save(file, optimize=True, bits=8)
            file.with_suffix(".yaml").write_text(YAML.format(image=file.name, x=x, y=y))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
