"""Films of recorded episodes, all with one look."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import Progress

from jssa_gym import plots
from jssa_gym.envs.camera import ELEVATION
from jssa_gym.envs.drawing import Marks, goal_points
from jssa_gym.envs.opengl import check_opengl
from jssa_gym.envs.surroundings import posed
from jssa_gym.envs.view import episode_camera, people_of
from jssa_gym.envs.world import SCENES, World
from jssa_gym.exceptions import DisplayError
from jssa_gym.palette import BLUE, CONTACT, GREEN, GREY, ORANGE, PINK, RED, rgb
from jssa_gym.robots import RobotModel
from jssa_gym.types import Status, Trace

EVERY = 5
"""A picture every so many control steps: 25 a second."""

HOLD = 100
"""For so many control steps a film stands still when a contact begins."""

_APART = 1.0
"""A contact that follows another one of the same episode sooner is not held again [s]."""

WIDTH, HEIGHT, DIVIDER = 480, 400, 4
"""Size of a picture, and what is between two [pixels]."""

RULE = (108, 116, 126)

_WORDS: dict[Status, tuple[str, str]] = {
    Status.NOMINAL: ("as asked", GREEN),
    Status.PROJECTED: ("corrected", ORANGE),
    Status.RELAXED: ("least violation", PINK),
    Status.FAILSAFE: ("verified stop", BLUE),
    Status.FAULT: ("fault: brakes", RED),
}
"""What a status is called in a film, and its colour."""


def require_film() -> None:
    """Find out before long work whether films can be made.

    Raises:
        MissingExtraError: matplotlib or PyAV is not installed.
        DisplayError: There is no OpenGL.
    """
    plots.require(film=True)
    try:
        check_opengl()
    except DisplayError as error:
        raise DisplayError(f"{error}; or give --no-video") from error


def rows(traces: Sequence[Trace], every: int = EVERY) -> list[int]:
    """Which rows of the recordings a film shows, one after the other.

    One in ``every``, and the beginning of a contact for a moment longer, in whichever recording it is.
    """
    count = len(traces[0].time)
    held: dict[int, int] = {}
    for trace in traces:
        last = -np.inf
        for k in np.flatnonzero(np.diff(trace.contact.astype(int), prepend=0) == 1).tolist():
            if trace.time[k] - last >= _APART:
                held[k] = HOLD // every
            last = trace.time[k]
    shown = sorted({*range(0, count, every), *held})
    return [k for k in shown for _ in range(1 + held.get(k, 0))]


def pictures(traces: Sequence[Trace]) -> int:
    """How many pictures a film of them has."""
    return len(rows(traces))


def caption(trace: Trace, k: int) -> plots.Caption:
    """What a film says of a row of a recording."""
    shielded = bool(np.any(np.isfinite(trace.correction)))
    status, colour = _WORDS[Status(int(trace.status[k]))] if shielded else ("policy alone", GREY)
    near, reason = float(trace.distance[k]), str(trace.reason[k])
    numbers = f"{trace.time[k]:5.2f} s    " + (f"distance {near:.3f} m" if np.isfinite(near) else "nobody there")
    if trace.contact[k]:
        status, colour = "contact", CONTACT
        numbers = f"{trace.time[k]:5.2f} s    {max(-near, 0.0):.3f} m deep, arm at {trace.contact_speed[k]:.2f} m/s"
    elif trace.success[k] and not trace.holds:
        reason = "goal reached" + (f"; {reason}" if reason else "")
    return plots.Caption(trace.name, status, colour, numbers, reason)


def film(
    traces: Sequence[Trace],
    robot: RobotModel,
    *,
    pretty: bool = False,
    capsules: bool = False,
    elevation: float = ELEVATION,
    every: int = EVERY,
) -> Iterator[NDArray[np.uint8]]:
    """The runs side by side, from one camera that has arm, goal and people in the frame all the time.

    Above each its name and status, below it clock, distance and reason, a gauge of the distance, and the jerks of the
    last two seconds. The shortest line between arm and people is red; where they touch there is a mark, the picture has
    a red frame, and the film stands still for a moment.

    Args:
        traces: Episodes of the same length, robot and half-spaces.
        robot: The robot, where it stands.
        pretty: Shadows and smooth edges: ten times slower.
        capsules: Whether the capsules, which are what is measured, are drawn too.
        elevation: Of the camera, negative for one that looks down [degrees].
        every: Control steps between pictures.
    """
    first = traces[0]
    scene = next((name for name in first.plane_names if name in SCENES), "floor")
    world = World(robot, scene, pretty=pretty, width=WIDTH, height=HEIGHT)
    world.look_from(episode_camera(traces, robot, WIDTH / HEIGHT, elevation))
    try:
        for k, again in itertools.groupby(rows(traces, every)):
            picture = _beside([_column(world, trace, k, robot, capsules) for trace in traces])
            for _ in again:
                yield picture
    finally:
        world.close()


def rate_of(trace: Trace) -> int:
    """Pictures a second, so that a film takes as long as what it shows."""
    return round(1.0 / (trace.dt * EVERY))


def save_film(
    path: Path,
    traces: Sequence[Trace],
    robot: RobotModel,
    progress: Progress | None = None,
    *,
    pretty: bool = False,
    capsules: bool = False,
) -> None:
    """Write the film of :func:`film`, under a bar if there is one."""
    frames: Iterable[NDArray[np.uint8]] = film(traces, robot, pretty=pretty, capsules=capsules)
    if progress is not None:
        frames = progress.track(frames, total=pictures(traces), description="filming")
    plots.write_film(path, iter(frames), rate=rate_of(traces[0]))


def _beside(columns: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Columns of one height with a line between two."""
    line = np.full((len(columns[0]), DIVIDER, 3), RULE, np.uint8)
    return np.hstack([part for column in columns for part in (line, column)][1:])


def _column(world: World, trace: Trace, k: int, robot: RobotModel, capsules: bool) -> NDArray[np.uint8]:
    """One run at one moment, from top to bottom."""
    people, touches = people_of(trace, k), bool(trace.contact[k])
    arm = posed(robot, trace.position[k], people)
    line, goal = arm.line, goal_points(robot, trace.goal[k], trace.holds)
    picture = world.picture(trace.position[k], people, Marks(line, goal, arm.touching if touches else None, capsules))
    if touches:
        picture = _framed(picture)
    said = caption(trace, k)
    return np.vstack(
        [
            plots.heading(said, WIDTH),
            picture,
            plots.footer(said, WIDTH),
            plots.gauge(trace.distance[k], trace.d_min, bool(trace.intervened[k]), touches, WIDTH),
            plots.ribbon(trace.jerk[: k + 1] / robot.limits.jerk, WIDTH),
        ]
    )


def _framed(picture: NDArray[np.uint8], width: int = 6) -> NDArray[np.uint8]:
    """A picture with a red frame."""
    framed = np.full_like(picture, rgb(CONTACT))
    framed[width:-width, width:-width] = picture[width:-width, width:-width]
    return framed
