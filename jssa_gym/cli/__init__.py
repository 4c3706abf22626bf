"""The command line ``jssa-gym``."""

import sys
from collections.abc import Callable, Sequence
from typing import Protocol

import tyro
from tyro.extras import subcommand_cli_from_dict

from jssa_gym.cli import terminal
from jssa_gym.cli.arguments import given_once, parsed
from jssa_gym.cli.audit import AuditLog
from jssa_gym.cli.bench import Bench
from jssa_gym.cli.certify import Certify
from jssa_gym.cli.compare import Compare
from jssa_gym.cli.curves import Curves
from jssa_gym.cli.dataset import DatasetCommand
from jssa_gym.cli.demo import Demo
from jssa_gym.cli.evaluate import Evaluate
from jssa_gym.cli.leaderboard import LeaderboardCommand
from jssa_gym.cli.recording import RecordingCommand
from jssa_gym.cli.replay import Replay
from jssa_gym.cli.reproduce import Reproduce
from jssa_gym.cli.robot import RobotCommand
from jssa_gym.cli.stress import Stress
from jssa_gym.cli.train import Train
from jssa_gym.cli.view import ViewCommand
from jssa_gym.engine.source import package_version
from jssa_gym.exceptions import JSSAGymError, ParameterError


class Command(Protocol):
    """What the arguments of a command are parsed into."""

    def run(self) -> None:
        """Do it."""


COMMANDS: dict[str, Callable[..., Command]] = {
    "demo": Demo,
    "view": ViewCommand,
    "bench": Bench,
    "certify": Certify,
    "stress": Stress,
    "evaluate": Evaluate,
    "compare": Compare,
    "leaderboard": LeaderboardCommand,
    "train": Train,
    "dataset": DatasetCommand,
    "curves": Curves,
    "recording": RecordingCommand,
    "replay": Replay,
    "reproduce": Reproduce,
    "robot": RobotCommand,
    "audit": AuditLog,
}
"""Commands by name."""


_ABOUT = "A robot arm beside people, and shields around it. Whatever is played first compiles for up to a minute, once."


def main() -> None:
    """Run a command; a bad input or a full disk ends in one line and exit code 2, Ctrl-C in one and exit code 130."""
    arguments = sys.argv[1:]
    with terminal.prepared():
        try:
            try:
                if arguments == ["--version"]:
                    print(f"jssa-gym {package_version()}")
                else:
                    parse(arguments).run()
            finally:
                sys.stdout.flush()  # at the interpreter's end nobody could be told that it was in vain
        except BrokenPipeError:  # nobody reads any more
            terminal.abandon_output()
            raise SystemExit(1) from None
        except (JSSAGymError, OSError) as error:
            wrong = isinstance(error, ParameterError) and not isinstance(error.__cause__, OSError)
            asked = wrong and arguments[:1] and arguments[0] in COMMANDS
            terminal.complain(f"{error}; see jssa-gym {_whose(arguments)} --help" if asked else error)
            terminal.abandon_output()
            raise SystemExit(2) from error
        except KeyboardInterrupt:  # of commands that do not know better what they leave behind
            terminal.complain("stopped; give the same command again")
            terminal.abandon_output()
            raise SystemExit(130) from None


def _whose(arguments: Sequence[str]) -> str:
    """The command whose arguments these are; where it has actions, with the one that is asked for."""
    name, *rest = arguments
    has_actions = "action" in getattr(COMMANDS[name], "__annotations__", {})
    return " ".join([name, *rest[:1]]) if has_actions and rest and not rest[0].startswith("-") else name


def parse(arguments: Sequence[str]) -> Command:
    """The command that arguments make, to be run."""
    given_once(arguments)
    if arguments and arguments[0] in COMMANDS:  # by its own parser, whose errors name its own help
        name, *rest = arguments
        return parsed(lambda words: tyro.cli(COMMANDS[name], prog=f"jssa-gym {name}", args=words), rest)
    return parsed(
        lambda words: subcommand_cli_from_dict(COMMANDS, prog="jssa-gym", description=_ABOUT, args=words),
        arguments,
    )
