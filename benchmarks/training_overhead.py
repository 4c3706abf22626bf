"""What training inside the shield costs: time of a leg with and without it, side by side in one run.

    python benchmarks/training_overhead.py --algorithm ppo --envs 1 8 64 512 --legs 3

Both learn from the same seed; legs alternate, so that a machine that is slow for a while is slow for both. The time is
this process's processor time, of learning alone, without the evaluations.
"""

import argparse
import statistics
import tempfile
from dataclasses import replace
from pathlib import Path

import torch

from jssa_gym.evaluation.identity import made_with
from jssa_gym.train import PPO, TrainConfig, preset, train


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="reach")
    parser.add_argument("--algorithm", default="ppo")
    parser.add_argument("--envs", type=int, nargs="+", default=[8])
    parser.add_argument("--ticks", type=int, nargs="+", default=[25], help="control steps of a policy step")
    parser.add_argument("--legs", type=int, default=6)
    parser.add_argument(
        "--steps", type=int, default=1024, help="policy steps of a leg; at least 16 of each environment"
    )
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    torch.set_num_threads(1)
    print(f"medians of {args.legs} legs, processor time of a policy step [ms], inside the shield and without:")
    for envs in args.envs:
        for ticks in args.ticks:
            print(measured(args, envs, ticks), flush=True)


def measured(args: argparse.Namespace, envs: int, ticks: int) -> str:
    """A line about so many environments."""
    steps = max(args.steps, 16 * envs)
    tuned = replace(preset(args.task, args.algorithm), interval=steps, eval_episodes=1)
    settings = replace(tuned.settings, decay=False)  # so that a training can be given more steps
    if isinstance(settings, PPO):
        settings = replace(settings, rollout=steps)
    tuned = replace(tuned, envs=envs, ticks=ticks, settings=settings)
    spent: dict[bool, list[float]] = {True: [], False: []}
    with tempfile.TemporaryDirectory() as folder:
        for leg in range(args.legs + 1):
            for shield in (True, False):
                # without a shield there is nothing to tell of it
                told = tuned.learn_from if shield else "policy"
                config = replace(tuned, steps=(leg + 1) * steps, shield=shield, learn_from=told)
                seconds = of_a_leg(config, Path(folder) / str(shield))
                if leg:  # the first one compiles
                    spent[shield].append(1000.0 * seconds / steps)
    inside, without = (statistics.median(spent[shield]) for shield in (True, False))
    ratios = [one / other for one, other in zip(spent[True], spent[False], strict=True)]
    what = f"{envs:>4} environments, {ticks:>2} control steps: {inside:.3f} and {without:.3f}"
    times = f"{inside / without:.2f} times as long (leg by leg {min(ratios):.2f} to {max(ratios):.2f})"
    return f"{what}, {times}; the shield is {1.0 - without / inside:.0%} of it"


def of_a_leg(config: TrainConfig, folder: Path) -> float:
    """Processor time of a training's newest leg [s]."""
    return train(config, folder).history[-1].processor_seconds


if __name__ == "__main__":
    main()
