"""The environments of one robot, and how tests make and drive them."""

import sys
from itertools import islice
from pathlib import Path

import gymnasium as gym
import pytest

import hcbf_robots  # noqa: F401 - registers walkers
from hcbf_gym import policies, wrappers
from hcbf_gym.evaluation.episode import samples

sys.path.insert(0, str(Path(__file__).parents[1] / "robots"))
from walkers import CARTS, LEARNED

ROM, A1, WALKER = "HCBF-Regions-v0", "HCBF-A1Regions-v0", "HCBF-WalkerRegions-v0"
WALKERS = (*CARTS, *LEARNED)
KINDS = (ROM, A1, *WALKERS)
CODES = {"status", "reason", "covered", "covered_by", "proved", "verified"}


def make(kind, **options):
    """Return an environment by its id, or of a walker by its name."""
    given = {} if kind in (ROM, A1) else {"robot": kind}
    return gym.make(WALKER if given else kind, **given, **options)


def filtered(kind, **options):
    return wrappers.SafetyFilter(make(kind, **options), program="h-cbf-qp")


def run(env, steps, seed=0):
    """Return (observation, reward, info) of a reset and of steps under PD."""
    walk = islice(samples(env, policies.PDTracker.for_env(env), seed), steps + 1)
    return [(sample.observation, sample.reward, sample.info) for sample in walk]


def flat(info):
    for key, value in sorted(info.items()):
        yield from flat(value) if isinstance(value, dict) else [(key, value)]


def only(*kinds):
    return pytest.mark.parametrize("kind", kinds)


every = only(*KINDS)
