"""An arm driven by joint velocities keeps clear of ranked spheres: a user's own `Barrier`."""

import math
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import pinocchio as pin

import hcbf_gym
from hcbf_gym import models

T, SPEED, THICK, AXES = 0.01, 0.5, 0.05, pin.LOCAL_WORLD_ALIGNED  # [s], [rad/s], [m]
ARM = pin.buildSampleModelManipulator()
DATA, POINT, FLAT = ARM.createData(), pin.SE3.Identity(), np.zeros((6, 6))
LINKS = {"upper arm": (3, 1.0), "forearm": (4, 1.0), "hand": (6, 0.2)}  # joint, length [m]
BALLS = ((1, (1, -0.7, 0.8), 0.4, 0.4), (2, (1, 0.7, 0.8), 0.4, -0.8), (3, (0.8, 0, 1.2), 0.3, 2.5))


@dataclass(frozen=True)
class Clear(hcbf_gym.barriers.Barrier):
    """A link, a capsule, out of a sphere that oscillates along y: h = ‖p − c(t)‖ − r − THICK."""

    link: str = "hand"
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m]
    radius: float = 0.2  # [m]
    swing: float = 0.0  # [m], once in 2π s

    def jet(self, x, t=0.0):
        pin.computeJointJacobians(ARM, DATA, x)
        (joint, length), c = LINKS[self.link], np.array(self.center, dtype=float)
        c[1] += self.swing * math.sin(t)
        place = DATA.oMi[joint]
        POINT.translation[2] = min(max(place.actInv(c)[2], 0.0), length)  # nearest to c
        away = place.act(POINT.translation) - c
        distance = math.sqrt(away @ away)
        gradient = away / distance @ pin.getFrameJacobian(ARM, DATA, joint, POINT, AXES)[:3]
        h, rate = distance - self.radius - THICK, -away[1] / distance * self.swing * math.cos(t)
        return hcbf_gym.barriers.Jet(h, gradient, FLAT, rate, FLAT[0], 0.0)


class Arm(gym.Env):
    action_space = gym.spaces.Box(-SPEED, SPEED, (6,), dtype=np.float64)
    observation_space = gym.spaces.Box(-np.inf, np.inf, (6,), dtype=np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.q = self.np_random.uniform(-1.5, 1.5, 6)
        return self.q, {}

    def step(self, action):
        self.q = self.q + T * action
        return self.q, 0.0, False, False, {}


def make():
    clear = [Clear(f"{at} {k}", p, at, *s) for k, (p, *s) in enumerate(BALLS) for at in LINKS]
    model = models.SingleIntegrator(6)
    plant = hcbf_gym.Plant(model, clear, state=lambda env, observation, info: env.q, period=T)
    return hcbf_gym.wrappers.SafetyFilter(Arm(), "lex-cbf-qp", plant=plant, margin=0.005)
