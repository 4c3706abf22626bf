"""Tables of a comparison for the docs: cell by cell, and where one filter is not the best.

    jssa-gym compare --tasks ... --filters ... --out board
    python benchmarks/leaderboard.py board
    python benchmarks/leaderboard.py

Several folders are one table; none may repeat a cell of another. Without any it is the stored leaderboard, which
--store FILE makes of folders (its SHA-256 is printed). The first filter, or those of --ours, are compared with every
other one in every cell (task, people, policy) on the same seeds: "behind" means that the 95 % interval of the paired
difference excludes 0 to its disadvantage. Many cells and rivals make some by chance. A cell counts only where ours and
every rival have the same seeds. Success without contact is success in an episode in which nobody was touched, by an arm
at rest neither. How the arm moves and how long it takes is told of episodes that have these columns; folders of older
versions have not. --rivals names those that count; by default all.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jssa_gym.board import STORED, Episodes, all_tables, read_board, read_folders, store_board
from jssa_gym.board.tables import complete_cells, filters_of, policies_of, rate
from jssa_gym.evaluation.identity import made_with
from jssa_gym.exceptions import ParameterError
from jssa_gym.palette import COLOURS
from jssa_gym.shields.registry import WHOLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw(found: Episodes, filters: Sequence[str], policies: Sequence[str], path: Path) -> None:
    """Contacts of everything against success without contact of the policies that want it, with intervals."""
    from jssa_gym.plots.style import styled  # the tables do without

    styled(_scatter)(found, filters, policies).savefig(path, dpi=110)


def _scatter(found: Episodes, filters: Sequence[str], policies: Sequence[str]) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    axes = figure.subplots()
    for k, name in enumerate(filters):
        everything = [e for cell in found.values() for e in cell[name].values()]
        wanted = [e for key, cell in found.items() if key[2] in policies for e in cell[name].values()]
        x, y = rate(everything, "contact"), rate(wanted, "success without contact")
        spread = [[[100 * (r.value - r.low)], [100 * (r.high - r.value)]] for r in (x, y)]
        # a colour comes again with another shape; hollow ones have no verified stop
        shape = "osD^v"[k // len(COLOURS) % 5]
        fill = "full" if name.endswith("+stop") or name in WHOLE else "none"
        style = {"marker": shape, "fillstyle": fill, "color": COLOURS[k % len(COLOURS)], "markersize": 8}
        axes.errorbar(100 * x.value, 100 * y.value, spread[1], spread[0], label=name, elinewidth=1.0, **style)
    axes.set(xlabel="episodes with a contact, at rest or in motion [%]", ylabel="success without a contact [%]")
    figure.legend(loc="outside right upper", title="filled: verified stop,\nno contact in motion")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--ours", nargs="*", help="filters that are compared with the others; the first by default")
    parser.add_argument("--rivals", nargs="*", help="filters that count as others; all by default")
    parser.add_argument("--purposeful", nargs="*", default=["jpc"], help="policies that want to succeed")
    parser.add_argument("--figure", type=Path, help="draw safety against success into this file")
    parser.add_argument(
        "--store", type=Path, nargs="?", const=STORED, help="store the folders' episodes in this file, by default ours"
    )
    args = parser.parse_args()
    print(f"{made_with()}\n")
    try:
        if args.store is not None:
            digest = store_board(args.folders, args.store)
            print(f"{args.store}: {args.store.stat().st_size:,} bytes, SHA-256 of the table {digest}\n")
        if args.folders:
            found = read_folders(args.folders)
        else:
            board = read_board()
            found = board.episodes
            print(f"SHA-256 of the table {board.digest}\n")
    except ParameterError as error:
        raise SystemExit(str(error)) from error
    filters, policies = filters_of(found), policies_of(found)
    for option, names, known in (
        ("--ours", args.ours, filters),
        ("--rivals", args.rivals, filters),
        ("--purposeful", args.purposeful, policies),
    ):
        if missing := sorted({*(names or ())} - {*known}):
            parser.error(f"{option}: nothing of {', '.join(missing)} in there; there is {', '.join(known)}")
    found, short = complete_cells(found)
    if short:
        print(f"incomplete, and so left out: {'; '.join(', '.join(key) for key in short)}\n")
    if not found:
        parser.error("no cell in which all filters have the same seeds")
    for line in all_tables(found, args.ours or filters[:1], args.rivals, args.purposeful):
        print(line)
    if args.figure:
        draw(found, filters, args.purposeful, args.figure)


if __name__ == "__main__":
    main()
