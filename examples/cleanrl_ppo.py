"""PPO in CleanRL's manner, filtered (torch): python examples/cleanrl_ppo.py 500000 geodesic."""

import sys

import gymnasium as gym
import torch
from torch import nn

from hcbf_gym.wrappers import VectorHoldAction, VectorSafetyFilter

STEPS, EPOCHS, MINIBATCHES, GAMMA, LAMBDA, CLIP = 64, 10, 16, 0.99, 0.95, 0.2


def train(decisions, guidance=None, seed=0, n=64):
    """Yield (decisions so far, share of the last 500 episodes that reached the goal)."""
    torch.manual_seed(seed)
    env = gym.make_vec("HCBF-Regions-v0", num_envs=n, scenario="random", autoreset_mode="Disabled")
    env = VectorSafetyFilter(env, "lex-cbf-qp", guidance=guidance)
    env = gym.wrappers.vector.NormalizeObservation(VectorHoldAction(env, 5, "NextStep"))
    size, ends, void = env.single_observation_space.shape[0], [], torch.zeros(n)
    hidden = [[nn.Linear(size, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh()] for _ in range(2)]
    actor, critic = (nn.Sequential(*h, nn.Linear(64, 2 - k)) for k, h in enumerate(hidden))
    log_std = nn.Parameter(torch.full((2,), -0.5))
    adam = torch.optim.Adam([*actor.parameters(), *critic.parameters(), log_std], lr=5e-4)
    obs = torch.Tensor(env.reset(seed=seed)[0]).clamp(-10, 10)
    for count in range(n * STEPS, decisions + 1, n * STEPS):
        memory = []
        with torch.no_grad():
            for _ in range(STEPS):
                chance = torch.distributions.Normal(actor(obs), log_std.exp())
                action, value = chance.sample(), critic(obs)[:, 0]
                found, reward, reached, late, _ = env.step(5.0 * action.clamp(-1, 1).numpy())
                done, log_prob = torch.Tensor(reached | late), chance.log_prob(action).sum(1)
                memory.append((obs, action, log_prob, value, torch.Tensor(reward), done, void))
                ends += reached[reached | late].tolist()
                obs, void = torch.Tensor(found).clamp(-10, 10), done
            later, ahead, gains = critic(obs)[:, 0], torch.zeros(n), []
            for *_, value, reward, done, _ in reversed(memory):  # generalised advantages
                gain = reward + GAMMA * (1 - done) * (later + LAMBDA * ahead) - value
                later, ahead, gains = value, gain, [gain, *gains]
        *batch, _, _, void_steps = map(torch.stack, zip(*memory, strict=True))
        batch = [x[void_steps == 0] for x in (*batch, torch.stack(gains))]  # not mere restarts
        order = torch.cat([torch.randperm(len(batch[0])) for _ in range(EPOCHS)])
        for index in order.chunk(EPOCHS * MINIBATCHES):
            o, a, before, value, gain = (x[index] for x in batch)
            chance = torch.distributions.Normal(actor(o), log_std.exp())
            ratio = (chance.log_prob(a).sum(1) - before).exp()
            g = (gain - gain.mean()) / (gain.std() + 1e-8)
            surrogate = torch.min(ratio * g, ratio.clamp(1 - CLIP, 1 + CLIP) * g).mean()
            loss = 0.5 * (critic(o)[:, 0] - gain - value).square().mean() - surrogate
            adam.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(adam.param_groups[0]["params"], 0.5)
            adam.step()
        yield count, sum(ends[-500:]) / max(1, len(ends[-500:]))


if __name__ == "__main__":
    for count, share in train(int(sys.argv[1]), *sys.argv[2:]):
        print(f"{count} decisions: {100 * share:.0f} % reach the goal")
