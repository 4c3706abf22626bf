"""A filter of one's own in the shield: stops the arm while anybody is closer than half a metre."""

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.safety.proximity import measure
from jssa_gym.types import Decision, Status

NEAR = 0.5


class Brake(jssa_gym.SafetyFilter):
    def respond(self, tick):
        near = measure(tick.robot, tick.scene.robot, tick.scene.human, tick.scene.planes)
        if near.smallest < NEAR:
            jerk, status, reason = self.fallback(tick.state), Status.PROJECTED, "somebody is near"
        elif tick.inside:
            jerk, status, reason = tick.clipped, Status.NOMINAL, ""
        else:
            jerk, status, reason = tick.clipped, Status.PROJECTED, tick.why_clipped
        return Decision(jerk, tick.nominal, status, reason, np.nan, near.smallest, near.pair, 0.0, 0)


def main() -> None:
    env = gym.make("jssa_gym/Home-v0", terminate_on=())
    env = jssa_gym.Shield(env, Brake(env.unwrapped.robot, env.unwrapped.dt))
    policy = jssa_gym.RandomPolicy(env, seed=0)
    observation, _ = env.reset(seed=0)
    stopped = 0
    for _ in range(1000):
        observation, *_, info = env.step(policy(observation))
        stopped += info["shield/reason"] == "somebody is near"
    print(f"the arm braked or stood in {stopped} of 1000 steps")


if __name__ == "__main__":
    main()
