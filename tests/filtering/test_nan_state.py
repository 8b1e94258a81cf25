"""What happens when a state is NaN: every function that the filter calls, traced in both cores."""

import json
import os
import subprocess
import sys
import textwrap

import pytest

from hcbf_gym.models.plant import Reason
from hcbf_gym.programs import FilterStatus

SCRIPT = """
    import json, sys, warnings
    from pathlib import Path
    import gymnasium as gym
    import numpy as np
    import hcbf_gym
    from hcbf_gym import models
    from hcbf_gym.barriers import Disc
    from hcbf_gym.models.vehicles import Unicycle

    warnings.simplefilter("ignore")
    model = {"planar": models.DoubleIntegrator(), "general": Unicycle()}[sys.argv[1]]
    state = {"planar": [0.0, 0.0, 0.5, 0.0], "general": [0.0, 0.0, 0.0]}[sys.argv[1]]

    class Moving(gym.Env):
        action_space = gym.spaces.Box(-1.0, 1.0, (model.n_u,), np.float64)
        observation_space = gym.spaces.Box(-9.0, 9.0, (model.n,), np.float64)

        def reset(self, *, seed=None, options=None):
            self.x = np.array(state)
            return self.x.copy(), {}

        def step(self, action):
            return self.x.copy(), 0.0, False, False, {}

    plant = hcbf_gym.Plant(
        model, [Disc("region", 1, (5.0, 0.0), 1.0)], lambda env, *_: env.x.copy(), period=0.1
    )
    env = hcbf_gym.wrappers.SafetyFilter(Moving(), plant=plant, allow_late_inputs=True)
    env.reset(seed=0)
    env.step(np.ones(model.n_u))  # the state that comes back is still a good one
    env.unwrapped.x[:] = np.nan
    env.step(np.ones(model.n_u))  # this step reads the good one; the next one reads NaN
    called = []

    def note(frame, event, argument):
        file = Path(frame.f_code.co_filename)
        if event == "return" and file.parent.name == "filtering":
            value = argument if isinstance(argument, int) else None
            called.append([f"{file.stem}.{frame.f_code.co_name}", value])

    sys.setprofile(note)
    *_, info = env.step(np.ones(model.n_u))
    sys.setprofile(None)
    report = info["safety_filter"]
    said = [int(report["status"]), int(report["reason"]), report["u_safe"].tolist()]
    print(json.dumps([called, said]))
"""

PATHS = dict.fromkeys(("planar", "general"), ("belief.look", "step._wish_to_stop"))
"""Which function says that nothing is believed, and which one says what is applied then."""


@pytest.mark.parametrize("core", PATHS)
def test_a_state_that_is_nan_is_not_believed_and_the_plant_is_brought_to_rest(core):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(SCRIPT), core],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},  # kernels are traced like all else
        capture_output=True,
        text=True,
        check=True,
    )
    called, (status, reason, u) = json.loads(done.stdout.splitlines()[-1])
    names = [name for name, _ in called]
    judges, brakes = PATHS[core]
    assert [judges, int(Reason.STATE)] in called
    assert names.index(judges) < names.index(brakes)
    assert (status, reason) == (FilterStatus.BACKUP, Reason.STATE)
    # under the input that it had got, 0.5 m/s had become 0.6, and then 0.7
    assert u == pytest.approx({"planar": [-1.0, 0.0], "general": [0.0, 0.0]}[core], abs=1e-9)
