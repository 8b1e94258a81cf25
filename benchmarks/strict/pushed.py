"""Pushes into a strict region: whether the filter reports it, and when the robot comes out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.common import table
from hcbf_gym import policies, wrappers
from hcbf_gym.evaluation import attacks
from hcbf_gym.evaluation.rollouts import SHOWN_OPTIONS
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.policies import learned
from hcbf_gym.programs import FilterStatus

PROGRAMS = ("r-cbf-qp", "h-cbf-qp", "ih-cbf-qp", "eh-cbf-qp", "lex-cbf-qp")
POLICIES = ("pd", *learned.names())
SEEDS = 10  # For each program and policy
FIRST_SEED = 80_000

NEAR = 0.12  # How near an edge the robot is when it is pushed [m]
IMPULSE = (25.0, 30.0)  # Of the push [N·s]
STEPS = 5  # How long the push lasts [control steps]
SECONDS = 5.0  # How long the robot is watched from the push on
OUT_WITHIN = 2.5  # How long it may take to come out [s]


@dataclass(frozen=True)
class PushedEpisode:
    """What to run: the robot walks at the nearest strict edge, is pushed over it, and walks on."""

    program: str  # of the filter
    policy: str  # from the push on
    seed: int  # of the environment, and of the push's strength

    def run(self) -> "PushedOutcome":
        """Run the episode until `SECONDS` after the push."""
        env = gym.make("HCBF-A1Regions-v0", scenario="random", max_episode_steps=None)
        options = SHOWN_OPTIONS.get(self.program, {})
        env = wrappers.SafetyFilter(env, program=self.program, **options)
        try:
            return self._rollout(env)
        finally:
            env.close()

    def _rollout(self, env: gym.Env) -> "PushedOutcome":
        observation, info = env.reset(seed=self.seed)
        inner: Any = env.unwrapped
        rng = np.random.default_rng(self.seed)
        approach, policy = attacks.Nearest(rng), policies.make(self.policy, env)
        around = attacks.observe(env)
        while around.h[0] > NEAR and inner.time < 20.0:
            observation, _, _, _, info = env.step(approach.act(around))
            around = attacks.observe(env)
        force = rng.uniform(*IMPULSE) / (STEPS * 0.02)
        inner.simulation.push(np.array([*(-force * around.normal[0]), 0.0]))
        near, h, status, fell = float(around.h[0]), [], [], False
        for step in range(round(SECONDS / 0.02)):
            if step == STEPS:
                inner.simulation.push(np.zeros(3))
            h.append(float(attacks.observe(env).h[0]))
            action = np.asarray(policy(observation, info), dtype=np.float64)
            observation, _, ended, _, info = env.step(action)
            status.append(int(info["safety_filter"]["status"]))
            fell = fell or bool(info["fallen"])
            if ended:
                break
        inside = np.flatnonzero(np.array(h) < 0.0)
        unsafe = np.array(status)[inside] == FilterStatus.UNSAFE
        return PushedOutcome(
            near=near,
            depth=max(0.0, -min(h)),
            inside=len(inside),
            reported=int(unsafe.sum()),
            seconds=0.02 * float(inside[-1] + 1 - inside[0]) if len(inside) else 0.0,
            fell=fell,
        )


@dataclass(frozen=True)
class PushedOutcome:
    """What one push showed, on the truth at every control step."""

    near: float  # distance from the edge when the push began [m]
    depth: float  # how deep the robot got [m]
    inside: int  # control steps that began inside a strict region
    reported: int  # those of them with the status UNSAFE
    seconds: float  # from the first of them to the end of the last [s]
    fell: bool  # whether the robot fell


def run(quick: bool, kept: Callable[..., Any]) -> list[dict[str, Any]]:
    """Push the robot under every program and policy; return a row for each program."""
    rows = []
    for program in PROGRAMS:
        episodes = [
            PushedEpisode(program, policy, FIRST_SEED + seed)
            for policy in POLICIES[: 1 if quick else None]
            for seed in range(1 if quick else SEEDS)
        ]
        outcomes = kept(episodes, title=f"pushed: {program}")
        rows.append({"program": program} | summary(outcomes))
    return rows


def summary(outcomes: Sequence[PushedOutcome]) -> dict[str, Any]:
    """Return a row of its pushes."""
    seconds = [o.seconds for o in outcomes]
    return {
        "pushes": len(outcomes),
        "farthest": max(o.near for o in outcomes),
        "entered": sum(o.inside > 0 for o in outcomes),
        "deepest": max(o.depth for o in outcomes),
        "steps_inside": sum(o.inside for o in outcomes),
        "told": sum(o.reported for o in outcomes),
        "longest": max(seconds),
        "median": float(np.median([s for s in seconds if s > 0.0] or [0.0])),
        "late": sum(s > OUT_WITHIN for s in seconds),
        "falls": sum(o.fell for o in outcomes),
    }


def tables(rows: Sequence[dict[str, Any]]) -> Table:
    """Return the table of all programs."""
    columns = {
        "program": "{program}", "pushes": "{pushes}", "pushed in": "{entered}",
        "deepest [m]": "{deepest:.2f}", "steps inside": "{steps_inside}",
        "of these UNSAFE": "{told}", "median time inside [s]": "{median:.2f}",
        "longest [s]": "{longest:.2f}", f"longer than {OUT_WITHIN} s": "{late}", "falls": "{falls}",
    }  # fmt: skip
    title = f"{IMPULSE[0]:.0f} to {IMPULSE[1]:.0f} N·s within {100 * NEAR:.0f} cm of an edge"
    return table(title, rows, columns)
