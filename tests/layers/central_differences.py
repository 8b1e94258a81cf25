"""Derivatives of u beside central differences, and what the layers' tests share."""

import numpy as np

from hcbf_gym.barriers import (
    BrakeClassK,
    Capsule,
    ConvexPolygon,
    Disc,
    Ellipse,
    HalfPlane,
    LinearClassK,
    SpeedLimit,
)
from hcbf_gym.layers.flat import FlatFilter
from hcbf_gym.models import Ball, Box
from tests.worlds import with_others

SETTINGS = {
    "usual": {"input_set": Box((-4.0, -3.0), (4.0, 3.0))},
    "held": {"input_set": Box((-4.0, -3.0), (4.0, 3.0)), "period": 0.05},
    "held, disc": {"input_set": Ball(4.0), "period": 0.1},
    "held, brake": {
        "input_set": Box((-4.0, -3.0), (4.0, 3.0)),
        "period": 0.05,
        "alpha1": BrakeClassK(2.0, 0.2),
        "alpha_speed": LinearClassK(3.0),
    },
}
BARRIERS = [
    HalfPlane("wall", 1, normal=(0.8, 0.6), offset=-1.0),
    Disc("disc", 2, center=(2.0, 0.1), radius=1.0, velocity=(0.1, 0.0)),
    SpeedLimit("speed", 2, v_max=1.0),
]
PER_SCENE = 50
STEPS = 1e-6, 1e-5, 1e-7


def arrays(count=6):
    """Return nominal inputs (N, 2) and states (N, 4) among `BARRIERS`."""
    rng = np.random.default_rng(0)
    u_nominal, v = rng.normal(size=(2, count, 2))
    return 3.0 * u_nominal, np.hstack([rng.uniform(-1.0, 3.0, (count, 2)), v])


def scene(rng, ranks):
    """Return a barrier of each kind around the origin, half of them moving, with random ranks."""
    turn, (a, b, c, d, e) = rng.uniform(0.0, 6.28), rng.uniform(-2.5, 2.5, (5, 2))
    moving = {"velocity": rng.uniform(-0.4, 0.4, 2)} if rng.random() < 0.5 else {}
    angles = turn + np.arange(5) * 1.2566
    corners = c + np.column_stack([np.cos(angles), np.sin(angles)])
    ranks = 1 + np.unique(rng.integers(0, ranks, 6), return_inverse=True)[1]
    return with_others(
        HalfPlane("wall", ranks[0], normal=(np.cos(turn), np.sin(turn)), offset=-2.0),
        Disc("disc", ranks[1], center=a, radius=0.8, **moving),
        Ellipse("ellipse", ranks[2], center=b, semi_axes=(1.2, 0.5), angle=turn, **moving),
        ConvexPolygon("polygon", ranks[3], vertices=corners),
        Capsule("capsule", ranks[4], start=d, end=e, radius=0.3, **moving),
        SpeedLimit("speed", ranks[5], v_max=1.5),
    )


def points(rng, flat, count):
    """Return variables (N, K) of states among the barriers, and times."""
    m = len(flat.blocks)
    own = np.concatenate(
        [np.broadcast_to(flat.blocks, (count, m, 19)), rng.uniform(0.0, 0.05, (count, m, 3))], 2
    )
    u_nominal, v = rng.normal(size=(2, count, 2))
    p = rng.uniform(-3.0, 3.0, (count, 2))
    return np.hstack([3.0 * u_nominal, p, v, own.reshape(count, -1)]), rng.uniform(0.0, 1.0, count)


def compare(rng, name, program="lex-cbf-qp", ranks=4, **options):
    """Return the greatest relative errors (N,) at points of one scene, NaN where it is not generic,
    and the statuses (N,).

    A point is not generic if the filter reports it, or if slopes to either side differ: a kink is
    within 1e-6 then. Of three steps the best one counts: curvature spoils the long ones, and the
    rounding of u in an ill-conditioned conflict, some 1e-11, the short ones.
    """
    flat = FlatFilter(scene(rng, ranks), program=program, **SETTINGS[name], **options)
    v, t = points(rng, flat, PER_SCENE)
    u, status, degenerate = flat.filter(v, t)
    of_u = np.stack([flat.pull_back(v, t, np.broadcast_to(w, u.shape)) for w in np.eye(2)], 1)
    each, bends = zip(*(differences(flat, v, t, u, of_u, step) for step in STEPS), strict=True)
    steep = 1.0 + np.abs(of_u).max((1, 2))
    is_generic = ~degenerate & (bends[0] < 1e-4 * steep**2)
    return np.where(is_generic, np.min(each, axis=0), np.nan), status


def differences(flat, v, t, u, of_u, step):
    """Return the greatest errors of derivatives (N,), and how much slopes to either side differ."""
    steps = step * np.eye(v.shape[1])
    steps[8 + 22 * 3] = 0.0  # the number of a polygon's corners
    times = np.repeat(t[:, None], len(steps), 1)
    ahead, behind = (flat.filter(v[:, None] + side * steps, times)[0] for side in (1.0, -1.0))
    slopes = (ahead - behind).transpose(0, 2, 1) / (2.0 * step)
    bend = np.abs(ahead - 2.0 * u[:, None] + behind).max((1, 2)) / step
    return (np.abs(slopes - of_u) / (1.0 + np.abs(of_u))).max((1, 2)), bend
