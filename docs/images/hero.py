"""The film at the top of the README: ``python docs/images/hero.py`` (minutes; needs the extra ``plots``).

An arm that goes to and fro between two postures, and a person who is dragged into its way with a mouse: without a
shield, with the paper's, and with ours. The drag is the same for all three, and nothing is left to chance.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from jssa_gym import HoldPolicy, JSSAShield
from jssa_gym.cli.film import EVERY, film
from jssa_gym.evaluation import rollout
from jssa_gym.humans import Body, Recorded, Recording

# seconds, x and y on the floor [m]: a jab from in front, away, along the arm's side, a jab there, across, and away
DRAG = (
    *((0.0, 1.75, 0.45), (0.7, 1.70, 0.45), (2.3, 0.80, 0.04), (3.5, 0.74, -0.02), (4.8, 1.25, -0.10)),
    *((6.2, 0.92, -0.74), (7.2, 0.62, -0.80), (8.2, 0.60, -0.76), (9.4, 1.00, -0.55), (10.6, 1.02, 0.15)),
    *((11.4, 0.78, 0.34), (12.6, 0.66, 0.40), (13.4, 0.80, 0.20), (14.2, 0.90, -0.25), (15.2, 1.35, -0.10)),
    *((16.6, 1.75, 0.40), (18.4, 1.75, 0.45)),
)

SPEED, ACCELERATION = 1.0, 4.0
"""What the person keeps to, however the mouse jumps [m/s, m/s²]."""

DT = 0.008

LANCZOS = Image.Resampling.LANCZOS

SECONDS = 18.4

PERIOD = 2.4
"""Time at each of the two postures, the way there included [s]."""


def path(seconds: float = SECONDS) -> NDArray[np.float64]:
    """Where the person is in every step, shape (T, 2) [m]: pulled towards the mouse, with bounded speed."""
    time, x, y = np.array(DRAG).T
    clock = np.arange(0.0, seconds + DT / 2.0, DT)
    mouse = np.stack([np.interp(clock, time, x), np.interp(clock, time, y)], axis=1)
    place, velocity, places = mouse[0].copy(), np.zeros(2), []
    for target in mouse:
        wanted = 6.0 * (target - place)
        wanted *= min(1.0, SPEED / max(float(np.hypot(*wanted)), 1e-9))
        change = wanted - velocity
        change *= min(1.0, ACCELERATION * DT / max(float(np.hypot(*change)), 1e-9))
        velocity = velocity + change
        place = place + velocity * DT
        places.append(place)
    return np.array(places)


def person(seconds: float = SECONDS) -> Recorded:
    """Somebody who takes that way and looks at the arm all the time."""
    places = path(seconds)
    sets = []
    for place in places:
        heading = float(np.arctan2(-place[1], -place[0]))
        sets.append(Body.facing(heading).at((float(place[0]), float(place[1])), (0.0, 0.0)))
    start, end = np.array([one.start for one in sets]), np.array([one.end for one in sets])
    recording = Recording(DT * np.arange(len(places)), start, end, sets[0].radius, sets[0].names)
    return Recorded(recording, turn=(0.0, 0.0), offset=((0.0, 0.0), (0.0, 0.0)))


class ToAndFro:
    """Goes from one posture to the other when it is time, whatever came between."""

    def __init__(self, env: gym.Env, postures: NDArray[np.float64]) -> None:
        self._env = env
        self._holds = [HoldPolicy(env, posture) for posture in postures]

    def __call__(self, observation: Any) -> NDArray[np.float64]:
        turn = int(self._env.get_wrapper_attr("scene").time / PERIOD)
        return self._holds[turn % len(self._holds)](observation)


def main() -> None:
    traces = []
    for name, wrap in (
        ("no shield", lambda env: env),
        ("as published", JSSAShield.as_published),
        ("ours: JSSAShield, profile yield", lambda env: JSSAShield(env, profile="yield")),
    ):
        bare = gym.make("jssa_gym/Track-v0", human=person(), terminate_on=(), max_episode_steps=round(SECONDS / DT))
        base: Any = bare.unwrapped
        postures = base.robot.home + np.array([[side, 0.35, -0.1, 0.0, -0.2, 0.0] for side in (0.9, -0.9)])
        env = wrap(bare)
        options = {"goal": postures}
        traces.append(
            rollout(env, ToAndFro(env, postures), seed=0, options=options, steps=round(SECONDS / DT), name=name)
        )
        print(f"{name}: {traces[-1].distance.min():.3f} m, fastest contact {traces[-1].contact_speed.max():.2f} m/s")
    frames = film(traces, base.robot, pretty=True, elevation=-22.0, every=2 * EVERY)
    write_webp(Path(__file__).with_name("hero.webp"), map(Image.fromarray, frames), width=880)


def write_webp(file: Path, frames: Iterable[Image.Image], width: int) -> None:
    """Pictures of a film, every tenth control step."""
    first, *more = (frame.resize((width, round(width * frame.height / frame.width)), LANCZOS) for frame in frames)
    duration = round(2000 * EVERY * DT)
    first.save(file, save_all=True, append_images=more, duration=duration, loop=0, quality=34, method=6)
    print(f"{file.name}: {1 + len(more)} pictures, {file.stat().st_size / 2**20:.2f} MiB")


if __name__ == "__main__":
    main()
