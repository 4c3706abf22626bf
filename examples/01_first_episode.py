"""The same person walks up to the arm twice: without a shield, and with one."""

import gymnasium as gym

import jssa_gym


def nearest(env: gym.Env) -> float:
    """Smallest distance between arm and person in one episode [m]."""
    policy = jssa_gym.HoldPolicy(env)  # wants to stay at home
    observation, info = env.reset(seed=3)
    distances, truncated = [info["distance"]], False
    while not truncated:
        observation, _, _, truncated, info = env.step(policy(observation))
        distances.append(info["distance"])
    return min(distances)


def main() -> None:
    env = gym.make("jssa_gym/Home-v0", human="approach_retreat", terminate_on=())
    print(f"without a shield: {nearest(env):+.3f} m")
    print(f"with JSSAShield:  {nearest(jssa_gym.JSSAShield(env)):+.3f} m")


if __name__ == "__main__":
    main()
