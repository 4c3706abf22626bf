"""What did a policy learn, and what did the shield do? Policies with and without it, on the same people and goals.

    python benchmarks/trained.py reach-ppo my-training/best.npz jpc --episodes 1000 --jobs 2 --out trained

Episodes run to the horizon of 8 s, so that what happens after success counts too; an evaluation that was interrupted
goes on. "Without a contact" is success in an episode in which nobody was touched, by an arm at rest neither.
"""

import argparse
from pathlib import Path

from jssa_gym.evaluation import Report, evaluate
from jssa_gym.evaluation.identity import made_with
from jssa_gym.evaluation.statistics import Rate, paired_difference

ASKED = ("success_and_safe", "moving_contact", "collision")


def without_contact(report: Report) -> list[float]:
    """Whether every episode had success without a contact, by seed."""
    return [float(one.summary.success and not one.summary.collision) for one in report.episodes]


def exceeded(report: Report) -> Rate:
    """Episodes with a joint limit exceeded."""
    return Rate.of(sum(one.summary.limit_violation_rate > 0.0 for one in report.episodes), len(report.episodes))


def played(
    policy: str, task: str, shield: bool, episodes: int, *, seed: int, jobs: int, out: Path, human: str | None = None
) -> Report:
    """A policy on a task, under its shielded id or the one without; an interrupted evaluation goes on."""
    name = f"{task}-{''.join(c if c.isalnum() else '_' for c in policy)}-{'yes' if shield else 'no'}"
    people = {} if human is None else {"human": human}
    env = f"jssa_gym/{task}{'Shielded' if shield else ''}-v0"
    return evaluate(env, policy, episodes, seed, env_kwargs=people, jobs=jobs, out=out / name, keep=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="+", help="names, or files of trained policies")
    parser.add_argument("--task", default="Reach")
    parser.add_argument("--human", help="people by name; the task's own by default")
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--bare", nargs="*", default=["yes", "no"], choices=["yes", "no"], help="without shield too?")
    parser.add_argument("--out", type=Path, default=Path("trained"))
    args = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    print("| policy | shield | success without a contact | safe success | moving contacts | contacts | limit exceeded |"
          " time to the goal | changed |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|")
    found: dict[tuple[str, str], Report] = {}
    for policy in args.policies:
        for bare in sorted(set(args.bare)):
            shield = "no" if bare == "yes" else "yes"
            report = played(
                policy, args.task, shield == "yes", args.episodes,
                seed=args.seed, jobs=args.jobs, out=args.out, human=args.human,
            )  # fmt: skip
            found[policy, shield] = report
            time = report.means.get("time_to_goal")
            changed = report.means.get("intervention_rate")
            safe, moving, contact = (report.rates[f"{x}_rate"] for x in ASKED)
            ok = Rate.of(int(sum(without_contact(report))), len(report.episodes))
            row = [f"`{policy}`", shield, ok, safe, moving, contact, exceeded(report)]
            row += ["–" if time is None else f"{time.value:.1f} s", "–" if changed is None else f"{changed.value:.0%}"]
            print(f"| {' | '.join(map(str, row))} |", flush=True)
    first = args.policies[0]
    for policy in args.policies[1:]:
        for shield in ("yes", "no"):
            if (policy, shield) in found:
                one, other = (without_contact(found[name, shield]) for name in (policy, first))
                print(f"\nshield {shield}: `{policy}` minus `{first}`, success without a contact, same seeds: "
                      f"{paired_difference(one, other)}")  # fmt: skip


if __name__ == "__main__":
    main()
