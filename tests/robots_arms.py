"""Small arms' files with what real ones have: grippers, jaws, branches, meshes, units. Written for these tests."""

import numpy as np

from jssa_gym.robots.reading import stl

HEAD = '<mujoco model="{}"><compiler angle="radian" autolimits="true"/>{}<worldbody>'
TUBE = '<geom name="{0} tube" type="cylinder" size=".03" fromto="0 0 0  {1}"/>'
DOWN, LENGTH = "0 0 1", 0.25


def link(name, axis, inside, pos="0 0 .25", joint='range="-2 2"', drawn=None):
    """A body on a hinge that draws a tube up to the next one."""
    tube = TUBE.format(name, "0 0 .25") if drawn is None else drawn
    return (
        f'<body name="{name}" pos="{pos}"><joint name="{name} joint" axis="{axis}" {joint}/>'
        f'<inertial mass="1" pos="0 0 .1" diaginertia=".01 .01 .01"/>{tube}{inside}</body>'
    )


FINGER = (
    '<body name="{0} finger" pos="0 {1} .25"><joint name="{0}" type="slide" axis="0 {2} 0" range="0 .04"/>'
    '<inertial mass=".1" pos="0 0 0" diaginertia=".001 .001 .001"/>'
    '<geom name="{0} pad" type="box" size=".01 .005 .03"/></body>'
)
FINGERS = FINGER.format("left", 0.02, 1) + FINGER.format("right", -0.02, -1)
REFERRING = """
<tendon><fixed name="split"><joint joint="left" coef=".5"/><joint joint="right" coef=".5"/></fixed></tendon>
<equality><joint name="mirrored" joint1="left" joint2="right"/></equality>
<actuator><position name="grip" tendon="split" kp="10"/><position name="squeeze" joint="left" kp="10"/></actuator>
<sensor><jointpos name="opening" joint="right"/></sensor>
<keyframe><key name="home" qpos=".1 .5 .9 .3 .01 .01"/></keyframe>
"""


def gripper(inside=FINGERS, after=REFERRING, base=""):
    """Four hinges, two fingers on slides, and all that real files tie to them."""
    four = link("hand", "0 0 1", inside)
    three = link("fore", "0 1 0", four)
    two = link("upper", "0 1 0", three)
    return HEAD.format("gripper", "") + base + link("turret", DOWN, two, "0 0 .1") + f"</worldbody>{after}</mujoco>"


def chain(count, last="", joint='range="-2 2"', scale=1.0, pos=None):
    """Hinges in turn about z and y, each with a tube."""
    inside = last
    for i in reversed(range(count)):
        place = pos if pos and not i else f"0 0 {0.25 * scale if i else 0.1 * scale}"
        drawn = f'<geom type="cylinder" size="{0.03 * scale}" fromto="0 0 0  0 0 {0.25 * scale}"/>'
        inside = link(f"link {i}", "0 1 0" if i % 2 else "0 0 1", inside, place, joint, drawn)
    return HEAD.format("chain", "") + inside + "</worldbody></mujoco>"


def two_arms(left=4, right=4):
    """A torso from which two chains branch."""

    def arm(side, count, y):
        inside = ""
        for i in reversed(range(count)):
            inside = link(f"{side} {i}", "0 1 0" if i % 2 else "0 0 1", inside, f"0 {y} .3" if not i else "0 0 .25")
        return inside

    torso = f'<body name="torso">{arm("left", left, 0.2)}{arm("right", right, -0.2)}</body>'
    return HEAD.format("two", "") + torso + "</worldbody></mujoco>"


def cube(half, centre=(0.0, 0.0, 0.0)):
    """Twelve triangles of a box, shape (12, 3, 3)."""
    corners = np.array([[(i >> k & 1) * 2 - 1 for k in range(3)] for i in range(8)]) * half + centre
    faces = [
        *([0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5]),
    ]
    return corners[np.array(faces)]


def urdf(folder, visual="package://bench_arm/meshes/beam.stl", collision=None, wrist="revolute", ascii_mesh=False):
    """Three links with meshes of a package, as folder/bench_arm/urdf/arm.urdf; the path."""
    package = folder / "bench_arm"
    (package / "meshes").mkdir(parents=True)
    (package / "urdf").mkdir()
    triangles = cube(np.array([0.03, 0.02, 0.12]), (0.0, 0.0, 0.12))
    (package / "meshes" / "beam.stl").write_bytes(stl(triangles))
    if ascii_mesh:
        rows = ["solid beam"]
        for a, b, c in triangles:
            rows += ["facet normal 0 0 0", "outer loop"]
            rows += ["vertex " + " ".join(map(str, corner)) for corner in (a, b, c)]
            rows += ["endloop", "endfacet"]
        (package / "meshes" / "beam.stl").write_text("\n".join([*rows, "endsolid"]))
    (package / "meshes" / "beam.dae").write_text("<COLLADA/>")

    def shape(kind, mesh):
        return f'<{kind}><geometry><mesh filename="{mesh}"/></geometry></{kind}>'

    def body(name, mass=True):
        weight = (
            '<inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'
        )
        drawn = shape("visual", visual) + ("" if collision is None else shape("collision", collision))
        return f'<link name="{name}">{weight if mass else ""}{drawn}</link>'

    def joint(name, parent, child, axis, kind="revolute", speed=1.5, z=0.24):
        limit = f'<limit lower="-2" upper="2" velocity="{speed}" effort="10"/>' if kind == "revolute" else ""
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0 0 {z}"/><axis xyz="{axis}"/>{limit}</joint>'
        )

    path = package / "urdf" / "arm.urdf"
    path.write_text(
        '<robot name="bench_arm"><link name="base"/>'
        + body("one")
        + body("two", mass=False)
        + body("three")
        + joint("turn", "base", "one", "0 0 1", speed=1.5, z=0.1)
        + joint("lift", "one", "two", "0 1 0", speed=2.5)
        + joint("roll", "two", "three", "0 0 1", kind=wrist, speed=3.5)
        + "</robot>"
    )
    return path
