"""What training inside the shield costs: time of a leg with and without it, side by side in one run.

    python benchmarks/training_overhead.py --task reach --legs 6

Both learn from the same seed; legs alternate, so that a machine that is slow for a while is slow for both. The time is
that of learning alone, without the evaluations.
"""

import argparse
import statistics
import tempfile
from dataclasses import replace
from pathlib import Path

import torch

from jssa_gym.train import preset, train


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="reach")
    parser.add_argument("--algorithm", default="ppo")
    parser.add_argument("--legs", type=int, default=6)
    parser.add_argument("--steps", type=int, default=1024, help="policy steps of a leg")
    args = parser.parse_args()
    torch.set_num_threads(1)
    tuned = replace(preset(args.task, args.algorithm), interval=args.steps, eval_episodes=1)
    tuned = replace(tuned, settings=replace(tuned.settings, decay=False))  # so that a training can be given more steps
    seconds: dict[bool, list[float]] = {True: [], False: []}
    with tempfile.TemporaryDirectory() as folder:
        for leg in range(args.legs + 1):
            for shield in (True, False):
                config = replace(tuned, steps=(leg + 1) * args.steps, shield=shield)
                training = train(config, Path(folder) / str(shield))
                if leg:  # the first one compiles
                    seconds[shield].append(training.history[-1].seconds)
    inside, without = (statistics.median(seconds[shield]) for shield in (True, False))
    ratios = [one / other for one, other in zip(seconds[True], seconds[False], strict=True)]
    print(f"{args.steps:,} policy steps of {tuned.ticks} control steps, medians of {args.legs} legs:")
    print(f"inside the shield {inside:.1f} s ({args.steps / inside:.0f} policy steps/s), "
          f"without {without:.1f} s ({args.steps / without:.0f}/s)")  # fmt: skip
    print(f"{inside / without:.2f} times as long (leg by leg {min(ratios):.2f} to {max(ratios):.2f})")


if __name__ == "__main__":
    main()
