"""Kinematics of serial arms against MuJoCo, against power series and against differentiated positions."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import reference as ref
from numpy.polynomial import chebyshev

from jssa_gym.kernels.chain import (
    acceleration_of,
    drift_of,
    forward,
    jacobian,
    jacobian_rate,
    place,
    place_axes,
    place_present,
    point_on,
    pose,
    velocity_of,
)
from jssa_gym.kernels.records import FRAME, SEGMENT
from jssa_gym.robots import RobotModel, lr_mate_200id_7l
from jssa_gym.robots.lr_mate_200id_7l import MJCF
from jssa_gym.safety.failsafe import levers
from jssa_gym.tick import layout

# Joints of each body, base to tip; 0 is a body without a joint.
LAYOUTS = {"three joints": (0, 2, 0, 0, 1, 0), "seven joints": (1, 0, 2, 1, 0, 1, 2, 0)}


@pytest.fixture(params=[1, pytest.param(50, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


def numbers(values):
    return " ".join(f"{value:.17g}" for value in values)


def arm_xml(rng, layout):
    """A serial arm with all that MJCF allows: random frames, anchors, reference angles and axes."""
    opened, joint = [], 0
    for body, joints in enumerate(layout):
        lines = [
            f'<body name="body{body}" pos="{numbers(0.3 * rng.normal(size=3))}" quat="{numbers(rng.normal(size=4))}">',
            '<geom type="sphere" size=".02" group="2"/>',
        ]
        for _ in range(joints):
            joint += 1
            lines.append(
                f'<joint name="q{joint}" type="hinge" pos="{numbers(0.2 * rng.normal(size=3))}" '
                f'axis="{numbers(rng.normal(size=3))}" ref="{rng.uniform(-1.0, 1.0):.17g}" range="-3 3"/>'
            )
        if joint:
            lines.append(
                f'<geom name="capsule{body}" type="capsule" group="3" size="{rng.uniform(0.02, 0.1):.17g}" '
                f'fromto="{numbers(0.2 * rng.normal(size=6))}"/>'
            )
            lines.append(
                f'<geom name="tilted{body}" type="capsule" group="3" '
                f'size=".03 {rng.uniform(0.05, 0.3):.17g}" '
                f'pos="{numbers(0.2 * rng.normal(size=3))}" quat="{numbers(rng.normal(size=4))}"/>'
            )
            lines.append(
                f'<geom name="ball{body}" type="sphere" group="3" size="{rng.uniform(0.02, 0.1):.17g}" '
                f'pos="{numbers(0.2 * rng.normal(size=3))}"/>'
            )
        opened.append("".join(lines))
    site = f'<site name="tcp" pos="{numbers(0.2 * rng.normal(size=3))}"/>'
    return (
        '<mujoco model="random"><compiler angle="radian" autolimits="true"/>'
        '<option><flag contact="disable"/></option><worldbody>'
        + "".join(opened)
        + site
        + "</body>" * len(opened)
        + "</worldbody></mujoco>"
    )


class Arm:
    """One arm twice: as the package reads it, and as MuJoCo does."""

    def __init__(self, path, robot=None):
        self.sim = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.sim)
        n = self.sim.nq
        # what these arms draw is nobody's business: they are about where things are
        joints = [self.sim.joint(j).name for j in range(self.sim.njnt)]
        limits = {name: np.ones(n) for name in ("velocity", "acceleration", "jerk")}
        self.robot = robot or RobotModel.from_mjcf(path, **limits, uncovered=joints)
        self.geoms = [self.sim.geom(name).id for name in self.robot.capsule_names]

    @property
    def chain(self):
        return [ref.Joint(link["rotation"], link["offset"], link["axis"]) for link in self.robot.links]

    def random_state(self, rng):
        return rng.normal(size=(3, self.robot.n)) * np.array([[1.5], [2.0], [5.0]])

    def forward(self, state):
        frames = np.zeros(self.robot.n, FRAME)
        forward(self.robot.links, state, frames)
        segments = np.zeros(len(self.robot.capsules), SEGMENT)
        place(frames, self.robot.capsules, segments)
        return frames, segments

    def simulate(self, state):
        self.data.qpos[:], self.data.qvel[:] = state[0], state[1]
        mujoco.mj_forward(self.sim, self.data)

    def geom_ends(self, geom):
        """Ends of a capsule from MuJoCo's own pose, the end on +z first."""
        half = self.sim.geom_size[geom, 1] if self.sim.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        z = half * self.data.geom_xmat[geom].reshape(3, 3)[:, 2]
        return self.data.geom_xpos[geom] + z, self.data.geom_xpos[geom] - z

    def jacobians(self, body, point):
        """MuJoCo's J and J' of a world point that moves with a body."""
        J, J_dot = np.zeros((3, self.sim.nv)), np.zeros((3, self.sim.nv))
        mujoco.mj_jac(self.sim, self.data, J, None, point, body)
        mujoco.mj_jacDot(self.sim, self.data, J_dot, None, point, body)
        return J, J_dot


@pytest.fixture(scope="module", params=["shipped", "three joints", "seven joints", "seven joints, again"])
def arm(request, tmp_path_factory):
    if request.param == "shipped":
        return Arm(MJCF, lr_mate_200id_7l())
    seed = [*LAYOUTS, "seven joints, again"].index(request.param)
    path = Path(tmp_path_factory.mktemp("arm")) / "arm.xml"
    path.write_text(arm_xml(np.random.default_rng(seed), LAYOUTS[request.param.removesuffix(", again")]))
    return Arm(path)


@pytest.mark.sampled(2)
def test_capsules_stand_where_mujoco_puts_them(arm, times):
    """Forward kinematics of whatever arm a user brings: a capsule in the wrong place protects nothing."""
    rng = np.random.default_rng(1)
    for _ in range(20 * times):
        state = arm.random_state(rng)
        _, segments = arm.forward(state)
        arm.simulate(state)
        assert len(segments) == len(arm.geoms) > 0
        for segment, geom in zip(segments, arm.geoms, strict=True):
            start, end = arm.geom_ends(geom)
            np.testing.assert_allclose(segment["start"], start, rtol=0, atol=1e-12)
            np.testing.assert_allclose(segment["end"], end, rtol=0, atol=1e-12)
            assert segment["radius"] == arm.sim.geom_size[geom, 0]


def test_tool_point_is_the_site(arm):
    """Tasks and handovers steer the tool point; it moves with the right link."""
    rng = np.random.default_rng(2)
    robot = arm.robot
    for _ in range(10):
        state = arm.random_state(rng)
        frames, _ = arm.forward(state)
        arm.simulate(state)
        frame = frames[robot.tool_link]
        tool = frame["origin"] + frame["rotation"] @ robot.tool_offset
        np.testing.assert_allclose(tool, arm.data.site("tcp").xpos, rtol=0, atol=1e-12)
        J, J_mujoco = np.zeros((3, robot.n)), np.zeros((3, robot.n))
        jacobian(frames, robot.tool_link, tool, J)
        mujoco.mj_jacSite(arm.sim, arm.data, J_mujoco, None, arm.sim.site("tcp").id)
        np.testing.assert_allclose(J, J_mujoco, rtol=0, atol=1e-12)


def test_jacobian_and_its_rate_are_mujoco_s(arm, times):
    """J and J' of points on every link: the rows of the safety index are made of them."""
    rng = np.random.default_rng(3)
    robot = arm.robot
    J, J_dot = np.full((3, robot.n), np.nan), np.full((3, robot.n), np.nan)
    for _ in range(10 * times):
        state = arm.random_state(rng)
        frames, segments = arm.forward(state)
        arm.simulate(state)
        for capsule, segment, geom in zip(robot.capsules, segments, arm.geoms, strict=True):
            link = int(capsule["link"])
            point, velocity, _ = map(np.array, point_on(segment, rng.uniform()))
            J_mujoco, J_dot_mujoco = arm.jacobians(arm.sim.geom_bodyid[geom], point)
            jacobian(frames, link, point, J)
            np.testing.assert_allclose(J, J_mujoco, rtol=0, atol=1e-12)
            jacobian_rate(frames, link, point, J_dot)
            np.testing.assert_allclose(J_dot, J_dot_mujoco, rtol=0, atol=1e-11)
            np.testing.assert_allclose(velocity, J_mujoco @ state[1], rtol=0, atol=1e-11)


def test_accelerations_are_mujoco_s(arm):
    """J qdd + J' qd with MuJoCo's matrices: no centripetal or Coriolis term is missing."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        state = arm.random_state(rng)
        _, segments = arm.forward(state)
        arm.simulate(state)
        for segment, geom in zip(segments, arm.geoms, strict=True):
            for end in ("start", "end"):
                J, J_dot = arm.jacobians(arm.sim.geom_bodyid[geom], segment[end].copy())
                expected = J @ state[2] + J_dot @ state[1]
                np.testing.assert_allclose(segment[f"{end}_acceleration"], expected, rtol=0, atol=1e-10)


@pytest.mark.sampled(2)
def test_motion_is_the_power_series_motion(arm, times):
    """Velocity, acceleration and drift of link points equal those of the truncated power series (Eq. 10)."""
    rng = np.random.default_rng(5)
    chain, n = arm.chain, arm.robot.n
    for _ in range(3 * times):
        state = arm.random_state(rng)
        frames, segments = arm.forward(state)
        for link in range(n):
            local = 0.3 * rng.normal(size=3)
            r = frames[link]["rotation"] @ local
            p, v, a, drift = ref.point_motion(chain, *state, np.zeros(n), link + 1, local)
            np.testing.assert_allclose(frames[link]["origin"] + r, p, rtol=0, atol=1e-12)
            np.testing.assert_allclose(velocity_of(frames[link], r), v, rtol=0, atol=1e-11)
            np.testing.assert_allclose(acceleration_of(frames[link], r), a, rtol=0, atol=1e-10)
            np.testing.assert_allclose(drift_of(frames[link], r), drift, rtol=1e-12, atol=1e-9)
        for capsule, segment in zip(arm.robot.capsules, segments, strict=True):
            for end in ("start", "end"):
                motion = ref.point_motion(chain, *state, np.zeros(n), int(capsule["link"]) + 1, capsule[end])
                for order, quantity in enumerate((end, f"{end}_velocity", f"{end}_acceleration")):
                    np.testing.assert_allclose(segment[quantity], motion[order], rtol=0, atol=1e-10)


def test_derivatives_are_those_of_mujoco_s_positions(arm):
    """Nothing but positions goes in: MuJoCo's track of a capsule end, interpolated and differentiated.

    The joints move as q + qd t + qdd t^2/2, so that the third derivative at t = 0 is the drift.
    """
    rng = np.random.default_rng(6)
    reach, count = 0.04, 16
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    for _ in range(3):
        state = arm.random_state(rng)
        frames, segments = arm.forward(state)
        track = []
        for t in reach * nodes:
            arm.data.qpos[:] = state[0] + state[1] * t + state[2] * t**2 / 2.0
            mujoco.mj_kinematics(arm.sim, arm.data)
            track.append(np.concatenate([arm.geom_ends(geom)[0] for geom in arm.geoms]))
        series = chebyshev.chebfit(nodes, np.array(track), count - 1)
        _, velocity, acceleration, drift = (
            (chebyshev.chebval(0.0, chebyshev.chebder(series, order)) / reach**order).reshape(-1, 3)
            for order in range(4)
        )
        np.testing.assert_allclose(segments["start_velocity"], velocity, rtol=0, atol=1e-9)
        np.testing.assert_allclose(segments["start_acceleration"], acceleration, rtol=1e-8, atol=1e-6)
        for capsule, segment, expected in zip(arm.robot.capsules, segments, drift, strict=True):
            frame = frames[capsule["link"]]
            found = drift_of(frame, segment["start"] - frame["origin"])
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-3)


def test_a_mount_moves_the_whole_arm_and_nothing_else(arm):
    """On a table the arm stands higher: every point is shifted, no rate changes, mounts do not add up."""
    rng = np.random.default_rng(7)
    state, shift = arm.random_state(rng), np.array([0.3, -0.2, 0.87])
    frames, segments = arm.forward(state)
    tool = arm.robot.tool_offset.copy()
    for robot in (arm.robot.mounted(shift), arm.robot.mounted([5.0, 5.0, 5.0]).mounted(shift)):
        np.testing.assert_array_equal(robot.mount, shift)
        moved, places = np.zeros(robot.n, FRAME), np.zeros(len(robot.capsules), SEGMENT)
        forward(robot.links, state, moved)
        place(moved, robot.capsules, places)
        np.testing.assert_allclose(moved["origin"], frames["origin"] + shift, rtol=0, atol=1e-12)
        for end in ("start", "end"):
            np.testing.assert_allclose(places[end], segments[end] + shift, rtol=0, atol=1e-12)
            for rate in ("velocity", "acceleration"):
                np.testing.assert_array_equal(places[f"{end}_{rate}"], segments[f"{end}_{rate}"])
        for name in ("rotation", "axis", "omega", "alpha", "psi", "velocity", "acceleration", "drift"):
            np.testing.assert_array_equal(moved[name], frames[name])
        np.testing.assert_array_equal(robot.tool_offset, tool)
    np.testing.assert_array_equal(arm.forward(state)[0]["origin"], frames["origin"])


def test_where_the_arm_is_at_present_is_known_for_one_posture_alone():
    """Asked again for the same it is what it was; for another, or for what is no number, it is computed anew."""
    robot, rng = lr_mate_200id_7l(), np.random.default_rng(9)
    arm, position = (
        layout.ArmRecord(robot.links, robot.capsules, robot.self_pairs, levers(robot), robot.limits.bounds()),
        robot.home.copy(),
    )
    work = layout.work(arm, 0, 0, 0, static_rows=False)
    for joint in (0, 0, 5, 2, 2, 1):
        position[joint] += rng.normal()
        for _ in range(2):
            place_present(arm, position, work)
            frames, segments = np.zeros(robot.n, FRAME), np.zeros(len(robot.capsules), SEGMENT)
            pose(robot.links, position, frames)
            place_axes(frames, robot.capsules, segments)
            for name in ("rotation", "origin", "axis"):
                np.testing.assert_array_equal(work.frames_present[name], frames[name])
            for name in ("start", "end"):
                np.testing.assert_array_equal(work.segments_present[name], segments[name])
    position[3] = np.nan
    place_present(arm, position, work)
    assert np.isnan(work.segments_present["end"][-1]).any()


def test_point_on_a_segment_is_between_its_ends():
    """The closest point inherits position, velocity and acceleration of the axis point at its fraction."""
    rng = np.random.default_rng(8)
    segments = np.zeros(1, SEGMENT)
    for name in SEGMENT.names[:6]:
        segments[name] = rng.normal(size=3)
    for s in (0.0, 0.25, 1.0):
        for got, name in zip(point_on(segments[0], s), ("", "_velocity", "_acceleration"), strict=True):
            expected = (1.0 - s) * segments[0][f"start{name}"] + s * segments[0][f"end{name}"]
            np.testing.assert_allclose(got, expected, rtol=0, atol=1e-15)


def test_a_nan_joint_makes_every_link_behind_it_nan():
    """A joint state that is no number must reach the distances as NaN, in whichever joint it is."""
    arm = Arm(MJCF, lr_mate_200id_7l())
    for row, name in enumerate(("start", "start_velocity", "start_acceleration")):
        for joint in range(6):
            state = np.zeros((3, 6))
            state[:, :] = 0.3
            state[row, joint] = np.nan
            _, segments = arm.forward(state)
            for segment in segments:
                if segment["link"] >= joint:
                    assert np.isnan(segment[name]).any()
                else:
                    assert np.isfinite(segment[name]).all()
