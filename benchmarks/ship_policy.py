"""Evaluate a trained policy with and without the shield, write the figures into its file, and put it into the package.

    python benchmarks/ship_policy.py my-training/best.npz reach-ppo --episodes 1000 --jobs 2 --out trained

The evaluations are those of `benchmarks/trained.py`: one that is in the folder already is read, an interrupted one goes
on. The seeds of the training's own evaluations, by which the file was chosen, are others.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from trained import exceeded, played, without_contact

from jssa_gym.evaluation.statistics import Rate
from jssa_gym.policies import read_policy, save_policy
from jssa_gym.policies.loading import SHIPPED
from jssa_gym.train import TrainConfig, preset


def figures(policy: str, task: str, shield: bool, args: argparse.Namespace) -> dict[str, Any]:
    """What a file says about an evaluation."""
    report = played(policy, task, shield, args.episodes, seed=args.seed, jobs=args.jobs, out=args.out)
    rates = {
        "success_without_contact": Rate.of(int(sum(without_contact(report))), len(report.episodes)),
        "moving_contacts": report.rates["moving_contact_rate"],
        "contacts": report.rates["collision_rate"],
        "limits_exceeded": exceeded(report),
    }
    print(f"{'with' if shield else 'without'} shield: {'; '.join(f'{name} {rate}' for name, rate in rates.items())}")
    return {
        "shield": shield,
        "episodes": len(report.episodes),
        "first_seed": args.seed,
        **{name: [rate.k, rate.low, rate.high] for name, rate in rates.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", help="best.npz of a training")
    parser.add_argument("name", help="name that it will have in the package")
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("trained"))
    args = parser.parse_args()
    policy = read_policy(args.policy)
    training, task = policy.provenance["training"], policy.task.capitalize()
    tuned = preset(policy.task, training["settings"]["algorithm"])
    if not training["shield"]:  # as the command has it
        tuned = replace(tuned, shield=False, learn_from="policy")
    if TrainConfig.of(training) != replace(tuned, seed=training["seed"]):
        raise SystemExit(f"{args.policy} was trained otherwise than the preset: its command would not make it again")
    # what its folder was called on somebody's machine is of no use to others
    command = ["jssa-gym train", f"--task {policy.task}", f"--algorithm {training['settings']['algorithm']}"]
    command += [f"--seed {training['seed']}", *([] if training["shield"] else ["--no-shield"])]
    provenance = {
        **policy.provenance,
        "command": " ".join([*command, f"--out {args.name}"]),
        "evaluation": {
            "command": f"python benchmarks/trained.py {args.name} --task {task} --episodes {args.episodes}",
            "results": [figures(args.policy, task, shield, args) for shield in (True, False)],
        },
    }
    save_policy(SHIPPED / f"{args.name}.npz", policy.with_provenance(provenance))
    print(f"wrote {SHIPPED / args.name}.npz")


if __name__ == "__main__":
    main()
