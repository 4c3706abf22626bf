"""What stands between a robot's file and an arm that can be guarded: one line each, all of them at once."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FileFinding:
    """Something about a file that somebody has to know."""

    subject: str
    """Body, joint, geom or file that it is about."""
    text: str
    """What is the case."""
    remedy: str = ""
    """What to write to have it otherwise."""
    stands: bool = False
    """Whether it stands in the way: no model is written until it is dealt with."""
    fits: bool = True
    """Whether the file itself can be taken as it is, this set aside."""

    def __str__(self) -> str:
        return f"{self.subject} {self.text}" + (f": {self.remedy}" if self.remedy else "")


def obstacle(subject: str, text: str, remedy: str) -> FileFinding:
    """Something that only the user can decide."""
    return FileFinding(subject, text, remedy, stands=True, fits=False)


def repaired(subject: str, text: str, remedy: str = "") -> FileFinding:
    """Something that keeps the file itself from being taken, and that a prepared model does without."""
    return FileFinding(subject, text, remedy, fits=False)
