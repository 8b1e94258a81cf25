"""The base classes of environments: their spec for Gymnasium, and their plant for filters."""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from hcbf_gym import certificates, records
from hcbf_gym.arrays import Array, Info
from hcbf_gym.barriers import Barrier, class_k
from hcbf_gym.certificates import Judged, NearestCertificate, warn_of_version
from hcbf_gym.envs import checks, task
from hcbf_gym.envs.scene_source import SceneSource
from hcbf_gym.errors import CoverageWarning, InvalidInputError, warn_caller
from hcbf_gym.models.axle import Axle
from hcbf_gym.models.input_sets import InputSet
from hcbf_gym.models.plant import CAUTIOUS, EXACT, CoveredBy, Plant, Uncertainty
from hcbf_gym.models.reduced_order import DoubleIntegrator
from hcbf_gym.scenarios import Scenario


def _attribute(name: str, env: object, *_: object) -> Any:
    """Return an attribute of an environment; a plant's reader also gets observation and infos."""
    return getattr(env, name)


_BARRIERS = partial(_attribute, "barrier_set")
_ESTIMATE = partial(_attribute, "estimate")
_GOAL = partial(_attribute, "goal")
_JUDGED = partial(_attribute, "judged")
_DECLARED = partial(_attribute, "declared")

READERS = _BARRIERS, _ESTIMATE, _GOAL, _JUDGED
"""The readers of every environment's plant. They need no copy of an observation or of infos, so a
filter looks whether a plant's reader is one of these."""


class PlantModel(NamedTuple):
    """The model of a robot that a filter assumes, from its environment's arguments."""

    input_set: InputSet  # U, shrunk to accelerations that the robot can follow
    v_max: float | None  # the strict cap on the speed [m/s]; None for none
    uncertainty: Uncertainty  # how far the robot may be from its reduced-order model
    declared: dict[str, Any]  # the arguments, as certificates compare them
    nearest: NearestCertificate  # the shipped certificate that fits the arguments best
    axle: Axle | None = None  # the limits of a differential drive; None for all other robots
    braking: float | None = None  # deceleration with which its body stops [m/s²]; None: that of U
    gain: float = CAUTIOUS  # slope of α₂ and of the speed limits' α [1/s]
    on_alarm: str = "brake"  # the filter's reaction to an alarm, "brake" or "warn"


def exact_model(scenes: SceneSource, n: int | None = None) -> PlantModel:
    """Return the model of one robot, or of N, that moves exactly as the reduced-order model."""
    own, declared = scenes.own_scene, {"environment": "HCBF-Regions-v0"}
    if scenes.hidden:
        declared["intentions"] = "hidden"
    family = scenes.family_name({})
    nearest = certificates.nearest(declared | {"scene": family if n is None else [family] * n})
    return PlantModel(
        own.input_set, own.v_max, EXACT, declared, nearest, gain=class_k.GAIN, on_alarm="warn"
    )


class RankedRegions:
    """The base of single and native vector environments: their plant, and its certificate.

    ``EnvSpec.from_json(spec.to_json()) == spec`` holds: arguments that JSON does not have (a
    `Scenario`, a path, arrays, tuples) become their plain form, which the constructors read, too.
    Gymnasium declares `spec` a variable. It is a property here, so that an assignment converts it.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012
    _spec: EnvSpec | None = None
    _family: Any  # the present scene's family, or None; a list of N in a vector environment

    def _declare(self, model: PlantModel, scenes: SceneSource, render_mode: str | None) -> None:
        """Set the environment's plant model and scenes; warn where no certificate covers them."""
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidInputError(
                f"render_mode: got {render_mode!r}, expected None or one of "
                f"{self.metadata['render_modes']}"
            )
        self.render_mode, self._plant_model, self._scenes = render_mode, model, scenes
        self.scenario, self._family = scenes.own_scene, scenes.family_name({})
        self._started = False
        judged = model.nearest.judged
        if not judged.outside:
            return
        if judged.covered_by == CoveredBy.VERSION:
            warn_of_version(judged.reasons[0])
            return
        warn_caller(
            f"{model.declared['environment']}: rank 1 is not promised (covered = 0), as the "
            f"arguments leave what was tested: {'; '.join(judged.reasons)}",
            CoverageWarning,
        )

    @property
    def spec(self) -> EnvSpec | None:
        """The id and arguments that `gymnasium.make` was called with."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec = replace(spec, kwargs=records.plain(spec.kwargs))
        self._spec = spec

    @property
    def plant(self) -> Plant:
        """The plant, by which a safety filter knows the environment."""
        model = self._plant_model
        return Plant(
            model=DoubleIntegrator(),
            barriers=_BARRIERS,
            state=_ESTIMATE,
            input_set=model.input_set,
            period=task.CONTROL_DT,
            goal=_GOAL,
            uncertainty=model.uncertainty,
            gain=model.gain,
            on_alarm=model.on_alarm,
            axle=model.axle,
            braking=model.braking,
            covered=_JUDGED,
            declared=_DECLARED,
        )

    @property
    def judged(self) -> Judged:
        """Whether the promise was tested for these arguments and scenes, and why not."""
        return self._plant_model.nearest.again(self.declared)

    @property
    def declared(self) -> dict[str, Any]:
        """The arguments and scenes that certificates compare; "scene" lists N families of N."""
        return self._plant_model.declared | {"scene": self._family}


class SingleRegions(  # pyright: ignore[reportIncompatibleVariableOverride] - spec, see above
    RankedRegions, gym.Env[Array, Array]
):
    """The base of environments of one robot: it begins episodes and changes scenes."""

    action_space: gym.Space
    observation_space: gym.Space

    @property
    def barriers(self) -> tuple[Barrier, ...]:
        """The scenario's barriers, then the environment's own, in the order of info["h"]."""
        return task.barriers_of(self.scenario, self._plant_model.v_max)

    @property
    def goal(self) -> Array:
        """(2,) the point where the reference ends [m]."""
        return self.scenario.goal

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[Array, Info]:
        """Start a new episode; a seed decides everything that follows.

        Args:
            seed: for the scenes and the randomisation; None continues the present generator.
            options: "scenario" and "start" (2,) [m], for this episode alone.

        Raises:
            InvalidInputError: if an option is unknown, or the scene is of another kind.
        """
        checked_options = self._scenes.check(options)
        super().reset(seed=checks.check_seed(seed))
        scene = self._scenes.next(self.np_random, checked_options)
        if scene is not self.scenario:
            self._set_scene(scene)
        self._family = self._scenes.family_name(checked_options)
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
        """Replace the scene around the robot, which stays where it is."""
        raise NotImplementedError

    def _restart(self) -> tuple[Array, Info]:
        """Put the robot at rest at the start; return observation and infos."""
        raise NotImplementedError
