"""What feet with a speed bound of their own change: a cell of the leaderboard beside somebody who really walks.

    python benchmarks/feet.py --episodes 10

A gait is written as motion capture, 1.2 m/s with feet that swing at 3.7 m/s past the arm, and read as the package reads
everybody's; then it is played beside ``jpc`` behind ``JSSAShield``, under four assumptions about how fast it may be.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import jssa_gym
from jssa_gym.envs.arm import MOVING
from jssa_gym.evaluation.identity import made_with
from jssa_gym.humans import Recorded, Recording, bvh
from jssa_gym.safety.failsafe import LEG_SPEEDS, FailsafeParams

RATE, SECONDS, SPEED, STRIDE = 120, 8.0, 1.2, 1.5
"""Frames a second, length, walking speed [m/s], way of two steps [m]."""

LIMBS = {
    "{}Arm": ("{}Shoulder", (15, 0, 0)), "{}ForeArm": ("{}Arm", (28, 0, 0)), "{}Hand": ("{}ForeArm", (25, 0, 0)),
    "{}Leg": ("{}UpLeg", (0, -42, 0)), "{}Foot": ("{}Leg", (0, -42, 0)),
}  # fmt: skip
BONES = {
    "Spine": ("Hips", (0, 20, 0)), "Neck": ("Spine", (0, 33, 0)), "Head": ("Neck", (0, 8, 0)),
    **{f"{side}Shoulder": ("Spine", (sign * 4, 28, 0)) for side, sign in (("Right", -1), ("Left", 1))},
    **{f"{side}UpLeg": ("Hips", (sign * 10, -3, 0)) for side, sign in (("Right", -1), ("Left", 1))},
    **{
        bone.format(side): (parent.format(side), (sign * x, y, z))
        for side, sign in (("Right", -1), ("Left", 1)) for bone, (parent, (x, y, z)) in LIMBS.items()
    },
}  # fmt: skip
"""Joints by the one before, and how far they are from it [cm]: x to the left, y up, z forwards."""

FOOT = (0, -6, 20)
SITES = {"Head": (0, 20, 0), "RightHand": (-18, 0, 0), "LeftHand": (18, 0, 0), "RightFoot": FOOT, "LeftFoot": FOOT}


class Case(NamedTuple):
    """What the person is made of, and how fast the shield takes it to be."""

    says: str
    body: str
    params: FailsafeParams


CASES = (
    Case("legs of one capsule, as the default assumes", "six", FailsafeParams()),
    Case("everybody's bound raised, `human_speed=3.9`", "six", FailsafeParams(human_speed=3.9)),
    Case("legs of one capsule, `end_speeds=LEG_SPEEDS`", "six", FailsafeParams(end_speeds=LEG_SPEEDS)),
    Case("14 capsules, the default with its `foot_speed=4.8`", "jointed", FailsafeParams()),
)


def gait(path: Path) -> Path:
    """Somebody who walks, as a .bvh file."""
    frames = int(RATE * SECONDS)
    time = np.arange(frames) / RATE
    phase = 2.0 * np.pi * SPEED / STRIDE * time
    turned: dict[str, tuple[str, np.ndarray]] = {}
    for side, sign in (("Right", 1.0), ("Left", -1.0)):
        turned[f"{side}UpLeg"] = "X", -20.0 * sign * np.sin(phase)
        turned[f"{side}Leg"] = "X", 38.0 * np.clip(sign * np.cos(phase), 0.0, None) ** 2
        turned[f"{side}Arm"] = "Z", np.full(frames, 75.0 * sign)  # hanging
    lines, columns = ["HIERARCHY"], [0.0 * time, 95.0 + 2.0 * np.cos(2.0 * phase), 100.0 * SPEED * time]

    def write(joint: str, offset: tuple[float, ...], kind: str) -> None:
        places = "6 Xposition Yposition Zposition" if kind == "ROOT" else "3"
        lines.extend([f"{kind} {joint}", "{", "OFFSET {} {} {}".format(*offset)])
        lines.append(f"CHANNELS {places} Xrotation Yrotation Zrotation")
        axis, angle = turned.get(joint, ("X", 0.0 * time))
        columns.extend(angle if axis == one else 0.0 * time for one in "XYZ")
        for child, (parent, place) in BONES.items():
            if parent == joint:
                write(child, place, "JOINT")
        if joint in SITES:
            lines.extend(["End Site", "{", "OFFSET {} {} {}".format(*SITES[joint]), "}"])
        lines.append("}")

    write("Hips", (0, 0, 0), "ROOT")
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {1.0 / RATE!r}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in np.array(columns).T]
    path.write_text("\n".join(lines) + "\n")
    return path


def passing(recording: Recording, aside: float) -> Recorded:
    """The same person on a straight way past the arm, half of it before and half behind."""
    # as converted it walks along -x; it is turned to walk along y, and stands still nowhere
    way = SPEED * SECONDS / 2.0
    start, end = recording.start - [recording.root[0, 0], 0.0, 0.0], recording.end - [recording.root[0, 0], 0.0, 0.0]
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # -x to -y
    shift = np.array([aside, way, 0.0])
    moved = Recording(recording.time, start @ turn + shift, end @ turn + shift, recording.radius, recording.names)
    return Recorded(moved, turn=(-0.4, 0.4), offset=((0.0, 0.3), (-0.5, 0.5)))


def play(task: str, human: Recorded, params: FailsafeParams, episodes: int) -> tuple[float, ...]:
    """Shares of episodes: success without contact, contact, moving contact; of ticks: FAULT, NOMINAL."""
    env: Any = jssa_gym.JSSAShield(
        gym.make(f"jssa_gym/{task}-v0", human=human, terminate_on=()), failsafe=params
    )  # fmt: skip
    policy = jssa_gym.POLICIES["jpc"](env, 0)
    found = []
    for seed in range(9000, 9000 + episodes):
        observation, _ = env.reset(seed=seed)
        touched = moving = fault = nominal = 0
        for _ in range(int(SECONDS * 125)):
            observation, _, _, _, info = env.step(policy(observation))
            touched += info["contact"]
            moving += info["contact"] and info["contact_speed"] > MOVING
            fault += info["shield/status"] == jssa_gym.Status.FAULT
            nominal += info["shield/status"] == jssa_gym.Status.NOMINAL
        ticks = SECONDS * 125
        found.append((info["success"] and not touched, touched > 0, moving > 0, fault / ticks, nominal / ticks))
    return tuple(np.mean(np.array(found, float), axis=0).tolist())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--aside", type=float, default=0.9, help="of the way past the base axis, at least [m]")
    options = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        file = gait(Path(folder) / "walk.bvh")
        bodies = {body: bvh.convert(file, body=body) for body in ("six", "jointed")}
    print(
        "| assumed | task | success without contact | any contact | moving contact | ticks in FAULT "
        "| ticks as planned |\n"
        "|---|---|---|---|---|---|---|"
    )
    for case in CASES:
        human = passing(bodies[case.body], options.aside)
        for task in ("Home", "Reach"):
            success, contact, moving, fault, nominal = play(task, human, case.params, options.episodes)
            counts = " | ".join(
                f"{round(share * options.episodes)} / {options.episodes}" for share in (success, contact, moving)
            )
            print(f"| {case.says} | {task} | {counts} | {100.0 * fault:.0f} % | {100.0 * nominal:.0f} % |", flush=True)


if __name__ == "__main__":
    main()
