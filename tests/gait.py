"""BVH texts of somebody who walks, in any dialect, and where the joints are, worked out here."""

import numpy as np
from scipy.spatial.transform import Rotation

# parent and place in the rest pose, in metres, x to the left, y up, z forwards; a standing person's
BODY = {
    "hips": (None, (0.0, 0.95, 0.0)),
    "spine": ("hips", (0.0, 1.15, 0.0)),
    "neck": ("spine", (0.0, 1.48, 0.0)),
    "head": ("neck", (0.0, 1.56, 0.0)),
    "right collar": ("spine", (-0.04, 1.43, 0.0)),
    "right upper arm": ("right collar", (-0.19, 1.43, 0.0)),
    "right forearm": ("right upper arm", (-0.47, 1.43, 0.0)),
    "right hand": ("right forearm", (-0.72, 1.43, 0.0)),
    "left collar": ("spine", (0.04, 1.43, 0.0)),
    "left upper arm": ("left collar", (0.19, 1.43, 0.0)),
    "left forearm": ("left upper arm", (0.47, 1.43, 0.0)),
    "left hand": ("left forearm", (0.72, 1.43, 0.0)),
    "right thigh": ("hips", (-0.1, 0.92, 0.0)),
    "right shin": ("right thigh", (-0.1, 0.50, 0.0)),
    "right foot": ("right shin", (-0.1, 0.08, 0.0)),
    "left thigh": ("hips", (0.1, 0.92, 0.0)),
    "left shin": ("left thigh", (0.1, 0.50, 0.0)),
    "left foot": ("left shin", (0.1, 0.08, 0.0)),
}
SITES = {
    "head": (0.0, 0.2, 0.0),
    "right hand": (-0.18, 0.0, 0.0),
    "left hand": (0.18, 0.0, 0.0),
    "right foot": (0.0, -0.06, 0.2),
    "left foot": (0.0, -0.06, 0.2),
}
MIXAMO = {
    "hips": "Hips", "spine": "Spine", "neck": "Neck", "head": "Head",
    "collar": "Shoulder", "upper arm": "Arm", "forearm": "ForeArm", "hand": "Hand",
    "thigh": "UpLeg", "shin": "Leg", "foot": "Foot",
}  # fmt: skip
BIPED = {
    "hips": "Pelvis", "spine": "Spine", "neck": "Neck", "head": "Head",
    "collar": "Clavicle", "upper arm": "UpperArm", "forearm": "Forearm", "hand": "Hand",
    "thigh": "Thigh", "shin": "Calf", "foot": "Foot",
}  # fmt: skip
POSER = {
    "hips": "hip", "spine": "abdomen", "neck": "neck", "head": "head",
    "collar": "Collar", "upper arm": "Shldr", "forearm": "ForeArm", "hand": "Hand",
    "thigh": "Thigh", "shin": "Shin", "foot": "Foot",
}  # fmt: skip
BLENDER = {
    "hips": "hips", "spine": "spine", "neck": "neck", "head": "head",
    "collar": "shoulder", "upper arm": "upper_arm", "forearm": "forearm", "hand": "hand",
    "thigh": "thigh", "shin": "shin", "foot": "foot",
}  # fmt: skip

DIALECTS = {
    "mixamo": ("mixamorig:{}", "mixamorig:{side}{}", MIXAMO),
    "character": ("Character1_{}", "Character1_{side}{}", MIXAMO),
    "somebody": ("Anna_B_{}", "Anna_B_{side}{}", MIXAMO),
    "biped": ("Bip01 {}", "Bip01 {S} {}", BIPED),
    "suffix": ("{}", "{}_{S}", BIPED),
    "dot": ("{}", "{}.{S}", BLENDER),
    "small suffix": ("{}", "{}_{s}", BLENDER),
    "poser": ("{}", "{s}{}", POSER),
    "loud": ("{}", "{SIDE}{}", {key: word.upper() for key, word in MIXAMO.items()}),
}
"""Pattern of a joint in the middle, pattern of one at a side, words."""


def name_of(joint, dialect="mixamo"):
    """What a joint is called."""
    middle, aside, words = DIALECTS[dialect]
    side, _, word = joint.partition(" ")
    if side not in ("right", "left"):
        return middle.format(words[joint])
    return aside.format(words[word], side=side.title(), S=side[0].upper(), s=side[0], SIDE=side.upper())


BVH_JOINTS = {joint: name_of(joint) for joint in BODY}
"""What joints are called unless asked otherwise."""


def walk(frames=60, rate=30.0, stride=1.5, speed=1.2, swing=20.0, bend=38.0, elbow=40.0):
    """Angles (joint: (T, 3), about x, y, z in turn, in degrees) and the hips' places (T, 3) of somebody who walks."""
    time = np.arange(frames) / rate
    phase = 2.0 * np.pi * speed / stride * time
    angles = {joint: np.zeros((frames, 3)) for joint in BODY}
    for side, sign in (("right", 1.0), ("left", -1.0)):
        angles[f"{side} thigh"][:, 0] = -sign * swing * np.sin(phase)
        angles[f"{side} shin"][:, 0] = bend * np.clip(sign * np.cos(phase), 0.0, None) ** 2
        angles[f"{side} upper arm"][:, 2] = sign * 75.0  # hanging
        angles[f"{side} upper arm"][:, 1] = sign * 10.0 * np.sin(phase)
        angles[f"{side} forearm"][:, 1] = sign * elbow
    hips = np.array(BODY["hips"][1]) + np.stack([0 * time, 0.02 * np.cos(2 * phase), speed * time], axis=1)
    return angles, hips


def joints_of(angles, hips):
    """Where joints and end sites are, by scipy, y up: joint or joint + " end": (T, 3) [m]."""
    places, turns = {}, {}
    for joint, (parent, place) in BODY.items():
        own = Rotation.from_euler("XYZ", angles[joint], degrees=True)
        if parent is None:
            places[joint], turns[joint] = hips, own
        else:
            offset = np.subtract(place, BODY[parent][1])
            places[joint] = places[parent] + turns[parent].apply(offset)
            turns[joint] = turns[parent] * own
        if joint in SITES:
            places[f"{joint} end"] = places[joint] + turns[joint].apply(SITES[joint])
    return places


def bvh_text(angles, hips, *, unit=0.01, up="y", dialect="mixamo", rate=30.0, placed="root", site="End Site"):
    """A BVH text.

    Args:
        angles, hips: As of :func:`walk`.
        unit: Metres in a unit of the file.
        up: The file's upward axis; for z the skeleton is built that way.
        dialect: A key of :data:`DIALECTS`.
        rate: Frames a second.
        placed: ``"root"``: the root has position channels; ``"all"``: joints too, and repeat their offsets;
            ``"zeros"``: joints have some and they are 0.
        site: What an end site is called.
    """
    # of vectors: y up to z up; rotations keep their axes' meaning, so that the axes are renamed
    turn = (lambda v: np.asarray(v)[..., [0, 2, 1]] * [1.0, -1.0, 1.0]) if up == "z" else np.asarray
    axes = {"y": ("X", "Y", "Z"), "z": ("X", "Z", "Y")}[up]
    signs = {"y": (1.0, 1.0, 1.0), "z": (1.0, 1.0, -1.0)}[up]
    lines, columns = ["HIERARCHY"], []

    def write(joint, parent):
        place = np.array(BODY[joint][1])
        offset = turn(place - (np.array(BODY[parent][1]) if parent else 0.0)) / unit
        lines.extend([f"{'JOINT' if parent else 'ROOT'} {name_of(joint, dialect)}", "{"])
        lines.append("OFFSET " + " ".join(repr(float(x)) for x in offset))
        turns = " ".join(f"{axis}rotation" for axis in axes)
        if parent is None or placed != "root":
            lines.append(f"CHANNELS 6 Xposition Yposition Zposition {turns}")
            moved = (
                turn(hips) / unit
                if parent is None
                else np.tile(offset if placed == "all" else 0.0 * offset, (len(hips), 1))
            )
            columns.append(moved)
        else:
            lines.append(f"CHANNELS 3 {turns}")
        columns.append(angles[joint] * signs)
        for child, (above, _) in BODY.items():
            if above == joint:
                write(child, joint)
        if joint in SITES:
            tip = turn(np.array(SITES[joint])) / unit
            lines.extend([site, "{", "OFFSET " + " ".join(repr(float(x)) for x in tip), "}"])
        lines.append("}")

    write("hips", None)
    rows = np.concatenate(columns, axis=1)
    lines.extend(["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1.0 / rate!r}"])
    lines.extend(" ".join(repr(float(x)) for x in row) for row in rows)
    return "\n".join(lines) + "\n"
