"""An environment's spec in JSON's terms."""

from dataclasses import replace

from gymnasium.envs.registration import EnvSpec

from hcbf_gym import records


class PlainSpec:
    """Holds the spec that Gymnasium assigns so that ``EnvSpec.from_json(spec.to_json()) == spec``.

    Arguments that JSON does not know (a `Scenario`, a path, arrays, tuples) become their plain
    form, which the constructors read as well. Gymnasium declares `spec` a variable; here it is a
    property, to see what is assigned.
    """

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What `gymnasium.make` was called with."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec = replace(spec, kwargs=records.plain(spec.kwargs))
        self._spec = spec
