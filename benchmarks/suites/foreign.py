"""Foreign environments and models behind the filter: the figures of `examples/`, in full.

Times are processor time of one thread: medians of whole steps; of the arm less its own step.
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import parallel, table
from hcbf_gym import loading
from hcbf_gym.arrays import Array
from hcbf_gym.evaluation.statistics import BOUNDED, at_most
from hcbf_gym.evaluation.tables import Table
from hcbf_gym.programs import FilterStatus

MAZES = ("UMaze", "Medium", "Large")
MAZE_STEPS = {"random": 800, "goal": 6000, "ppo": 800}
"""How long an episode may last; one step is 0.01 s."""
HELD_STEPS = 20  # For so many steps the policy "random" pushes in one direction
TRAINING_STEPS = 20_000
ARM_STEPS = 1000  # Ten seconds for each target, in which the spheres come by


def example(name: str) -> Any:
    """Return the module ``examples/NAME.py`` of the checkout."""
    return loading.module("example", str(Path(__file__).parents[2] / "examples" / f"{name}.py"))


def run(quick: bool) -> dict[str, Any]:
    """Return the figures of all foreign environments; what is timed for a target runs alone."""
    return {
        "maze": maze(2 if quick else 100, 500 if quick else TRAINING_STEPS),
        "pendulum": pendulum(4 if quick else 500),
        "unicycle": unicycle(4 if quick else 500),
        "arm": arm(2 if quick else 100),
    }


def maze(episodes: int, training: int) -> list[dict[str, Any]]:
    """Drive the ball of PointMaze by each policy, with the filter and without it."""
    cells = [(maze, policy) for maze in MAZES for policy in ("random", "goal")]
    with tempfile.TemporaryDirectory() as folder:
        trained = Path(folder) / "ppo"
        _train("PointMaze_UMazeDense-v3", training, trained)
        jobs = (
            (*cell, filtered, episodes, trained)
            for cell in (*cells, ("UMaze", "ppo"))
            for filtered in (True, False)
        )
        return parallel(_cell, jobs)


def _train(name: str, steps: int, path: Path) -> None:
    """Train a policy by Stable-Baselines3's PPO that never sees a filter, and save it."""
    import gymnasium as gym
    from stable_baselines3 import PPO

    example("point_maze")  # registers the mazes
    env = gym.make(name, continuing_task=False)
    model = PPO("MultiInputPolicy", env, seed=0, device="cpu", n_steps=500, batch_size=100)
    model.learn(steps)
    model.save(path)


def _trained(path: Path) -> Callable[[Any, Any, int], Array]:
    from stable_baselines3 import PPO

    model = PPO.load(path, device="cpu")
    return lambda env, observation, k: model.predict(observation, deterministic=True)[0]


def _cell(name: str, policy: str, filtered: bool, episodes: int, trained: Path) -> dict[str, Any]:
    """Roll one policy through one maze."""
    env = example("point_maze").make(f"PointMaze_{name}-v3", max_episode_steps=MAZE_STEPS[policy])
    act = _trained(trained) if policy == "ppo" else _PUSHES[policy]
    rolled = _roll_ball(env if filtered else env.env, act, episodes)
    env.close()
    return {"maze": name, "policy": policy, "filtered": filtered} | rolled


def _random_push(env: Any, observation: Any, k: int) -> Array:
    """Return a random action that is held for a while."""
    if k % HELD_STEPS == 0:
        env.push = env.unwrapped.np_random.uniform(-1.0, 1.0, 2).astype(np.float32)
    return env.push


def _to_goal(env: Any, observation: Any, k: int) -> Array:
    """Return a push straight at the goal, through all that is in between."""
    position, velocity = np.split(observation["observation"], 2)
    push = 4.0 * (observation["desired_goal"] - position) - velocity
    return np.clip(push, -1.0, 1.0).astype(np.float32)


_PUSHES: dict[str, Callable[[Any, Any, int], Array]] = {"random": _random_push, "goal": _to_goal}


def _roll_ball(env: Any, act: Any, episodes: int) -> dict[str, Any]:
    touched, contacts, arrived, steps, spent = 0, 0, 0, 0, []
    ground = env.unwrapped.model.geom("ground").id
    for seed in range(episodes):
        observation, info = env.reset(seed=seed)
        before, over, k = contacts, False, 0
        while not over:
            action = act(env, observation, k)
            start = time.thread_time()
            observation, _, terminated, truncated, info = env.step(action)
            spent.append(time.thread_time() - start)
            met = [c for c in env.unwrapped.data.contact if ground not in c.geom]
            contacts += any(contact.dist < 0.0 for contact in met)
            over, k = terminated or truncated, k + 1
        steps += k
        touched += contacts > before
        arrived += bool(info["success"])
    return {
        "episodes": episodes, "touched": touched, "contacts": contacts, "arrived": arrived,
        "steps": steps, "us": 1e6 * float(np.median(spent)),
    }  # fmt: skip


def pendulum(episodes: int) -> dict[str, Any]:
    """Let hostile torques act on the pole from starts in the safe set."""
    module = example("pendulum")
    env, random = module.make(), np.random.default_rng(0)

    def least(x: Array) -> float:
        return min(float(barrier.function(x, 0.0)) for barrier in module.barriers)

    torques: tuple[Callable[[float], float], ...] = (
        lambda speed: 2.0,
        lambda speed: -2.0,
        lambda speed: 2.0 * float(np.sign(speed)),
        lambda speed: 2.0 * float(random.choice((-1.0, 1.0))),
    )
    farthest, left, spent = 0.0, 0, []
    for seed in range(episodes):
        env.reset(seed=seed)
        start = random.uniform((-module.LIMIT, -3.0), (module.LIMIT, 3.0))
        while least(start) < 0.0:
            start = random.uniform((-module.LIMIT, -3.0), (module.LIMIT, 3.0))
        env.unwrapped.state = start
        angle = 0.0
        for _ in range(200):
            torque = torques[seed % 4](env.unwrapped.state[1])
            began = time.thread_time()
            env.step(np.array([torque]))
            spent.append(time.thread_time() - began)
            angle = max(angle, abs(float(env.unwrapped.state[0])))
        farthest, left = max(farthest, angle), left + (angle > module.LIMIT)
    return {
        "episodes": episodes, "left": left, "farthest": farthest, "limit": module.LIMIT,
        "us": 1e6 * float(np.median(spent)),
    }  # fmt: skip


def unicycle(episodes: int) -> dict[str, Any]:
    """Drive the unicycle at the pillars, forwards, backwards and at random."""
    module = example("unicycle")
    env, random = module.make(), np.random.default_rng(0)
    centers, radii = (np.array(part) for part in zip(*module.PILLARS, strict=True))
    least, entered, spent = np.inf, 0, []
    for episode in range(episodes):
        x = np.zeros(3)
        ahead = np.zeros((2, 2))
        while (np.linalg.norm(ahead - centers, axis=1) < radii + module.AHEAD + 0.02).any():
            x = np.append(random.uniform(-2.0, 2.0, 2), random.uniform(-np.pi, np.pi))
            ahead = x[:2] + module.AHEAD * np.array([np.cos(x[2]), np.sin(x[2])])
        env.reset(options={"start": x})
        aim, style = centers[episode % 2], episode % 3
        gap = np.inf
        for _ in range(150):
            dx, dy = aim - x[:2]
            turn = np.sin(np.arctan2(dy, dx) - x[2]) * (-1.0 if style == 1 else 1.0)
            rate = 2.0 * np.sign(turn) if style < 2 else 2.0 * random.choice((-1.0, 1.0))
            began = time.thread_time()
            x = env.step(np.array([-1.0 if style == 1 else 1.0, rate]))[0]
            spent.append(time.thread_time() - began)
            gap = min(gap, float((np.linalg.norm(x[:2] - centers, axis=1) - radii).min()))
        least, entered = min(least, gap), entered + (gap < 0.0)
    return {
        "episodes": episodes, "entered": entered, "least": least,
        "us": 1e6 * float(np.median(spent)),
    }  # fmt: skip


def arm(targets: int) -> dict[str, Any]:
    """Reach for random targets between spheres that close in on the arm."""
    module = example("arm")
    env, random = module.make(), np.random.default_rng(0)
    barriers = env.plant.barriers
    priority = np.array([barrier.priority for barrier in barriers])
    least, reached, forced = np.full(len(barriers), np.inf), 0, 0
    entered = np.zeros(3, dtype=np.int64)
    spent: dict[bool, list[float]] = {False: [], True: []}
    bare = []
    for _ in range(targets):
        q = env.reset(seed=int(random.integers(2**31)))[0]
        while min(barrier.h(q, 0.0) for barrier in barriers) < 0.02:
            q = env.reset(seed=int(random.integers(2**31)))[0]
        target = np.array([0.9, 0.0, 0.8]) + random.uniform(-0.4, 0.4, 3)
        path, nearest = [q], np.inf
        for _ in range(ARM_STEPS):
            wanted, distance = reach(module, q, target)
            nearest = min(nearest, distance)
            began = time.thread_time()
            q, _, _, _, info = env.step(wanted)
            conflict = bool(info["safety_filter"]["status"] >= FilterStatus.RELAXED)
            spent[conflict].append(time.thread_time() - began)
            path.append(q)
            forced += conflict
        began = time.thread_time()
        env.unwrapped.step(np.zeros(6))
        bare.append(time.thread_time() - began)
        h = np.min([[b.h(q, k * module.T) for b in barriers] for k, q in enumerate(path)], axis=0)
        least, reached = np.minimum(least, h), reached + (nearest < 0.05)
        entered += [(h[priority == rank] < 0.0).any() for rank in (1, 2, 3)]
    own = float(np.median(bare))
    return {
        "targets": targets, "reached": int(reached), "entered": entered.tolist(),
        "least": [float(least[priority == rank].min()) for rank in (1, 2, 3)],
        "conflicts": forced,
        "us": 1e6 * (float(np.median(spent[False])) - own),
        "us_conflict": 1e6 * (float(np.median(spent[True] or [np.nan])) - own),
    }  # fmt: skip


def reach(module: Any, q: Array, target: Array) -> tuple[Array, float]:
    """Return joint velocities that lead the arm's wrist to a target, and its distance [m]."""
    import pinocchio as pin

    pin.computeJointJacobians(module.ARM, module.DATA, q)
    jacobian = pin.getJointJacobian(module.ARM, module.DATA, 6, module.AXES)[:3]
    gap = target - module.DATA.oMi[6].translation
    u = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 0.01 * np.eye(3), 2.0 * gap)
    return u / max(1.0, np.abs(u).max() / module.SPEED), float(np.linalg.norm(gap))


def tables(figures: dict[str, Any]) -> dict[str, Table]:
    """Return the tables of the maze and of the models."""

    def of(entered: int, episodes: int) -> str:
        return f"{entered} of {episodes} ({at_most(entered, episodes)})"

    mazes = {
        "maze": "{maze}", "policy": "{policy}",
        "filter": lambda r: "yes" if r["filtered"] else "no",
        f"episodes with contact ({BOUNDED})": lambda r: of(r["touched"], r["episodes"]),
        "contacts": "{contacts}", "arrived": lambda r: f"{r['arrived'] / r['episodes']:.0%}",
        "µs": "{us:.0f}",
    }  # fmt: skip
    p, c, a = figures["pendulum"], figures["unicycle"], figures["arm"]
    angle = f"angle {p['farthest']:.6f} of {p['limit']} rad"
    lower = f"{a['entered'][1]} and {a['entered'][2]} entered ranks 2 and 3; {a['reached']} reached"
    conflicts = f"{a['conflicts']} conflicts"
    slower = "–" if a["us_conflict"] is None else f"{a['us_conflict']:.0f}"
    gap, us = f"least gap {1e3 * c['least']:.1f} mm", f"{a['us']:.0f}, in conflict {slower}"
    models = [
        ("pendulum", of(p["left"], p["episodes"]), angle, f"{p['us']:.0f}"),
        ("unicycle", of(c["entered"], c["episodes"]), gap, f"{c['us']:.0f}"),
        ("arm", of(a["entered"][0], a["targets"]), f"{lower}; {conflicts}", us),
    ]
    header = ("model", f"strict violations ({BOUNDED})", "beside", "µs a step")
    title = "Models behind the filter, hostile policies"
    return {
        "foreign-maze": table("PointMaze: the ball and the walls", figures["maze"], mazes),
        "foreign-models": Table(title, header, models),
    }
