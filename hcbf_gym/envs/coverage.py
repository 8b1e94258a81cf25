"""For which arguments the promise that rank 1 is never entered was tested; everything else warns.

`BOUNDS` is the list, and the page "What is covered" shows it. Hostile episodes drew from all of it
at once (`evaluation.certification.mixture`), but for what the last line says was tested alone; what
is not on the list was not tested, or was entered.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, NamedTuple, Protocol

from hcbf_gym import certificates, records
from hcbf_gym.barriers import class_k
from hcbf_gym.barriers.class_k import LinearClassK, LogClassK
from hcbf_gym.envs.disturbances import RandomPushes, disturbance_from_dict
from hcbf_gym.envs.randomization import Randomization
from hcbf_gym.errors import CoverageWarning
from hcbf_gym.estimation import sensors
from hcbf_gym.estimation.sensors import Sensors
from hcbf_gym.models.plant import EXACT, Coverage, Plant
from hcbf_gym.models.reduced_order import DoubleIntegrator

SCENES = ("random", "random-moving", "random-wide")
"""The families of scenes in which the promise was tested."""

RANGES = {
    "floor_friction": (0.4, 0.8),
    "payload": (0.0, 4.0),
    "motor_strength": (0.8, 1.0),
    "delay": (0.0, 0.008),
    "sensor_noise": (0.0, 0.5),
}
"""The ranges of `Randomization` that are covered, all at once."""

LOAD = ((-0.08, 0.08), (-0.05, 0.05), (0.0, 0.08))
"""Where the payload may be, along each axis of the trunk [m]."""

CAPS = (0.5, 1.7)
"""The caps on the speed that are covered [m/s]; the plant's own may be lower than the one asked."""

LEAST_ABLE = 2.5
"""What U does in its weakest direction on the floor of least friction [m/s²]."""


class Declared(NamedTuple):
    """What the arguments of `A1RegionsEnv` declare.

    Attributes:
        own_robot: whether `xml_file` is None.
        feedback: as the environment takes it.
        timestep: [s].
        gait: as the environment takes it.
        friction: µ given by hand; None where it is derived.
        believed: µ that is derived.
        terrain: as the environment takes it.
        randomization: the plant's ranges.
        disturbances: as the environment takes it.
        estimation: as the environment takes it.
        body: as the environment takes it.
        boxes: how many the scene has.
        able: what U can do in its weakest direction, as the ground carries it [m/s²].
        v_max: the strict cap on the speed, lowered to what the plant carries [m/s].
    """

    own_robot: bool
    feedback: str
    timestep: float
    gait: str
    friction: float | None
    believed: float
    terrain: str
    randomization: Randomization
    disturbances: Mapping[str, Any] | None
    estimation: str | Mapping[str, Any] | Sensors | None
    body: str
    boxes: int
    able: float
    v_max: float

    @property
    def departures(self) -> list[str]:
        """Which things differ from their defaults that were tested all at once."""
        ground = self.terrain != "flat" or self.randomization.off_nominal
        told = {
            "an off-nominal plant": ground,
            "estimation": self.estimation is not None,
            "body": self.body != "point",
        }
        return [name for name, differs in told.items() if differs]

    @property
    def alone(self) -> list[str]:
        """Which things differ from their defaults that were tested with nothing else."""
        told = {
            "feedback": self.feedback != "position",
            "timestep": self.timestep != NOMINAL_TIMESTEP,
            "friction": self.friction is not None,
            "disturbances": self.disturbances is not None,
        }
        return [name for name, differs in told.items() if differs]


NOMINAL_TIMESTEP = 0.002


class Bound(NamedTuple):
    """How far an argument was tested.

    Attributes:
        argument: its name.
        tested: in words.
        of: what was declared.
        holds: whether that lies inside.
    """

    argument: str
    tested: str
    of: Callable[[Declared], Any]
    holds: Callable[[Declared], bool]


def _range(name: str, unit: str) -> Bound:
    """Return the bound of one of `RANGES`."""
    low, high = RANGES[name]

    def holds(d: Declared) -> bool:
        least, most = getattr(d.randomization, name)
        return low <= least and most <= high

    tested = f"{low:g} to {high:g}{unit}"
    return Bound(name, tested, lambda d: list(getattr(d.randomization, name)), holds)


def _estimation_holds(declared: Declared) -> bool:
    """Tell whether no sensor is worse than the worst preset's."""
    if declared.estimation is None:
        return True
    got = sensors.make(declared.estimation)
    worst = sensors.PRESETS["uwb"]
    return all(
        getattr(got, f.name) >= getattr(worst, f.name)
        if f.name in ("rate", "drift_time", "orientation_time", "slip_time")
        else getattr(got, f.name) <= getattr(worst, f.name)
        for f in fields(Sensors)
    )


def _payload_holds(declared: Declared) -> bool:
    place = zip(declared.randomization.payload_position, LOAD, strict=True)
    carried = declared.randomization.payload[1] > 0.0
    return not carried or all(low <= at <= high for at, (low, high) in place)


def _pushes_hold(declared: Declared) -> bool:
    if declared.disturbances is None:
        return True
    pushes = disturbance_from_dict(declared.disturbances)
    gentle = isinstance(pushes, RandomPushes)
    return gentle and max(pushes.impulse) <= 2.0 and pushes.interval >= 2.0


BOUNDS = (
    Bound("xml_file", "None, the package's own A1", lambda d: "another", lambda d: d.own_robot),
    Bound(
        "feedback",
        '"position" or "rom"',
        lambda d: d.feedback,
        lambda d: d.feedback in ("position", "rom"),
    ),
    Bound(
        "timestep",
        "0.001 to 0.005 s",
        lambda d: d.timestep,
        lambda d: 0.001 <= d.timestep <= 0.005,
    ),
    Bound("gait", '"trot"', lambda d: d.gait, lambda d: d.gait == "trot"),
    Bound(
        "friction",
        "at most three quarters of the least floor_friction, at least 0.3",
        lambda d: d.friction,
        lambda d: d.friction is None or 0.3 <= d.friction <= d.believed + 1e-9,
    ),
    Bound(
        "terrain",
        '"flat" or "rough"',
        lambda d: d.terrain,
        lambda d: d.terrain in ("flat", "rough"),
    ),
    _range("floor_friction", ""),
    _range("payload", " kg"),
    Bound(
        "payload_position",
        "x within ±0.08 m, y within ±0.05 m, z from 0 to 0.08 m",
        lambda d: list(d.randomization.payload_position),
        _payload_holds,
    ),
    _range("motor_strength", ""),
    _range("delay", " s"),
    _range("sensor_noise", ""),
    Bound(
        "disturbances",
        "None, or random pushes of at most 2 N·s every 2 s or less often",
        lambda d: d.disturbances,
        _pushes_hold,
    ),
    Bound(
        "estimation",
        'None, a preset, or sensors of which none is worse than the preset "uwb" has',
        lambda d: d.estimation,
        _estimation_holds,
    ),
    Bound(
        "body",
        '"point" or "footprint"',
        lambda d: d.body,
        lambda d: d.body in ("point", "footprint"),
    ),
    Bound("obstacles", "none", lambda d: f"{d.boxes} boxes", lambda d: d.boxes == 0),
    Bound(
        "input_set",
        f"at least {LEAST_ABLE} m/s² in every direction, once fitted to the floor",
        lambda d: f"{d.able:.3g} m/s²",
        lambda d: d.able >= LEAST_ABLE,
    ),
    Bound(
        "v_max",
        f"{CAPS[0]} to {CAPS[1]} m/s",
        lambda d: d.v_max,
        lambda d: CAPS[0] <= d.v_max <= CAPS[1],
    ),
    Bound(
        "alone",
        "feedback, timestep, friction and disturbances each with all else as by default, and v_max "
        "at most 1 m/s",
        lambda d: " and ".join([*d.alone, *d.departures, f"v_max {d.v_max}"]),
        lambda d: not d.alone or (len(d.alone + d.departures) == 1 and d.v_max <= 1.0),
    ),
)
"""What hostile episodes tested on the A1."""


def table() -> str:
    """Return `BOUNDS` as the page shows them, a table in Markdown."""
    return "\n".join(
        ("| argument | tested |", "|---|---|", *(f"| {b.argument} | {b.tested} |" for b in BOUNDS))
    )


def a1(declared: Declared) -> list[str]:
    """Return what of the declared lies outside of `BOUNDS`, a phrase for each; empty if covered.

    So does a program that no certificate of the A1 knows.
    """
    outside = [
        f"{bound.argument} {bound.of(declared)} (tested: {bound.tested})"
        for bound in BOUNDS
        if not bound.holds(declared)
    ]
    why = certificates.stale_shipped("HCBF-A1Regions-v0")
    return [*outside, why] if why else outside


def regions() -> bool:
    """Tell whether a shipped certificate knows today's reduced-order robot; warn if none does."""
    why = certificates.stale_shipped("HCBF-Regions-v0")
    if why:
        warnings.warn(
            f"HCBF-Regions-v0: rank 1 is not promised (covered = 0): nothing was tested on {why}",
            CoverageWarning,
            stacklevel=5,
        )
    return not why


def of_scene(source: Any, options: Mapping[str, Any]) -> Coverage:
    """Return what is known of an episode's scene.

    Args:
        source: the environment's argument `scenario`.
        options: those of the reset.
    """
    asked = options.get("scenario", source)
    tested = isinstance(asked, str) and asked in SCENES and "start" not in options
    return Coverage.COVERED if tested else Coverage.SCENE


class Asked(Protocol):
    """What the user asked of a filter, as far as it matters here; see `FilterSettings`."""

    @property
    def rows(self) -> str:
        """Return "held" or "usual"."""
        ...

    @property
    def margin(self) -> float | None:
        """Return what was given by hand [m]; None where it is derived."""
        ...

    @property
    def solver(self) -> str | None:
        """Return its name; None for the compiled programs."""
        ...

    @property
    def options(self) -> dict[str, Any]:
        """Return α₁, α₂ and the program's own."""
        ...


def of_filter(asked: Asked, plant: Plant) -> list[str]:
    """Return which of a filter's arguments were not tested, a phrase for each; empty if all were.

    On a double integrator that is its model any margin and any α whose row U can brake are as good.
    Nothing is said of plants that are not covered whatever the filter is.

    Args:
        asked: the filter's settings.
        plant: of the environment.
    """
    if isinstance(plant.covered, int) and plant.covered == Coverage.OUTSIDE:
        return []
    said = [] if asked.rows == "held" else [f"rows {asked.rows!r} (tested: 'held')"]
    if asked.solver is not None:
        said.append(f"solver {asked.solver!r} (tested: None)")
    if plant.uncertainty == EXACT and isinstance(plant.model, DoubleIntegrator):
        return said
    if asked.margin is not None:
        said.append(f"margin {asked.margin} m (tested: None)")
    alpha1 = class_k.make(asked.options.get("alpha1", LogClassK()))
    alpha2 = class_k.make(asked.options.get("alpha2", 2.0))
    if not _gentle(alpha1):
        said.append(f"alpha1 {alpha1} (tested: {LogClassK()})")
    if not (isinstance(alpha2, LinearClassK) and alpha2.gain <= LinearClassK().gain):
        said.append(f"alpha2 {alpha2} (tested: {LinearClassK()})")
    return said


def of_plant(plant: Plant, own: Plant) -> list[str]:
    """Return in what a plant is not the one that its environment brings, a phrase for each.

    Args:
        plant: that a filter was given.
        own: the environment's.
    """
    said = [
        f"another {name.replace('_', ' ')} than the environment's"
        for name in ("model", "input_set", "period", "state", "barriers", "to_action")
        if records.plain(getattr(plant, name)) != records.plain(getattr(own, name))
    ]
    reserved = zip(plant.uncertainty, own.uncertainty, strict=True)
    if any(less < needed for less, needed in reserved):
        said.append("a lower uncertainty than the environment's")
    return said


def _gentle(alpha1: class_k.ClassK) -> bool:
    """Tell whether α₁ is the paper's logarithm or one that is nowhere higher or steeper."""
    paper = LogClassK()
    return isinstance(alpha1, LogClassK) and (
        alpha1.phi1 <= paper.phi1 and alpha1.phi2 <= paper.phi2 and alpha1.phi3 >= paper.phi3
    )
