"""The command line ``jssa-gym``."""

import functools
import sys
from collections.abc import Sequence
from typing import Annotated

import tyro

from jssa_gym.cli import terminal
from jssa_gym.cli.arguments import given_once, parsed
from jssa_gym.cli.audit import AuditLog
from jssa_gym.cli.bench import Bench
from jssa_gym.cli.certify import Certify
from jssa_gym.cli.compare import Compare
from jssa_gym.cli.demo import Demo
from jssa_gym.cli.evaluate import Evaluate
from jssa_gym.cli.recording import RecordingCommand
from jssa_gym.cli.replay import Replay
from jssa_gym.cli.reproduce import Reproduce
from jssa_gym.cli.robot import RobotCommand
from jssa_gym.cli.stress import Stress
from jssa_gym.cli.train import Train
from jssa_gym.cli.view import ViewCommand
from jssa_gym.evaluation.ledger import package_version
from jssa_gym.exceptions import JSSAGymError

Command = Annotated[
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[ViewCommand, tyro.conf.subcommand("view")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
    | Annotated[Certify, tyro.conf.subcommand("certify")]
    | Annotated[Stress, tyro.conf.subcommand("stress")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Compare, tyro.conf.subcommand("compare")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[RecordingCommand, tyro.conf.subcommand("recording")]
    | Annotated[Replay, tyro.conf.subcommand("replay")]
    | Annotated[Reproduce, tyro.conf.subcommand("reproduce")]
    | Annotated[RobotCommand, tyro.conf.subcommand("robot")]
    | Annotated[AuditLog, tyro.conf.subcommand("audit")],
    tyro.conf.arg(name=""),
]


def main() -> None:
    """Run a command; a bad input or a full disk ends in one line and exit code 2, Ctrl-C in one and exit code 130."""
    arguments = sys.argv[1:]
    with terminal.prepared():
        try:
            try:
                if arguments == ["--version"]:
                    print(f"jssa-gym {package_version()}")
                else:
                    _parse(arguments).run()
            finally:
                sys.stdout.flush()  # at the interpreter's end nobody could be told that it was in vain
        except BrokenPipeError:  # nobody reads any more
            terminal.abandon_output()
            raise SystemExit(1) from None
        except (JSSAGymError, OSError) as error:
            terminal.complain(error)
            terminal.abandon_output()
            raise SystemExit(2) from error
        except KeyboardInterrupt:  # of commands that do not know better what they leave behind
            terminal.complain("stopped; give the same command again")
            terminal.abandon_output()
            raise SystemExit(130) from None


def _parse(arguments: Sequence[str]) -> Command:
    given_once(arguments)
    parse = functools.partial(
        tyro.cli, Command, prog="jssa-gym", description="A robot arm beside people, and shields around it."
    )
    return parsed(lambda words: parse(args=words), arguments)
