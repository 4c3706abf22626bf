"""Train PPO inside the shield: ``python examples/train_ppo.py --steps 200000``; needs the extra ``train``."""

import argparse

import gymnasium as gym
from stable_baselines3 import PPO

import jssa_gym


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--steps", type=int, default=200_000)
    steps = parser.parse_args().steps
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Reach-v0"))
    env = jssa_gym.ActionRepeat(env, 5)  # the policy at 25 Hz, the shield at 125 Hz
    model = PPO("MlpPolicy", env, n_steps=min(2048, steps), device="cpu", seed=0, verbose=1)
    model.learn(steps)


if __name__ == "__main__":
    main()
