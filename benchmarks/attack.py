"""Cross-entropy search for people and policies that break a shield, whole and with one guard removed.

python benchmarks/attack.py --shields full no_speed no_verification --generations 25 --population 40
"""

import argparse
import json
from pathlib import Path

from jssa_gym.evaluation.adversary import search
from jssa_gym.evaluation.statistics import Rate
from jssa_gym.storage import write_whole


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shields", nargs="+", default=["full", "no_speed", "no_lag", "no_verification", "off_by_one"])
    parser.add_argument("--who", nargs="+", default=["person", "policy", "both"])
    parser.add_argument("--generations", type=int, default=8)
    parser.add_argument("--population", type=int, default=20)
    parser.add_argument("--restarts", type=int, default=1)
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    options = parser.parse_args()
    rows = []
    for shield in options.shields:
        for who in options.who:
            for seed in range(options.restarts):
                found = search(
                    shield, who=who, generations=options.generations, population=options.population, seed=seed
                )
                broken, worst = sum(outcome.breaks for outcome in found), found[0]
                rows.append(
                    {
                        "shield": shield,
                        "who": who,
                        "seed": seed,
                        "episodes": len(found),
                        "broken": broken,
                        "contact_speed": worst.contact_speed,
                        "violation": worst.violation,
                        "contacts": sum(outcome.contact for outcome in found),
                    }
                )
                print(
                    f"{shield:16} {who:7} seed {seed}: {Rate.of(broken, len(found))} broken, fastest contact "
                    f"{worst.contact_speed:.2g} m/s, contacts {rows[-1]['contacts']}",
                    flush=True,
                )
                if options.out:
                    write_whole(options.out, json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
