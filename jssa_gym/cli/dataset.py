"""``jssa-gym dataset``: episodes as a data set that Minari reads."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from jssa_gym.cli.evaluate import find_policies_here, ticks
from jssa_gym.cli.names import FILTER, OWN_HUMAN, POLICY, ROBOT, TASK, TRUST
from jssa_gym.cli.progress import Bar
from jssa_gym.cli.terminal import Terminal
from jssa_gym.datasets import DESCRIBED, Recipe, read_digest, write_dataset
from jssa_gym.exceptions import ParameterError
from jssa_gym.robots import DEFAULT
from jssa_gym.shields import TASK_SHIELD
from jssa_gym.storage import as_json
from jssa_gym.text import counted
from jssa_gym.validation import known_name

_DESCRIBED = tyro.conf.arg(
    help=f"One of those with a card in docs/datasets.md, instead of all options but --out: {', '.join(DESCRIBED)}. The "
    "exit code is 1 if it comes out otherwise than the card says."
)


@dataclass(frozen=True)
class DatasetCommand:
    """Episodes step by step, with everybody's tracks and the shield's decisions, for learning without an environment.

    They are written as Minari's loader reads them, whose folder of data sets --out is. The same command gives the same
    data. 100 episodes take about half a minute of one core and 20 to 30 MB. Needs the extra data.
    """

    task: Annotated[str, TASK] = "reach"
    policy: Annotated[str, POLICY] = "jpc"
    shield: Annotated[str, FILTER] = TASK_SHIELD
    human: Annotated[str | None, OWN_HUMAN] = None
    episodes: int = 100
    """How many."""
    seed: int = 0
    """First seed."""
    seconds: float = 8.0
    """Longest episode."""
    robot: Annotated[str, ROBOT] = DEFAULT
    name: str | None = None
    """Name of the data set, with namespace and version, such as mine/reach-v0; made of the names above if there is
    none."""
    described: Annotated[str | None, _DESCRIBED] = None
    out: Path = Path("datasets")
    """Folder of data sets, which the environment variable MINARI_DATASETS_PATH tells Minari."""
    check: Path | None = None
    """Make none: tell whether the one in this folder, such as datasets/mine/reach-v0, still is what it was. The exit
    code is 1 if not. No other option but --json."""
    trust_pickle: Annotated[bool, TRUST] = False
    json: bool = False
    """Print JSON instead of lines."""

    def run(self) -> None:
        """Play and write, or check."""
        if self.check is not None:
            self._check(self.check)
            return
        name, recipe, expected = self.name, self._recipe(), ""
        if self.described is not None:
            known_name("data set", self.described, DESCRIBED)
            name, expected = self.described, DESCRIBED[self.described].digest
        console = Terminal(stderr=True)
        with Bar(console) as progress:
            bar = progress.add_task("episodes", total=recipe.episodes)
            made = write_dataset(
                self.out, recipe, name, lambda done, total: progress.update(bar, completed=done, total=total)
            )
        same = made.digest == expected
        if self.json:
            print(json.dumps({**as_json(made), **({"as_described": same} if expected else {})}, indent=2))
        else:
            out = Terminal()
            told = f"{counted(made.episodes, 'episode')}, {made.steps:,} steps, {made.size / 1e6:.1f} MB"
            out.say(f"{made.name}: {told}, SHA-256 {made.digest}")
            if expected:
                out.say("as its card says" if same else f"not as its card says, which has {expected}")
        console.say(f"wrote {made.path}; with MINARI_DATASETS_PATH={self.out}: minari.load_dataset({made.name!r})")
        if expected and not same:
            raise SystemExit(1)

    def _recipe(self) -> Recipe:
        if self.described is not None:
            others = DatasetCommand(described=self.described, out=self.out, json=self.json)
            if self != others:
                raise ParameterError("--described says all of a data set: leave the other options but --out out")
            return DESCRIBED[known_name("data set", self.described, DESCRIBED)].recipe
        find_policies_here([self.policy])
        return Recipe(
            self.task,
            self.policy,
            self.shield,
            self.human or "",
            self.episodes,
            self.seed,
            ticks(self.seconds),
            self.robot,
            self.trust_pickle,
        )

    def _check(self, folder: Path) -> None:
        if self != DatasetCommand(check=folder, json=self.json):
            raise ParameterError("--check makes no data set: leave the other options but --json out")
        found, said = read_digest(folder)
        if self.json:
            print(json.dumps({"sha256": found, "as_written": found == said}))
        else:
            Terminal().say(
                f"as it was written: SHA-256 {found}" if found == said else f"changed: SHA-256 {found}, was {said}"
            )
        if found != said:
            raise SystemExit(1)
