"""The interface of this package's environments to Gymnasium, filters and certificates."""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from hcbf_gym import certificates, records
from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers import Barrier, class_k
from hcbf_gym.certificates import Judged, NearestCertificate, warn_of_version
from hcbf_gym.envs import task
from hcbf_gym.envs.scene_source import SceneSource
from hcbf_gym.errors import CoverageWarning, InvalidInputError, warn_caller
from hcbf_gym.models.axle import Axle
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import CAUTIOUS, EXACT, CoveredBy, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.scenarios import Scenario


def _read(name: str, env: object, *_: object) -> Any:
    """Return an attribute of an environment, as a plant's reader."""
    return getattr(env, name)


_BARRIERS, _ESTIMATE, _GOAL, _JUDGED, _DECLARED = (
    partial(_read, name) for name in ("barrier_set", "estimate", "goal", "judged", "declared")
)
# the same readers for every plant: filters compare them
READERS = _BARRIERS, _ESTIMATE, _GOAL, _JUDGED
"""They read the environment alone, neither observations nor infos."""


class PlantModel(NamedTuple):
    """The model of a robot that a filter assumes, from its environment's arguments."""

    input_set: InputSet  # U, shrunk to what the robot can follow
    v_max: float | None  # the strict cap on the speed [m/s]; None for none
    uncertainty: Uncertainty  # how far the robot may be from its reduced-order model
    declared: dict[str, Any]  # the arguments, as certificates compare them
    nearest: NearestCertificate  # the shipped certificate that fits them best
    axle: Axle | None = None  # what limits a differential drive; None for all others
    braking: float | None = None  # deceleration with which its body stops [m/s²]; None: that of U
    gain: float = CAUTIOUS  # of α₂ and of α of speed limits [1/s]
    on_alarm: str = "brake"  # or "warn"


def exact(scenes: SceneSource, n: int | None = None) -> PlantModel:
    """Return the model of robots that move as the reduced-order model does, one or N."""
    own, declared = scenes.own, {"environment": "HCBF-Regions-v0"}
    if scenes.hidden:
        declared["intentions"] = "hidden"
    family = scenes.family({})
    nearest = certificates.nearest(declared | {"scene": family if n is None else [family] * n})
    return PlantModel(
        own.input_set, own.v_max, EXACT, declared, nearest, gain=class_k.GAIN, on_alarm="warn"
    )


class RankedRegions:
    """The base of single and native vector environments: their plant, and its certificate.

    ``EnvSpec.from_json(spec.to_json()) == spec`` holds: arguments that JSON does not have (a
    `Scenario`, a path, arrays, tuples) become their plain form, which the constructors read, too.
    Gymnasium declares `spec` a variable; it is a property here, to change what is assigned.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012
    _spec: EnvSpec | None = None
    _family: Any  # of the present scene, a list of N in a vector environment

    def _declare(self, known: PlantModel, scenes: SceneSource, render_mode: str | None) -> None:
        """Set the environment's model and scenes; warn where its arguments are not covered."""
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidInputError(
                f"render_mode: got {render_mode!r}, expected None or one of "
                f"{self.metadata['render_modes']}"
            )
        self.render_mode, self._known, self._scenes = render_mode, known, scenes
        self.scenario, self._family = scenes.own, scenes.family({})
        self._started = False
        judged, name = known.nearest.judged, known.declared["environment"]
        if not judged.outside:
            return
        if judged.covered_by == CoveredBy.VERSION:
            warn_of_version(judged.reasons[0])
            return
        warn_caller(
            f"{name}: rank 1 is not promised (covered = 0), as the arguments leave what was "
            f"tested: {'; '.join(judged.reasons)}",
            CoverageWarning,
        )

    @property
    def spec(self) -> EnvSpec | None:
        """What `gymnasium.make` was called with."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec = replace(spec, kwargs=records.plain(spec.kwargs))
        self._spec = spec

    @property
    def plant(self) -> Plant:
        """What a safety filter must know."""
        known = self._known
        return Plant(
            model=DoubleIntegrator(),
            barriers=_BARRIERS,
            state=_ESTIMATE,
            input_set=known.input_set,
            period=task.CONTROL_DT,
            goal=_GOAL,
            uncertainty=known.uncertainty,
            gain=known.gain,
            on_alarm=known.on_alarm,
            axle=known.axle,
            braking=known.braking,
            covered=_JUDGED,
            declared=_DECLARED,
        )

    @property
    def judged(self) -> Judged:
        """Whether the promise was tested for these arguments and scenes, and why not."""
        return self._known.nearest.again(self.declared)

    @property
    def declared(self) -> dict[str, Any]:
        """What identifies the plant, as certificates compare it; N families in "scene" of N."""
        return self._known.declared | {"scene": self._family}


class SingleRegions(  # pyright: ignore[reportIncompatibleVariableOverride] - spec, see above
    RankedRegions, gym.Env[Array, Array]
):
    """The base of environments of one robot: it begins episodes and changes scenes."""

    action_space: gym.Space
    observation_space: gym.Space

    @property
    def barriers(self) -> tuple[Barrier, ...]:
        """The scenario's barriers, then the environment's own, in the order of info["h"]."""
        return task.barriers_of(self.scenario, self._known.v_max)

    @property
    def goal(self) -> Array:
        """(2,) where the reference ends [m]."""
        return self.scenario.goal

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[Array, Info]:
        """Start a new episode; a seed decides everything that follows.

        Args:
            seed: of the scenes and the randomisation; None draws on.
            options: "scenario" and "start" (2,) [m] of this episode alone.

        Raises:
            InvalidInputError: if an option is unknown, or the scene is of another kind.
        """
        given = self._scenes.check(options)
        super().reset(seed=task.check_seed(seed))
        scene = self._scenes.next(self.np_random, given)
        if scene is not self.scenario:
            self._set_scene(scene)
        self._family = self._scenes.family(given)
        self._started = True
        return self._restart()

    def change_scene(self, scenario: Scenario) -> None:
        """Move, resize or rank regions anew within an episode.

        Raises:
            InvalidInputError: if the scene is of another kind than the environment's.
        """
        self._scenes.check({"scenario": scenario})
        self._family = None
        self._set_scene(scenario)

    def _set_scene(self, scenario: Scenario) -> None:
        """Put the robot into a scene where it is."""
        raise NotImplementedError

    def _restart(self) -> tuple[Array, Info]:
        """Put the robot at rest at the start; return observation and infos."""
        raise NotImplementedError
