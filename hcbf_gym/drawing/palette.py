"""The colours of everything drawn: ranks, programs, the path, the reference, boxes and floor.

Ranks differ in lightness as well as in hue, so that they stay apart for the colour-blind; see
Okabe and Ito, "Color Universal Design", 2008, from whom most colours come.
"""

PRIORITY_COLORS = ("#b2182b", "#e69f00", "#56b4e9", "#5e3c99", "#7f7f7f")
"""Colours of the priorities 1, 2, …; the last one serves all that follow."""

PROGRAM_COLORS = {
    "none": "#7f7f7f",
    "cbf-qp": "#8c564b",
    "r-cbf-qp": "#000000",
    "h-cbf-qp": "#0072b2",
    "ih-cbf-qp": "#cc79a7",
    "eh-cbf-qp": "#d55e00",
    "lex-cbf-qp": "#009e73",
}
"""A program has one colour in all figures."""

OTHER_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8c564b", "#000000")
"""Colours of programs that are not in `PROGRAM_COLORS`, in turn."""

PATH, REFERENCE, GOAL = "#0072b2", "#404040", "#111111"
SPEED_ZONE = "#009e73"
FIXED_BOX, LIGHT_BOX = "#8c6b4d", "#f2cc26"
FLOOR, FLOOR_TILE, FLOOR_LINE = "#e9e9e4", "#dededa", "#55554f"


def priority_color(priority: int) -> str:
    """Return the colour of a priority (1, 2, …) as "#rrggbb"."""
    return PRIORITY_COLORS[min(priority, len(PRIORITY_COLORS)) - 1]


def program_color(program: str, place: int = 0) -> str:
    """Return a program's colour as "#rrggbb"; of a user's program by its place in the figure."""
    return PROGRAM_COLORS.get(program, OTHER_COLORS[place % len(OTHER_COLORS)])


def paler(color: str, share: float = 0.3) -> str:
    """Return "#rrggbb" mixed with a share of white in [0, 1], for areas."""
    channels = (channel + share * (1.0 - channel) for channel in rgba(color)[:3])
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in channels)


def rgba(color: str, opacity: float = 1.0) -> tuple[float, float, float, float]:
    """Return (r, g, b, opacity), each in [0, 1], of "#rrggbb"."""
    red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue, opacity
