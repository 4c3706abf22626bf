"""PPO in one file, as CleanRL writes it, on many environments at once inside the shield; needs the extra ``train``.

A step of the policy is ``ticks`` control steps, in each of which the shield decides anew.
"""

from dataclasses import dataclass
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
import tyro
from torch import nn
from torch.distributions import Normal

import jssa_gym  # noqa: F401  # registers the ids
from jssa_gym.control.vector import VectorJPCAction
from jssa_gym.envs.vector import VectorActionRepeat
from jssa_gym.evaluation.record_vector import VectorRecordSafety


@dataclass(frozen=True)
class Args:
    env_id: str = "jssa_gym/ReachShielded-v0"
    ticks: int = 25
    """Control steps for which an action is repeated."""
    seed: int = 0
    total_timesteps: int = 200_000
    num_envs: int = 64
    num_steps: int = 32
    """Between two updates, in every environment."""
    num_minibatches: int = 16
    update_epochs: int = 10
    learning_rate: float = 7e-4
    gamma: float = 0.9
    gae_lambda: float = 0.95
    clip_coef: float = 0.2
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    save: Path | None = None


def make_envs(args: Args) -> gym.vector.VectorEnv:
    """Velocities of the tool, held for some control steps; safety is recorded in every control step."""
    envs = VectorRecordSafety(gym.make_vec(args.env_id, args.num_envs, autoreset_mode="Disabled"))
    envs = VectorJPCAction(envs, mode="tip", share=1.0)
    # by default a finished environment would spend a step on its reset, which is no transition to learn from
    return gym.wrappers.vector.ClipAction(VectorActionRepeat(envs, args.ticks, "SameStep"))


def mlp(inputs: int, outputs: int, gain: float) -> nn.Sequential:
    linear = (nn.Linear(inputs, 64), nn.Linear(64, 64), nn.Linear(64, outputs))
    for layer, scale in zip(linear, (2**0.5, 2**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, scale)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(linear[0], nn.Tanh(), linear[1], nn.Tanh(), linear[2])


class Agent(nn.Module):
    def __init__(self, observations: int, actions: int) -> None:
        super().__init__()
        self.actor, self.critic = mlp(observations, actions, 0.01), mlp(observations, 1, 1.0)
        self.log_std = nn.Parameter(torch.zeros(actions))

    def policy(self, observation: torch.Tensor) -> Normal:
        return Normal(self.actor(observation), self.log_std.exp())

    def value(self, observation: torch.Tensor) -> torch.Tensor:
        return self.critic(observation).squeeze(-1)


def advantages(reward, value, next_value, terminated, done, gamma: float, gae_lambda: float) -> torch.Tensor:
    """Generalised advantage estimates; all of shape (T, envs), ``next_value`` before any reset.

    Where an episode ran out of time the next value counts; where it was terminated, nothing comes after.
    """
    delta = reward + gamma * next_value * ~terminated - value
    found, following = torch.zeros_like(delta), torch.zeros_like(delta[0])
    for t in reversed(range(len(delta))):
        found[t] = following = delta[t] + gamma * gae_lambda * ~done[t] * following
    return found


def update(agent: Agent, optimizer: torch.optim.Optimizer, args: Args, batch: tuple[torch.Tensor, ...]) -> None:
    """Clipped PPO on a batch of observations, actions, log-probabilities, advantages, returns."""
    size = len(batch[0])
    for _ in range(args.update_epochs):
        for chosen in torch.randperm(size).split(max(size // args.num_minibatches, 2)):
            observation, action, before, advantage, target = (part[chosen] for part in batch)
            policy = agent.policy(observation)
            ratio = (policy.log_prob(action).sum(-1) - before).exp()
            advantage = (advantage - advantage.mean()) / (advantage.std(correction=0) + 1e-8)
            clipped = ratio.clamp(1.0 - args.clip_coef, 1.0 + args.clip_coef)
            gain = torch.min(ratio * advantage, clipped * advantage).mean()
            error = 0.5 * (agent.value(observation) - target).square().mean()
            loss = args.vf_coef * error - gain - args.ent_coef * policy.entropy().sum(-1).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), args.max_grad_norm)
            optimizer.step()


def train(args: Args) -> Agent:
    torch.manual_seed(args.seed)
    envs, shape = make_envs(args), (args.num_steps, args.num_envs)
    inputs, outputs = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
    agent = Agent(inputs, outputs)
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)
    observations, following = torch.zeros(*shape, inputs), torch.zeros(*shape, inputs)
    actions, rewards = torch.zeros(*shape, outputs), torch.zeros(shape)
    terminated, done = torch.zeros(shape, dtype=torch.bool), torch.zeros(shape, dtype=torch.bool)
    observation, _ = envs.reset(seed=args.seed)
    returns = np.zeros(args.num_envs)
    iterations = max(args.total_timesteps // (args.num_steps * args.num_envs), 1)
    for iteration in range(iterations):
        optimizer.param_groups[0]["lr"] = args.learning_rate * (1.0 - iteration / iterations)
        ended = []
        for t in range(args.num_steps):
            observations[t] = torch.as_tensor(observation)
            with torch.no_grad():
                actions[t] = agent.policy(observations[t]).sample()
            observation, reward, over, late, info = envs.step(actions[t].numpy())
            returns += reward
            rewards[t], terminated[t], done[t] = map(torch.as_tensor, (reward, over, over | late))
            following[t] = torch.as_tensor(observation)
            for k in np.flatnonzero(over | late):
                following[t, k] = torch.as_tensor(info["final_obs"][k])
                ended.append({name: x[k] for name, x in info["final_info"].get("safety", {}).items()})
                ended[-1]["return"], returns[k] = returns[k], 0.0
        with torch.no_grad():
            values, before = agent.value(observations), agent.policy(observations).log_prob(actions).sum(-1)
            ahead = agent.value(following)
        found = advantages(rewards, values, ahead, terminated, done, args.gamma, args.gae_lambda)
        batch = (observations, actions, before, found, found + values)
        update(agent, optimizer, args, tuple(part.flatten(0, 1) for part in batch))
        told = [f"{(iteration + 1) * args.num_steps * args.num_envs:,} steps, {len(ended)} episodes ended"]
        for name in ("return", "success", "moving_contact", "intervention_rate"):
            if ended and name in ended[0]:
                told.append(f"{name} {np.mean([episode[name] for episode in ended]):.3g}")
        print(", ".join(told), flush=True)
    envs.close()
    if args.save is not None:
        torch.save(agent.state_dict(), args.save)
    return agent


if __name__ == "__main__":
    train(tyro.cli(Args, description=__doc__))
