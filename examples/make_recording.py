"""Synthesise the recording that ``human="recorded"`` plays, and play it beside the arm.

The paper's body walks up from 1.8 m, stops 1.3 m from the base axis, reaches towards the arm with the right hand, takes
it back and steps back: every way with the least jerk, 25 samples a second. ``--out`` writes the file.
"""

import argparse
from pathlib import Path

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.humans import Body, Recorded, Recording
from jssa_gym.humans.body import NAMES

RATE = 25.0
RIGHT = NAMES.index("right_arm")


def smooth(time, begin, end):
    """From 0 to 1 between two moments, at rest at both."""
    x = np.clip((time - begin) / (end - begin), 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def synthesise() -> Recording:
    time = np.arange(int(7.2 * RATE) + 1) / RATE
    x = 1.8 - 0.5 * smooth(time, 0.2, 1.6) + 0.5 * smooth(time, 5.4, 7.0)
    out = smooth(time, 1.4, 2.4) - smooth(time, 4.4, 5.4)
    body = Body.facing()
    root = np.stack([x, 0.05 * np.sin(np.pi * (1.8 - x) / 0.5), np.zeros_like(x)], axis=1)
    start, end = root[:, None] + body.start, root[:, None] + body.end
    end[:, RIGHT] += out[:, None] * (np.array([-0.5, 0.15, 1.15]) - body.end[RIGHT])
    return Recording(time, start, end, body.radius, NAMES)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="an .npz file to write")
    out = parser.parse_args().out
    recording = synthesise()
    if out is not None:
        recording.save(out)
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0", human=Recorded(recording)))
    policy = jssa_gym.HoldPolicy(env)
    observation, info = env.reset(seed=0)
    nearest = info["distance"]
    for _ in range(1000):
        observation, _, terminated, truncated, info = env.step(policy(observation))
        nearest = min(nearest, info["distance"])
        if terminated or truncated:
            break
    print(f"{recording.duration:.1f} s, up to {recording.speed:.2f} m/s; smallest distance {nearest:.3f} m")


if __name__ == "__main__":
    main()
