"""What the compiled core reads and writes: constants and plants, as its `plants.hpp` has them."""

from functools import cache

import numpy as np

from hcbf_gym.arrays import Array, Records
from hcbf_gym.barriers.rows import SETTINGS_WIDTH
from hcbf_gym.filtering import monitor
from hcbf_gym.models.plant import Uncertainty
from hcbf_gym.programs.planar.records import Settings

COMPARED, NEWS = 1, 2
"""What came in unforeseen: barriers that are compared with those before; whatever it is, others, or
a state after none."""

CONSTANTS = np.dtype(
    (
        np.record,
        np.dtype(
            [
                # the program, as `planar.records.Settings` has it
                ("lower", "i8"),
                ("by_level", "?"),
                ("lock", "i8"),
                ("ranks", "?"),
                ("guided", "?"),
                ("radius", "f8"),
                ("lambda_u", "f8"),
                ("known_offset", "?"),
                ("corners", "i8"),  # of a U
                ("input_sets", "i8"),  # 1, or one a plant
                ("weights", "i8"),  # of a state
                ("made", "?"),  # whether rows, alarms and braking inputs were made beforehand
                # what the rows keep, and how they are made
                *((name, "f8") for name in Uncertainty._fields),
                ("rows", "f8", SETTINGS_WIDTH),  # `RowSettings.packed`
                ("period", "f8"),  # T [s], 0 where it is not known
                ("rounding", "f8"),  # of an input that is told in 32 bits, 0 for 64 [m/s²]
                ("dip", "f8"),  # what usual rows reserve against dips between samples
                ("sway", "f8"),  # what of d a robot may use that is not its model
                ("settles", "f8"),  # how long the robot takes to follow [s], 0 for its model
                # a differential drive
                ("drives", "?"),
                ("axle", "f8", 4),  # `models.axle.Axle`
                ("axle_rows", "f8", SETTINGS_WIDTH),  # `RowSettings.packed` of rows on the axle
                ("jerk", "f8"),  # what these reserve of the acceleration [m/s²]
                # guidance
                ("has_way", "?"),
                ("through", "i8"),  # the highest rank that gives way to guidance, 0 for none
                ("brakes", "?"),  # whether an alarm makes the filter brake
                ("observed", "?"),  # whether states were measured, and are compared here
            ],
            align=True,  # so that it is made of whole numbers
        ),
    )
)
"""What a filter never changes."""


@cache
def plant_dtype(n_u: int) -> np.dtype[np.void]:
    """Return what is known of one plant of so many inputs; zeros at a reset.

    Vectors of length 4 are those of the planar double integrator. Those of other models stand
    beside the record, see `belief.State`.
    """
    fields: list[tuple[object, ...]] = [
        # what is said of it now, as `models.plant.Estimate` has it
        ("x", "f8", 4),
        ("time", "f8"),
        ("model", "f8", 4),
        ("lag", "f8", 4),
        ("covariance", "f8", (4, 4)),
        ("elapsed", "f8"),  # since the sample before [s]; 0 where that is not known
        ("fault", "i8"),  # a `Reason` that was found on the way here; 0 for none
        ("has_model", "i8"),  # whether the model has a state of its own; x is that if not
        ("heading", "f8"),  # of a differential drive [rad]
        # where guidance leads
        ("way", "f8", 3),  # a_x, a_y and b of its row
        ("turns", "i8"),  # whether a differential drive turns to it, against u*
        ("turn", "f8"),  # by which acceleration across its heading then [m/s²]
        ("reachable", "f8"),  # through which rank
        ("lost", "i8"),  # whether it finds no path to the goal
        ("zone", "f8"),  # the rank of the map's zone that it stands in, 0 for none
        # what is remembered from step to step
        *monitor.MEMORY,
        *monitor.PLANAR_MEMORY,
        ("expected", "f8", 2),  # velocity of the model at the last sample [m/s]
        ("vague", "f8", 3),  # xx, xy and yy of its covariance at the last sample [m²/s²]
        ("growth", "f8"),  # what that grew by when it grew last [m²/s²]
        ("believed", "f8", 4),  # the last state that was
        ("headed", "f8"),  # the heading then [rad]
        ("believed_at", "f8"),  # its time [s]
        ("follows", "i8"),  # whether the last sample was believed
        ("known", "i8"),  # whether any was, since the reset
        ("news", "i8"),  # `COMPARED` or `NEWS`, 0 for nothing
        ("kept", "f8"),  # the least h − m at this sample [m]; with news, of the barriers before
        ("headway", "f8"),  # likewise the least ψ [m/s]
        ("unproved", "i8"),  # whether news left something short, until nothing is
        ("closing", "f8"),  # for how long ψ has been below zero [s]
        ("alarm", "i8"),  # a `Reason`, until the next reset
        ("moves", "i8"),  # whether a region is nearer than its velocity explains
        ("input", "f8", (n_u,)),  # applied since the last sample
        ("stop", "f8", (n_u,)),  # of U, brings a plant of another model to rest
    ]
    return np.dtype((np.record, fields))


PLANT = plant_dtype(2)
"""What is known of one plant of two inputs."""


def constants(settings: Settings, others: dict[str, object]) -> tuple[Array, Array]:
    """Return the numbers of a `CONSTANTS`; and the corners of U, the program's weights behind them.

    Args:
        settings: of the program.
        others: the rest of the constants, by their names.
    """
    record = np.zeros(1, dtype=CONSTANTS)
    own = settings._asdict()
    vertices, weights = own.pop("vertices"), own.pop("weights")
    sizes = {"corners": vertices.shape[1], "input_sets": 1, "weights": weights.shape[1]}
    for name, number in (own | sizes | others).items():
        record[name] = number
    return record.view(np.float64), _numbers(vertices, weights)


def solved_outside(radius: float) -> Settings:
    """Return the settings of a program that a solver outside answers.

    Args:
        radius: the largest norm of an input.
    """
    nothing = np.zeros((1, 1, 2)), np.zeros((1, 1))
    return Settings(0, False, 0, True, False, radius, 0.0, False, *nothing)


def with_vertices(constants: Records, program: Array, vertices: Array) -> Array:
    """Return a program for the U of each plant, (N, V, 2) corners; the constants are written to."""
    weights = program[2 * int(constants["corners"][0] * constants["input_sets"][0]) :]
    constants["input_sets"], constants["corners"] = vertices.shape[:2]
    return _numbers(vertices, weights)


def _numbers(vertices: Array, weights: Array) -> Array:
    """Return the corners of U with the program's weights behind them."""
    return np.concatenate([vertices.ravel(), weights.ravel()])
