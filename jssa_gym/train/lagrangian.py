"""Constrained learning on ``info["cost"]``: what reward there is while somebody is near no more than a limit says.

Both learners have a Lagrange multiplier that rises while the cost exceeds its limit and falls to 0 while it does not.
Neither promises anything of a single step, as a shield does: the limit is one of means, met at the end if at all.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.buffers import ReplayBuffer, RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import create_mlp
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from torch import nn

from jssa_gym.train.wrappers import EXECUTED

COST = "cost"
"""Key of ``info``: in how many control steps of a policy step somebody was nearer than d_min."""


class ExecutedBuffer(ReplayBuffer):
    """A replay buffer that takes the executed action from ``info`` where there is one."""

    def add(
        self,
        obs: NDArray[Any],
        next_obs: NDArray[Any],
        action: NDArray[Any],
        reward: NDArray[Any],
        done: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        # actions are in [-1, 1] already, which is what the buffer scales them to
        executed = [info.get(EXECUTED, action[i]) for i, info in enumerate(infos)]
        super().add(obs, next_obs, np.stack(executed), reward, done, infos)


@dataclass(frozen=True, slots=True)
class CostLimit:
    """How much cost there may be, and how fast a multiplier answers."""

    share: float
    """Share of the control steps in which somebody may be nearer than d_min."""
    rate: float
    """By how much the multiplier rises in 1,000 policy steps with twice the cost, or falls in as many with none."""
    ticks: int
    """Control steps of a policy step."""

    def adapt(self, multiplier: torch.Tensor, costs: NDArray[Any]) -> float:
        """Change a multiplier in place by what policy steps have cost; it is never negative.

        Args:
            multiplier: A tensor of one number.
            costs: Of as many policy steps, any shape.

        Returns:
            Share of their control steps that cost.
        """
        share = float(np.mean(costs)) / self.ticks
        multiplier.add_(self.rate * costs.size / 1000.0 * (share / self.share - 1.0)).clamp_(min=0.0)
        return share


class ConstrainedPPO(PPO):
    r"""PPO-Lagrangian, after Ray, Achiam and Amodei, "Benchmarking safe exploration in deep RL" (2019).

    A critic of its own estimates the cost to come. PPO gets :math:`(A_r - \lambda A_c) / (1 + \lambda)` as advantage,
    with :math:`A_r` in units of its deviation; :math:`\lambda` changes once a rollout.
    """

    def constrain(self, limit: CostLimit) -> None:
        """Say what the limit is; once, before anything is learnt."""
        self.limit = limit
        self.multiplier = torch.zeros((), device=self.device)
        size = int(np.prod(self.observation_space.shape or ()))
        layers = [layer.out_features for layer in self.policy.mlp_extractor.value_net if isinstance(layer, nn.Linear)]
        self.cost_critic = nn.Sequential(*create_mlp(size, 1, layers, nn.Tanh)).to(self.device)
        self.cost_optimizer = torch.optim.Adam(self.cost_critic.parameters(), lr=self.lr_schedule(1.0), eps=1e-5)
        self._costs: list[NDArray[np.float32]] = []
        self._ahead: list[NDArray[np.float32]] = []

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        states, tensors = super()._get_torch_save_params()
        return [*states, "cost_critic", "cost_optimizer"], [*tensors, "multiplier"]

    def cost_to_come(self, observations: Any) -> NDArray[np.float32]:
        """What the critic expects from observations on, discounted."""
        with torch.no_grad():
            inputs = torch.as_tensor(observations, dtype=torch.float32, device=self.device)
            return self.cost_critic(inputs).squeeze(-1).cpu().numpy()

    def _update_info_buffer(self, infos: list[dict[str, Any]], dones: NDArray[Any] | None = None) -> None:
        """What Stable-Baselines3 calls with the infos of every step."""
        super()._update_info_buffer(infos, dones)
        ahead = np.zeros(len(infos), np.float32)
        for e, info in enumerate(infos):
            if info.get("TimeLimit.truncated", False):  # the episode would have gone on
                ahead[e] = self.gamma * self.cost_to_come(info["terminal_observation"])
        self._costs.append(np.array([info[COST] for info in infos], np.float32))
        self._ahead.append(ahead)

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Play, and put the cost into the advantages."""
        self._costs, self._ahead = [], []
        going = super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
        if going:
            self.weigh(rollout_buffer, np.array(self._costs), np.array(self._ahead))
        return going

    def weigh(self, rollout: RolloutBuffer, costs: NDArray[np.float32], ahead: NDArray[np.float32]) -> None:
        """Adapt the multiplier, put the cost into a rollout's advantages, and keep what the cost's critic is to learn.

        Args:
            rollout: As PPO has left it.
            costs: Of its steps, shape (steps, environments).
            ahead: What would still have come where an episode was cut off, else 0; same shape.
        """
        share = self.limit.adapt(self.multiplier, costs)
        self.logger.record("constraint/cost_rate", share)
        self.logger.record("constraint/multiplier", self.multiplier.item())
        own = RolloutBuffer(
            rollout.buffer_size,
            self.observation_space,
            self.action_space,
            "cpu",
            self.gae_lambda,
            self.gamma,
            self.n_envs,
        )
        own.rewards, own.episode_starts = costs + ahead, rollout.episode_starts
        own.values = self.cost_to_come(rollout.observations)
        last = torch.as_tensor(self.cost_to_come(self._last_obs))
        assert self._last_episode_starts is not None
        own.compute_returns_and_advantage(last, self._last_episode_starts)
        weight, gain = self.multiplier.item(), rollout.advantages
        gain = (gain - gain.mean()) / (gain.std() + 1e-8)
        rollout.advantages = (gain - weight * (own.advantages - own.advantages.mean())) / (1.0 + weight)
        self.seen = rollout.observations.reshape(-1, rollout.observations.shape[-1]).copy()
        self.targets = own.returns.reshape(-1).astype(np.float32)

    def train(self) -> None:
        """Update the policy and its critic as PPO does, then the cost's critic."""
        super().train()
        self._update_learning_rate(self.cost_optimizer)
        seen, targets = (torch.as_tensor(part, device=self.device) for part in (self.seen, self.targets))
        for _ in range(self.n_epochs):
            for chosen in torch.randperm(len(seen)).split(self.batch_size):
                loss = nn.functional.mse_loss(self.cost_critic(seen[chosen]).squeeze(-1), targets[chosen])
                self.cost_optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(self.cost_critic.parameters(), self.max_grad_norm)
                self.cost_optimizer.step()
        self.logger.record("constraint/value_loss", loss.item())


class CostBuffer(ExecutedBuffer):
    """A replay buffer that keeps costs beside rewards, and gives rewards less ``multiplier`` times the cost."""

    multiplier: torch.Tensor
    costs: NDArray[np.float32]

    def add(
        self,
        obs: NDArray[Any],
        next_obs: NDArray[Any],
        action: NDArray[Any],
        reward: NDArray[Any],
        done: NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        self.costs[self.pos] = [info[COST] for info in infos]
        super().add(obs, next_obs, action, reward, done, infos)

    def _get_samples(self, batch_inds: NDArray[Any], env: VecNormalize | None = None) -> ReplayBufferSamples:
        # of numpy's global generator, as Stable-Baselines3's own, which the training's seed sets
        at = batch_inds, np.random.randint(self.n_envs, size=len(batch_inds))  # noqa: NPY002
        rewards = self.rewards[at] - self.multiplier.item() * self.costs[at]
        over = self.dones[at] * (1.0 - self.timeouts[at])
        seen: list[Any] = [self._normalize_obs(part[at], env) for part in (self.observations, self.next_observations)]
        parts = (seen[0], self.actions[at], seen[1], over[:, None], rewards[:, None])
        return ReplayBufferSamples(*map(self.to_torch, parts))


class ConstrainedSAC(SAC):
    r"""SAC that learns from :math:`r - \lambda c`, after Tessler, Mankowitz and Mannor, "Reward constrained policy
    optimization" (2019).

    What is in the buffer counts with the multiplier of the moment at which it is sampled.
    """

    def constrain(self, limit: CostLimit) -> None:
        """Say what the limit is; once, before anything is learnt."""
        self.limit = limit
        self.multiplier = torch.zeros((), device=self.device)
        assert isinstance(self.replay_buffer, CostBuffer)
        self.replay_buffer.multiplier = self.multiplier
        self.replay_buffer.costs = np.zeros_like(self.replay_buffer.rewards)

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        states, tensors = super()._get_torch_save_params()
        return states, [*tensors, "multiplier"]

    def _update_info_buffer(self, infos: list[dict[str, Any]], dones: NDArray[Any] | None = None) -> None:
        """What Stable-Baselines3 calls with the infos of every step."""
        super()._update_info_buffer(infos, dones)
        if self.num_timesteps > self.learning_starts:  # actions before are nobody's
            share = self.limit.adapt(self.multiplier, np.array([info[COST] for info in infos]))
            self.logger.record_mean("constraint/cost_rate", share)
            self.logger.record("constraint/multiplier", self.multiplier.item())
