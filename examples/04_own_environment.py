"""A shield around an environment of one's own: it needs ``robot``, ``dt`` and ``scene``, and says what is missing."""

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.humans import Body, nobody
from jssa_gym.robots import make_robot
from jssa_gym.types import JointState, Planes, Scene


class Cell(gym.Env):
    """An arm on a table, and a person who stands there and is measured in every step."""

    def __init__(self) -> None:
        self.robot, self.dt = make_robot("ur5e").mounted([0.0, 0.0, 0.8]), 0.008
        self.action_space = gym.spaces.Box(-1.0, 1.0, (self.robot.n,), np.float32)
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (3 * self.robot.n,))
        self.table = Planes(np.array([[0.0, 0.0, 1.0]]), np.array([0.8]), ("table",))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.time, self.state = 0.0, np.zeros((3, self.robot.n))
        self.state[0] = self.robot.home
        return self.state.ravel(), {}

    def step(self, action):
        jerk, dt = np.asarray(action, float) * self.robot.limits.jerk, self.dt
        q, v, a = self.state
        self.state = np.array(
            [q + v * dt + a * dt**2 / 2 + jerk * dt**3 / 6, v + a * dt + jerk * dt**2 / 2, a + jerk * dt]
        )
        self.time += dt
        return self.state.ravel(), 0.0, False, self.time > 2.0, {}

    @property
    def scene(self) -> Scene:
        person = Body.facing().at((1.3, 0.0), (0.0, 0.0))
        arm = JointState(*self.state.copy())
        count = len(person.radius)
        return Scene(self.time, arm, person, nobody(), self.table, np.zeros(count), np.ones(count, bool))


def main() -> None:
    print(jssa_gym.check_env(Cell()))
    env = jssa_gym.JSSAShield(Cell())
    env.reset(seed=0)
    env.action_space.seed(0)
    statuses = [env.step(env.action_space.sample())[-1]["shield/status"] for _ in range(200)]
    print({status.name: statuses.count(status) for status in jssa_gym.Status})


if __name__ == "__main__":
    main()
