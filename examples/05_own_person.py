"""A person of one's own, seen late: what a shield makes of somebody who paces, through a sensor with 100 ms of lag."""

import argparse

import gymnasium as gym

import jssa_gym
from jssa_gym.humans import Walk


class Pacer(Walk):
    """Paces up and down in front of the arm."""

    speed_bound = 0.5  # no point of the body moves faster [m/s]

    def _begin(self, rng, start):
        self._clock = 0.0
        root = (1.0, rng.uniform(-0.5, 0.5)) if start is None else start
        return root, 3.14  # where it starts (2,) [m], the heading [rad]

    def _next_velocity(self, dt):
        self._clock += dt
        return 0.0, 0.5 if self._clock % 4.0 < 2.0 else -0.5  # of the step to come [m/s]


def make() -> gym.Env:
    env = gym.make("jssa_gym/Reach-v0", human=Pacer(), terminate_on=())
    return jssa_gym.JSSAShield(jssa_gym.SensorModel(env, "latency 100 ms"))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=20)
    report = jssa_gym.evaluate(make, "jpc", episodes=parser.parse_args().episodes)
    print(f"success {report.rates['success_rate']}, contact while moving {report.rates['moving_contact_rate']}")


if __name__ == "__main__":
    main()
