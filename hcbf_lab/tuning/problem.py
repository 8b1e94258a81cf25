"""The tuning problem: the cost of a program's weights in one scene and environment."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hcbf_gym import programs, scenarios
from hcbf_gym.arrays import Array
from hcbf_gym.errors import InvalidInputError, choose
from hcbf_gym.evaluation import environments
from hcbf_gym.evaluation.jobs import Runs
from hcbf_gym.evaluation.rollouts import Case, Episode
from hcbf_gym.models.plant import CAUTIOUS
from hcbf_lab.tuning.cost import Cost, relaxation
from hcbf_lab.tuning.simulate import check_weights, simulate

ALPHAS = {"alpha2": CAUTIOUS, "alpha_speed": CAUTIOUS}
"""The class-K functions of the A1, so that weights that are tuned on the model suit it, too."""

_CHUNK = 500  # trajectories in memory at a time


@dataclass(frozen=True)
class Problem:
    """The cost r(γ₀, Δγ) of one episode, as a function of the weights.

    Raises:
        UnknownNameError: if the environment or the program is not registered.
        InvalidInputError: if the program takes no weights, or the scenario is no scene.
    """

    # "HCBF-Regions-v0", in which all pairs run as one batch, or "HCBF-A1Regions-v0"
    env: str = "HCBF-Regions-v0"
    scenario: Any = "paper-simulation"  # as `hcbf_gym.scenarios.make` takes it
    program: str = "h-cbf-qp"  # a program with the options `gamma0` and `delta_gamma`
    options: Mapping[str, Any] = field(default_factory=ALPHAS.copy)  # further ones of the filter
    seed: int = 0  # of the episode
    cost: Cost = field(default_factory=Cost)  # of an episode in which the robot does not fall

    def __post_init__(self) -> None:
        choose("environment", self.env, environments.known())
        taken = programs.options(self.program)
        if not {"gamma0", "delta_gamma"} <= set(taken):
            raise InvalidInputError(
                f"program {self.program!r}: got the options {list(taken)}, "
                "expected a program that takes gamma0 and delta_gamma"
            )
        self.case(0.0, 0.0).make().close()

    @property
    def batched(self) -> bool:
        """Whether all pairs of weights run as one batch."""
        return self.env == "HCBF-Regions-v0"

    def settings(self) -> dict[str, Any]:
        """Return everything that decides the costs, in JSON types."""
        random = scenarios.is_random(self.scenario)
        scene = self.scenario if random else scenarios.make(self.scenario).to_dict()
        return asdict(self) | {"scenario": scene, "options": dict(self.options)}

    def case(self, gamma0: float, delta_gamma: float) -> Case:
        """Return the episode of one pair of weights."""
        weights = {"gamma0": gamma0, "delta_gamma": delta_gamma}
        return Case(self.env, self.scenario, "pd", self.program, {**self.options, **weights})

    def costs(
        self,
        gamma0: ArrayLike,
        delta_gamma: ArrayLike,
        runs: Runs = Runs(),  # noqa: B008 - frozen
    ) -> Iterator[tuple[int, float]]:
        """Yield (k, r) of the N pairs of weights, in the order in which they finish.

        Args:
            gamma0: (N,) γ₀ ≥ 0.
            delta_gamma: (N,) Δγ ≥ 0.
            runs: how episodes run that are no batch.

        Raises:
            InvalidInputError: if a weight is negative or not finite, or there are none.
        """
        gamma0, delta_gamma = check_weights(gamma0, delta_gamma)
        if not self.batched:
            pairs = list(zip(gamma0.tolist(), delta_gamma.tolist(), strict=True))
            return runs.over(self._cost_of_pair, pairs)
        chunks = (
            self._batch_costs(gamma0[i : i + _CHUNK], delta_gamma[i : i + _CHUNK])
            for i in range(0, len(gamma0), _CHUNK)
        )
        return enumerate(cost for chunk in chunks for cost in chunk.tolist())

    def cost_of(self, episode: Episode) -> float:
        """Return r of one recorded episode; infinity if the robot fell."""
        if episode.fell:
            return np.inf
        relaxed = relaxation(episode.delta, episode.priority)
        return float(self.cost(episode.tracking_error, relaxed))

    def _cost_of_pair(self, weights: tuple[float, float]) -> float:
        """Return r of the episode under one pair of weights."""
        return self.cost_of(self.case(*weights).run(self.seed))

    def _batch_costs(self, gamma0: Array, delta_gamma: Array) -> Array:
        """Return r (N,) of N pairs of weights, which run as one batch."""
        run = simulate(
            self.scenario, self.program, gamma0, delta_gamma, self.options, seed=self.seed
        )
        return self.cost(run.tracking_error, run.relaxation)
