"""What a step with the position controller costs an arm, many at once beside one by itself in the same process.

    python benchmarks/vector_jpc.py

Processor time of a step, an arm, of the policy and of the environment with its shield: means over whole rounds of Track
beside ``walk_by``, plans, ways back and new episodes included, in which one arm and 64 take turns.
"""

import argparse
import os
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads wait for each other where there are fewer cores

SHIELDS = (None, "jssa+stop", "work")


class One:
    """One arm by itself, whose episodes follow each other."""

    count = 1

    def __init__(self, shield):
        import gymnasium as gym

        import jssa_gym

        env = gym.make("jssa_gym/Track-v0", human="walk_by", disable_env_checker=True)
        self._env = env if shield is None else jssa_gym.Shield(env, shield)
        self._seed = -1
        self._begin()

    def _begin(self):
        import jssa_gym

        self._seed += 1
        self._policy = jssa_gym.JPCPolicy(self._env, self._seed)
        self._seen, _ = self._env.reset(seed=self._seed)

    def step(self, times):
        start = time.process_time()
        action = self._policy(self._seen)
        between = time.process_time()
        self._seen, _, terminated, truncated, _ = self._env.step(action)
        times += (between - start, time.process_time() - between)
        if terminated or truncated:
            self._begin()


class Many:
    """Many arms at once."""

    def __init__(self, shield, count):
        import gymnasium as gym
        import numpy as np

        from jssa_gym.policies.vector_jpc import VectorJPCPolicy

        self.count = count
        self._env = gym.make_vec(
            "jssa_gym/Track-v0", count, human="walk_by", shield=shield, autoreset_mode="SameStep"
        )  # fmt: skip
        self._policy = VectorJPCPolicy(self._env)
        self._policy.begin(np.arange(count), range(count))
        self._seen, _ = self._env.reset(seed=0)
        self._seed = count

    def step(self, times):
        start = time.process_time()
        actions = self._policy(self._seen)
        between = time.process_time()
        self._seen, _, terminated, truncated, _ = self._env.step(actions)
        times += (between - start, time.process_time() - between)
        over = (terminated | truncated).nonzero()[0]
        if len(over):
            self._policy.begin(over, range(self._seed, self._seed + len(over)))
            self._seed += len(over)


def main() -> None:
    import numpy as np

    from jssa_gym.evaluation.identity import made_with

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=20)
    options = parser.parse_args()
    print(made_with())
    print(f"{'':12}{'one: policy':>14}{'with step':>14}{f'{options.arms}: policy':>14}{'with step':>14}")
    for shield in SHIELDS:
        contenders = One(shield), Many(shield, options.arms)
        costs = []
        for contender in contenders:
            contender.step(np.zeros(2))  # compiled
        times = np.zeros((2, 2))
        for _ in range(options.rounds):
            for contender, spent in zip(contenders, times, strict=True):
                for _ in range(200 if contender.count == 1 else 50):
                    contender.step(spent)
        for contender, spent in zip(contenders, times, strict=True):
            steps = options.rounds * (200 if contender.count == 1 else 50 * contender.count)
            costs += [1e6 * spent[0] / steps, 1e6 * spent.sum() / steps]
        shown = "".join(f"{cost:11.1f} µs" for cost in costs)
        print(f"{shield or 'none':12}{shown}  ({costs[1] / costs[3]:.1f} x)", flush=True)


if __name__ == "__main__":
    main()
