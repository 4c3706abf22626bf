"""Verification of a stop: levers bound every motion, SAFE means safe between samples too, and safe is found SAFE."""

import dataclasses
import functools

import numpy as np
import pytest
import reference as ref
from numba import njit

from jssa_gym.kernels import verification as ver
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.records import AGENT, CONFINED, PLANE, STOP, records
from jssa_gym.kernels.rest import REST_SPEED
from jssa_gym.kernels.stopping import plan_stop, stop_jerk
from jssa_gym.robots import RobotModel
from jssa_gym.safety.failsafe import FailsafeParams, levers
from jssa_gym.shields import NoFilter
from jssa_gym.tick import layout
from jssa_gym.tick.admit import choose, room_behind, softest

DT = 0.008
TABLE = 0.87
SAMPLE = DT / 32
"""What the oracle looks at: every 0.25 ms."""


@pytest.fixture(params=[1, pytest.param(25, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


def chain_of(robot: RobotModel) -> list[ref.Joint]:
    return [
        ref.Joint(np.array(link["rotation"]), np.array(link["offset"]), np.array(link["axis"])) for link in robot.links
    ]


def limits_of(robot: RobotModel) -> np.ndarray:
    limits = robot.limits
    return np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])


# ---- an oracle: the whole motion, sampled -----------------------------------------------------------


def rollout(state, jerk, plan, ticks):
    """Joint positions and speeds every 0.25 ms from now until rest, shape (samples, n) each, and their times."""
    times, positions, speeds = [], [], []
    u = np.array(jerk, float)
    for tick in range(ticks + 1):
        t = np.arange(0.0, DT - SAMPLE / 2, SAMPLE)[:, None]
        q, v, a = state
        times.append(tick * DT + t[:, 0])
        positions.append(q + v * t + a * t**2 / 2.0 + u * t**3 / 6.0)
        speeds.append(v + a * t + u * t**2 / 2.0)
        state = np.array(ref.triple_integrator(q, v, a, u, DT))
        stop_jerk(plan, tick, u)
    return np.concatenate(times), np.concatenate(positions), np.concatenate(speeds), state


def turns(axis, angle):
    """Rodrigues' rotations about one axis by many angles, shape (t, 3, 3)."""
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)


def axes(chain, capsules, positions):
    """Ends of all capsule axes for many postures, shape (t, m, 2, 3); with homogeneous products, not the kernels."""
    t = len(positions)
    rotation, origin = np.broadcast_to(np.eye(3), (t, 3, 3)), np.zeros((t, 3))
    poses = []
    for joint, angle in zip(chain, positions.T, strict=True):
        origin = origin + rotation @ joint.offset
        rotation = rotation @ joint.rotation @ turns(joint.axis, angle)
        poses.append((rotation, origin))
    out = np.empty((t, len(capsules), 2, 3))
    for i, capsule in enumerate(capsules):
        rotation, origin = poses[capsule["link"]]
        for k, end in enumerate(("start", "end")):
            out[:, i, k] = origin + rotation @ capsule[end]
    return out


def test_the_oracles_arm_is_the_textbooks(robot):
    rng = np.random.default_rng(0)
    chain, positions = chain_of(robot), rng.uniform(-2.0, 2.0, (20, 6))
    found = axes(chain, robot.capsules, positions)
    for q, ends in zip(positions, found, strict=True):
        for capsule, (start, end) in zip(robot.capsules, ends, strict=True):
            link = int(capsule["link"]) + 1
            np.testing.assert_allclose(start, ref.point(chain, q, link, capsule["start"]), atol=1e-12)
            np.testing.assert_allclose(end, ref.point(chain, q, link, capsule["end"]), atol=1e-12)


def segment_gaps(a, b, c, d):
    """Axis distances of many segment pairs, (t,) each from (t, 3): ends against segments, and common normals."""

    def to_segment(p, start, end):
        along = end - start
        length2 = np.einsum("ij,ij->i", along, along)
        fraction = np.einsum("ij,ij->i", p - start, along) / np.where(length2 > 0.0, length2, 1.0)
        return np.linalg.norm(p - start - np.clip(fraction, 0.0, 1.0)[:, None] * along, axis=1)

    best = np.minimum.reduce([to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b)])
    e, f = b - a, d - c
    normal = np.cross(e, f)
    square = np.einsum("ij,ij->i", normal, normal)
    resolved = square > 1e-24
    safe = np.where(resolved, square, 1.0)
    s = np.einsum("ij,ij->i", np.cross(c - a, f), normal) / safe
    r = np.einsum("ij,ij->i", np.cross(c - a, e), normal) / safe
    inner = resolved & (s >= 0.0) & (s <= 1.0) & (r >= 0.0) & (r <= 1.0)
    across = np.abs(np.einsum("ij,ij->i", c - a, normal)) / np.sqrt(safe)
    return np.where(inner, np.minimum(best, across), best)


def test_the_oracles_distances_are_the_textbooks():
    rng = np.random.default_rng(1)
    ends = rng.normal(size=(4, 300, 3))
    ends[1, :50] = ends[0, :50]
    ends[3, 100:150] = ends[2, 100:150] + ends[1, 100:150] - ends[0, 100:150]
    expected = [ref.segment_distance(*four)[0] for four in ends.transpose(1, 0, 2)]
    np.testing.assert_allclose(segment_gaps(*ends), expected, atol=1e-12)


class Motion:
    """One step at a jerk and the stop after it, sampled once for all that is put around it."""

    def __init__(self, robot, state, jerk):
        self.robot, self.state, self.jerk = robot, np.array(state, float), np.array(jerk, float)
        self.after, self.plan = np.zeros((3, robot.n)), records(robot.n, STOP)
        integrate(self.state, self.jerk, DT, self.after)
        self.ticks = plan_stop(self.after, limits_of(robot), DT, self.plan)

    @functools.cached_property
    def samples(self):
        """Times, joint positions and joint speeds until rest."""
        *samples, final = rollout(self.state, self.jerk, self.plan, self.ticks)
        assert np.abs(final[1:]).max() < 1e-6
        return samples

    @property
    def times(self):
        return self.samples[0]

    @property
    def start(self):
        """Where the tool is now [m]."""
        return axes(chain_of(self.robot), self.robot.capsules[-1:], self.state[:1])[0, 0, 1]

    @functools.cached_property
    def ends(self):
        return axes(chain_of(self.robot), self.robot.capsules, self.samples[1])

    @functools.cached_property
    def speed(self):
        """Of each capsule's surface from every sample to the next, shape (t, m) [m/s]."""
        capsules = self.robot.capsules
        # twelve points on each, where a spin shows
        around = np.vstack([np.eye(3), -np.eye(3)])
        points = np.zeros(12 * len(capsules), capsules.dtype)
        for i, capsule in enumerate(capsules):
            for k, end in enumerate(("start", "end")):
                points["start"][12 * i + 6 * k :][:6] = capsule[end] + capsule["radius"] * around
            points["link"][12 * i :][:12] = capsule["link"]
        points["end"] = points["start"]
        moved = axes(chain_of(self.robot), points, self.samples[1])[:, :, 0].reshape(-1, len(capsules), 12, 3)
        speed = np.linalg.norm(np.diff(moved, axis=0), axis=3).max(axis=2) / SAMPLE
        return np.vstack([speed, np.zeros(len(capsules))])

    def gap(self, kind, i, other, *, reach=0.0, rate=0.0, touch=0.0, margin=0.0, every=1):
        """Smallest gap of one capsule to a person growing at a rate, a static capsule or a half-space [m]."""
        start, end, times = self.ends[::every, i, 0], self.ends[::every, i, 1], self.times[::every]
        radius = self.robot.capsules["radius"][i]
        if kind == "planes":
            lowest = np.minimum(start @ other["normal"], end @ other["normal"])
            return (lowest - other["offset"] - radius - margin).min()
        if kind == "people":
            # from when on it rests it may be touched
            moving = np.flatnonzero(self.speed[::every, i] > max(touch, REST_SPEED))
            if not len(moving):
                return np.inf
            start, end, times = (x[: moving[-1] + 1] for x in (start, end, times))
        fixed = np.broadcast_to(other["start"], start.shape), np.broadcast_to(other["end"], end.shape)
        gaps = segment_gaps(start, end, *fixed) - radius - other["radius"] - margin
        return (gaps - reach - rate * times).min()


class Case:
    """One question to the kernel: a motion and what is around it."""

    def __init__(self, motion, *, people=(), statics=(), planes=(), margin=0.0):
        self.motion, self.margin = motion, margin
        self.agents, self.statics = records(len(people), AGENT), records(len(statics), AGENT)
        self.planes = records(len(planes), PLANE)
        for out, given in ((self.agents, people), (self.statics, statics)):
            for agent, (start, end, radius, *_) in zip(out, given, strict=True):
                agent["start"], agent["end"], agent["radius"] = start, end, radius
        for plane, (normal, offset) in zip(self.planes, planes, strict=True):
            plane["normal"], plane["offset"] = normal, offset
        self.confined = records(len(people), CONFINED)
        self.reach, self.speed, self.touch = (np.array([person[k] for person in people], float) for k in (3, 4, 5))

    def verdict(self, *, own=False, swing=None):
        return ver.keeps_clear(*self.asked(own=own, swing=swing))

    def asked(self, *, own=False, swing=None):
        """What :func:`~jssa_gym.kernels.verification.keeps_clear` takes."""
        motion = self.motion
        robot = motion.robot
        arm = layout.ArmRecord(
            robot.links, robot.capsules, robot.self_pairs if own else robot.self_pairs[:0],
            levers(robot) if swing is None else swing, robot.limits.bounds(),
        )  # fmt: skip
        moved = ver.StepAndStop(motion.state, motion.jerk, motion.after, motion.plan, DT)
        count = len(self.agents), len(self.statics), len(self.planes)
        work = layout.work(arm, *count, static_rows=False)
        around = ver.Around(
            self.agents, self.reach, self.speed, self.touch, self.confined, self.statics, self.planes, self.margin
        )  # fmt: skip
        return arm, moved, motion.ticks, around, work

    def slack(self, every=1):
        """Smallest gap of anything to anything [m], the oracle's."""
        motion, found = self.motion, [np.inf]
        capsules = motion.robot.capsules
        for i in range(len(capsules)):
            for k, agent in enumerate(self.agents):
                grown = {"reach": self.reach[k], "rate": self.speed[k], "touch": self.touch[k]}
                found.append(motion.gap("people", i, agent, **grown, every=every))
            if np.ptp(motion.ends[:, i], axis=0).max() < 1e-9:
                continue
            found += [motion.gap("statics", i, agent, margin=self.margin, every=every) for agent in self.statics]
            for plane in self.planes:
                # the first joint's axis is upright: its column stands on what is level
                if capsules["link"][i] > 0 or np.hypot(*plane["normal"][:2]) > 1e-9:
                    found.append(motion.gap("planes", i, plane, margin=self.margin, every=every))
        return min(found)


def own_slack(motion, margin=0.0):
    """Smallest gap of the arm to itself, of pairs that move against each other [m]."""
    found, radius, link = [np.inf], motion.robot.capsules["radius"], motion.robot.capsules["link"]
    turned = np.ptp(motion.samples[1], axis=0)
    for i, j in motion.robot.self_pairs:
        # whether a joint between them turns: the gap itself does not change where a capsule lies on that joint's axis
        if turned[min(link[i], link[j]) + 1 : max(link[i], link[j]) + 1].max() > 0.0:
            gap = segment_gaps(motion.ends[:, i, 0], motion.ends[:, i, 1], motion.ends[:, j, 0], motion.ends[:, j, 1])
            found.append(gap.min() - radius[i] - radius[j] - 2.0 * margin)
    return min(found)


def a_motion(robot, rng, share=None):
    """A posture in range with a speed, acceleration and jerk up to a share of the limits."""
    low, high, V, A, J = limits_of(robot)
    share = rng.choice([0.02, 0.1, 0.3, 1.0]) if share is None else share
    q = rng.uniform(low, high) if rng.random() < 0.5 else robot.home + rng.uniform(-0.4, 0.4, robot.n)
    moving = rng.random(robot.n) < rng.uniform(0.2, 1.0)
    v, a, u = (share * moving * rng.uniform(-1.0, 1.0, robot.n) * x for x in (V, A, J))
    return np.array([q, v, a]), u


def a_capsule(rng, near, spread=0.8):
    start = near + rng.normal(size=3) * spread
    end = start + (rng.normal(size=3) * rng.choice([0.0, 0.1, 0.5]))
    return start, end, float(rng.choice([0.0, 0.05, 0.1, 0.25]))


def grazing(case_at, rng):
    """Move something along a line until the oracle's smallest gap is small: a case near the verdict's edge."""
    low, high = -1.5, 3.0
    for _ in range(14):
        middle = (low + high) / 2.0
        low, high = (middle, high) if case_at(middle).slack(every=16) < 0.0 else (low, middle)
    return case_at(high + rng.choice([-1.0, 1.0, 1.0]) * 10.0 ** rng.uniform(-4.0, -1.5))


KINDS = {"people": ver.REACH, "statics": ver.STATIC, "planes": ver.HALF_SPACE}


def a_case(robot, rng, kind, touch=0.0):
    motion = Motion(robot, *a_motion(robot, rng))
    near = motion.ends[rng.integers(len(motion.ends)), rng.integers(len(robot.capsules))].mean(axis=0)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    start, end, radius = a_capsule(rng, np.zeros(3), 0.0)
    reach, speed = float(rng.choice([0.0, 0.02, 0.2])), float(rng.choice([0.05, 0.5, 1.6, 2.0]))
    margin = float(rng.choice([0.0, 0.01]))

    def at(distance):
        spot = near + distance * way
        if kind == "people":
            return Case(motion, people=[(spot + start, spot + end, radius, reach, speed, touch)])
        if kind == "statics":
            return Case(motion, statics=[(spot + start, spot + end, radius)], margin=margin)
        return Case(motion, planes=[(-way, -way @ spot)], margin=margin)

    return at(rng.uniform(0.0, 1.5)) if rng.random() < 0.25 else grazing(at, rng)


def fastest_approach(case):
    """How fast a gap can close at most [m/s]: all joints at their largest speeds of this motion, people besides."""
    motion = case.motion
    _, _, speeds = motion.samples
    return (levers(motion.robot) @ np.abs(speeds).max(axis=0)).max() + case.speed.max(initial=0.0)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", KINDS)
def test_verdicts_agree_with_the_sampled_motion(robot, kind, times):
    """SAFE: no sample at 4 kHz touches. Not SAFE: one is closer than half a millisecond's way. Most are close."""
    rng = np.random.default_rng(len(kind))
    safe = unsafe = 0
    for _ in range(60 * times):
        case = a_case(robot, rng, kind)
        code, row, column, moment = case.verdict()
        slack = case.slack()
        if code == ver.SAFE:
            assert slack > -1e-9
            safe += 1
        else:
            assert code in (KINDS[kind], ver.UNDECIDED)
            assert code == ver.UNDECIDED or (0 <= row < 5 and column == 0)
            assert 0.0 <= moment <= case.motion.times[-1] + DT
            assert slack < 5.1e-4 * fastest_approach(case) + 1e-3
            unsafe += slack < 0.0
    assert safe > 15 * times
    assert unsafe > 5 * times


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", ["people", "touched", "confined"])
def test_who_is_surely_met_is_met(robot, kind, times):
    """Whatever is left of the gap, none or a hair: a stop that is said to meet somebody for sure is never SAFE.

    Of those that are refused, most are found at once; with whoever may be touched, or is confined, it is not tried.
    """
    rng, safe, refused, found = np.random.default_rng(21), 0, 0, 0
    for _ in range(40 * times):
        case = a_case(robot, rng, "people", touch=0.3 if kind == "touched" else 0.0)
        if kind == "confined":
            case.confined["slower"] = case.speed[:, None]  # they stay where they were measured
            for p in range(5):
                case.confined["knots"][:, p] = case.agents["start"] + p / 4 * (
                    case.agents["end"] - case.agents["start"]
                )
        arm, motion, ticks, around, work = case.asked()
        code, row, *_ = ver.keeps_clear(arm, motion, ticks, around, work)
        surely = [ver.surely_meets(arm, motion, around, i, 0, work) for i in range(len(robot.capsules))]
        assert not (code == ver.SAFE and any(surely))
        safe += code == ver.SAFE
        if code == ver.REACH:
            refused += 1
            found += surely[row]
    assert safe > 10 * times
    assert refused > (1 if kind == "confined" else 5) * times
    assert found > refused / 3 if kind == "people" else found == 0


@pytest.mark.long
def test_a_touch_is_let_pass_only_below_its_speed(robot, times):
    """Soundness of the contact speed: whenever SAFE, the surface is slower from the first touch on."""
    rng = np.random.default_rng(7)
    gained = 0
    for _ in range(50 * times):
        case = a_case(robot, rng, "people")
        strict = case.verdict()[0] == ver.SAFE
        case.touch[:] = rng.choice([0.05, 0.3, 1.0])
        if case.verdict()[0] == ver.SAFE:
            assert case.slack() > -1e-9
            gained += not strict
        else:
            assert not strict
    assert gained > 2 * times


@pytest.mark.long
def test_verdicts_about_the_arm_itself_agree_with_the_sampled_motion(robot, times):
    rng = np.random.default_rng(11)
    safe = unsafe = 0
    for k in range(120 * times):
        state, jerk = a_motion(robot, rng, 1.0)
        if k % 2:
            # folded: elbow and wrist swing at base and upper arm
            state[0, 1:3] = rng.uniform([-1.7, 2.0], [2.0, 3.5])
            state[0, 4] = rng.uniform(-2.0, 2.0)
        motion = Motion(robot, state, jerk)
        code, row, column, _ = Case(motion, margin=0.005).verdict(own=True)
        slack = own_slack(motion, 0.005)
        if code == ver.SAFE:
            assert slack > -1e-9
            safe += 1
        else:
            assert code == ver.SELF
            assert row > column
            assert slack < 5.1e-4 * fastest_approach(Case(motion)) + 1e-3
            unsafe += slack < 0.0
    assert safe > 20 * times
    assert unsafe > 20 * times


@pytest.mark.long
@pytest.mark.parametrize("joint", [2, 4])
def test_a_single_joint_that_swings_the_arm_at_itself_is_seen(robot, joint):
    """Fold the arm until the swing of one joint alone just meets it: met before, missed after."""
    rng, found = np.random.default_rng(joint), 0
    for _ in range(12):
        state, bounds = np.zeros((3, 6)), limits_of(robot)
        state[0, 4], turn = rng.uniform(-2.0, 2.0), rng.choice([-1.0, 1.0])
        state[1, joint] = 0.6 * turn * bounds[2, joint]

        def folded(q3, state=state):
            state[0, 2] = q3
            return Motion(robot, state, np.zeros(6))

        free, hit = (0.0, 3.4) if joint == 2 else (0.5, -1.2)
        if own_slack(folded(free)) < 0.0 or own_slack(folded(hit)) > 0.0:
            continue
        for _ in range(12):
            middle = (free + hit) / 2.0
            free, hit = (middle, hit) if own_slack(folded(middle)) > 0.0 else (free, middle)
        assert Case(folded(hit)).verdict(own=True)[0] == ver.SELF
        free = folded(free - np.sign(hit - free) * 0.05)
        if own_slack(free) > 5.1e-4 * fastest_approach(Case(free)) + 1e-3:
            assert Case(free).verdict(own=True)[0] == ver.SAFE
        found += 1
    assert found >= 3


@pytest.mark.long
def test_an_arm_under_way_to_several_things_is_stopped_by_the_first(robot):
    """With everything in the scene the verdict is that of the thing that is met first, and SAFE only if all are."""
    rng = np.random.default_rng(12)
    for _ in range(15):
        alone = [a_case(robot, rng, kind) for kind in KINDS]
        for case in alone:
            case.motion, case.margin = alone[0].motion, 0.0
        both = alone[0]
        codes = [case.verdict()[0] for case in alone]
        both.statics, both.planes = alone[1].statics, alone[2].planes
        code, *_, moment = both.verdict()
        assert (code == ver.SAFE) == (set(codes) == {ver.SAFE})
        if code != ver.SAFE:
            assert code in codes
            # told to when it is met, not later
            assert moment <= both.motion.times[-1] + DT


# ---- levers --------------------------------------------------------------------------------------------


def swings(robot, rng, count):
    """Largest speed of a capsule's axis for a unit speed of one joint alone over random postures, shape (m, n) [m]."""
    chain, low, high = chain_of(robot), *robot.limits.position.T
    found = np.zeros((len(robot.capsules), robot.n))
    for _ in range(count):
        q = rng.uniform(low, high)
        for i, capsule in enumerate(robot.capsules):
            for end in ("start", "end"):
                J = ref.jacobian(chain, q, int(capsule["link"]) + 1, capsule[end])
                found[i] = np.maximum(found[i], np.linalg.norm(J, axis=0))
    return found


@pytest.mark.long
@pytest.mark.parametrize("arm", ["lr_mate", "toy", "long tool"])
def test_levers_bound_every_joints_swing_and_not_by_much(robot, toy_robot, arm, times):
    if arm == "toy":
        robot = toy_robot
    elif arm == "long tool":
        capsules = robot.capsules.copy()
        capsules[-1]["start"], capsules[-1]["end"] = [0.1, -0.2, 0.1], [0.5, 0.3, -0.2]
        capsules[0]["end"] = [0.3, 0.1, 0.0]
        robot = dataclasses.replace(robot, capsules=capsules)
    bound = levers(robot)
    found = swings(robot, np.random.default_rng(3), 60 * times)
    assert bound.shape == found.shape
    assert np.all(found <= bound + 1e-12)
    # joints that do not carry the capsule do not swing it
    for i, capsule in enumerate(robot.capsules):
        assert np.all(bound[i, capsule["link"] + 1 :] == 0.0)
    # over all postures a swing reaches most of its bound (measured: 0.72 and more)
    carried = bound > 1e-9
    assert np.all(found[carried] >= 0.6 * bound[carried]), (found[carried] / bound[carried]).min()


# ---- what is no number, and what is at rest ------------------------------------------------------------


def quiet(robot, share=0.05):
    """A slow motion at home and a person far away, a half-space below, a static capsule far away."""
    state = np.array([robot.home, share * robot.limits.velocity, np.zeros(6)])
    motion = Motion(robot, state, 0.1 * robot.limits.jerk)
    far = np.array([4.0, 0.0, 1.0])
    return Case(
        motion,
        people=[(far, far + 0.3, 0.2, 0.0, 1.6, 0.0)],
        statics=[(-far, -far - 0.3, 0.2)],
        planes=[((0.0, 0.0, 1.0), TABLE)],
    )


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # numpy's own, where kernels are not compiled
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    "where",
    ["position", "velocity", "acceleration", "jerk", "person", "person radius", "reach", "speed", "touch",
     "static", "static radius", "normal", "offset", "margin", "levers"],
)  # fmt: skip
def test_what_is_no_number_is_never_safe(robot, where, bad):
    assert quiet(robot).verdict(own=True)[0] == ver.SAFE
    case, swing = quiet(robot), levers(robot)
    motion = case.motion
    if where in ("position", "velocity", "acceleration"):
        row = ("position", "velocity", "acceleration").index(where)
        motion.state[row, 2] = bad
        integrate(motion.state, motion.jerk, DT, motion.after)
    elif where == "jerk":
        motion.jerk[2] = bad
        integrate(motion.state, motion.jerk, DT, motion.after)
    elif where == "levers":
        swing[3, 1] = bad
    elif where == "margin":
        case.margin = bad
    elif where in ("reach", "speed", "touch"):
        getattr(case, where)[0] = bad
    elif "radius" in where:
        (case.agents if "person" in where else case.statics)["radius"][0] = bad
    elif where in ("person", "static"):
        (case.agents if where == "person" else case.statics)["end"][0, 1] = bad
    elif where == "normal":
        case.planes["normal"][0, 2] = bad
    else:
        case.planes["offset"][0] = bad
    legitimate = {
        ("touch", np.nan), ("levers", -np.inf), ("touch", np.inf), ("touch", -np.inf),
        ("reach", -np.inf), ("person radius", -np.inf),
        ("static radius", -np.inf), ("offset", -np.inf), ("margin", -np.inf), ("normal", np.inf),
    }  # fmt: skip
    if (where, bad) not in legitimate:  # those say that there is nothing to fear, or are never asked
        assert case.verdict(own=True, swing=swing)[0] != ver.SAFE
        if where in ("position", "velocity", "acceleration", "jerk"):
            after, plan = np.zeros((3, 6)), records(6, STOP)
            integrate(motion.state, motion.jerk, DT, after)
            plan_stop(after, limits_of(robot), DT, plan)
            assert not ver.keeps_limits(motion.state, motion.jerk, after, plan, limits_of(robot), DT)


@pytest.mark.parametrize(
    ("start", "end", "radius", "normal", "offset"),
    [
        ([np.nan, 0, 0], [0, 0, 0], 0.1, [0, 0, 1], 0.0),
        ([0, 0, 0], [0, np.inf, 0], 0.1, [0, 0, 1], 0.0),
        ([0, 0, 0], [0, 0, 0], -0.1, [0, 0, 1], 0.0),
        ([0, 0, 0], [0, 0, 0], np.nan, [0, 0, 1], 0.0),
        ([0, 0, 0], [0, 0, 0], np.inf, [0, 0, 1], 0.0),
        ([0, 0, 0], [0, 0, 0], 0.1, [0, 0, np.nan], 0.0),
        ([0, 0, 0], [0, 0, 0], 0.1, [0, 0, 0.9], 0.0),
        ([0, 0, 0], [0, 0, 0], 0.1, [0, 0, 0], 0.0),
        ([0, 0, 0], [0, 0, 0], 0.1, [0, 0, 1], np.nan),
        ([0, 0, 0], [0, 0, 0], 0.1, [0, 0, 1], -np.inf),
    ],
)
def test_fixtures_that_are_none_are_refused(start, end, radius, normal, offset):
    statics, planes = records(2, AGENT), records(2, PLANE)
    good = [np.zeros(3), np.ones(3), 0.2, np.array([1.0, 0.0, 0.0]), 0.3]
    for first in (True, False):
        rows = [good, [start, end, radius, normal, offset]] if first else [[start, end, radius, normal, offset], good]
        arrays = [np.array(column, float) for column in zip(*rows, strict=True)]
        assert ver.load_fixtures(*arrays, statics, planes, True) == ver.UNSOUND
        assert ver.load_fixtures(*arrays, statics, planes, False) == ver.UNSOUND
    assert ver.load_fixtures(*(np.array([x], float) for x in good), statics, planes, True) == 0
    assert ver.load_fixtures(*(np.array([x], float) for x in good), statics, planes, False) == 0
    np.testing.assert_array_equal(statics["end"][0], np.ones(3))
    assert planes["offset"][0] == 0.3
    for k, moved in enumerate([np.full(3, 0.1), np.full(3, 1.1), 0.3, np.array([0.0, 1.0, 0.0]), 0.4]):
        other = [np.array([moved if i == k else x], float) for i, x in enumerate(good)]
        changed = ver.CHANGED_STATICS if k < 3 else ver.CHANGED_PLANES
        assert ver.load_fixtures(*other, statics, planes, False) == changed


def test_an_arm_at_rest_may_be_touched_and_one_that_begins_to_move_may_not(robot):
    tip = Motion(robot, [robot.home, np.zeros(6), np.zeros(6)], np.zeros(6))
    on_it = tip.ends[0, 4, 0]
    person = [(on_it, on_it, 0.1, 0.0, 1.6, 0.0)]
    assert Case(tip, people=person, statics=[(on_it, on_it, 0.1)]).verdict()[0] == ver.SAFE
    for joint in range(5):
        jerk = np.zeros(6)
        jerk[joint] = 0.01 * robot.limits.jerk[joint]
        going = Motion(robot, [robot.home, np.zeros(6), np.zeros(6)], jerk)
        assert Case(going, people=person).verdict()[0] == ver.REACH
        on_the_base = robot.mount + np.array([0.0, 0.0, 0.06])
        code, row, *_ = Case(going, people=[(on_the_base, on_the_base, 0.01, 0.0, 0.05, 0.0)]).verdict()
        # links that are held back by no moving joint may be touched
        assert (code, row) == ((ver.REACH, 0) if joint == 0 else (ver.SAFE, -1))


def test_a_spinning_column_is_not_at_rest(robot):
    """The base column's axis hardly moves, its surface does: nobody may touch it, but with a contact speed above."""
    state = np.array([robot.home, np.zeros(6), np.zeros(6)])
    state[1, 0] = 0.1
    capsules = robot.capsules.copy()
    capsules[0]["start"], capsules[0]["end"] = [0, 0, 0], [0, 0, -0.2]  # on J1's axis: a pure spin
    pure = dataclasses.replace(robot, capsules=capsules[:1], self_pairs=robot.self_pairs[:0])
    motion = Motion(pure, state, np.zeros(6))
    beside = robot.mount + np.array([0.4, 0.0, 0.2])
    fast = capsules[0]["radius"] * 0.1
    for touch, expected in ((0.0, ver.REACH), (0.9 * fast, ver.REACH), (1.01 * fast, ver.SAFE)):
        person = (beside, beside, 0.4 - capsules[0]["radius"] - 0.01, 0.0, 1.6, touch)
        assert Case(motion, people=[person]).verdict()[0] == expected
    for gap, expected in ((0.001, ver.REACH), (1.6 * (motion.times[-1] + DT) + 0.01, ver.SAFE)):
        person = (beside, beside, 0.4 - capsules[0]["radius"] - gap, 0.0, 1.6, 0.0)
        assert Case(motion, people=[person]).verdict()[0] == expected


@pytest.mark.parametrize("kind", ["planes", "statics", "self"])
def test_what_a_crawl_would_close_is_seen_and_what_rests_closed_may_stay(robot, kind):
    """Nanometres, at a speed that elsewhere counts as rest: an episode ended 4 nm inside of the arm's own flange."""
    lever = levers(robot)
    state = np.array([robot.home, np.zeros(6), np.zeros(6)])
    # the elbow, towards the base: 0.8 of what the outermost capsule may move by and rest
    state[1, 2] = 0.8 * REST_SPEED / lever[:, 2].max()
    inner, outer = next(
        (i, j) for i, j in robot.self_pairs if robot.capsules["link"][i] < 2 < robot.capsules["link"][j]
    )
    for sign in (1.0, -1.0):
        motion = Motion(robot, state * [[1.0], [sign], [1.0]], np.zeros(6))
        one, two = motion.ends[:, inner], motion.ends[:, outer]
        radius = robot.capsules["radius"][outer]
        beyond = motion.ends[0, outer, 1] + [0.0, 0.0, -0.4]
        gaps = {
            "planes": motion.ends[:, outer, :, 2].min(axis=1) - radius,
            "statics": segment_gaps(two[:, 0], two[:, 1], *(np.broadcast_to(beyond, two[:, 0].shape),) * 2) - radius,
            "self": segment_gaps(one[:, 0], one[:, 1], two[:, 0], two[:, 1]),
        }[kind]
        if gaps[-1] < gaps[0]:
            break
    closes = gaps[0] - gaps[-1]
    assert 1e-9 < closes < 1e-6
    for left, safe in ((0.5 * closes, False), (3.0 * closes, True), (-0.5 * closes, True)):
        if kind == "planes":
            only = dataclasses.replace(robot, capsules=robot.capsules[[outer]], self_pairs=robot.self_pairs[:0])
            case = Case(Motion(only, motion.state, motion.jerk), planes=[((0.0, 0.0, 1.0), gaps[0] - left)])
        elif kind == "statics":
            only = dataclasses.replace(robot, capsules=robot.capsules[[outer]], self_pairs=robot.self_pairs[:0])
            case = Case(Motion(only, motion.state, motion.jerk), statics=[(beyond, beyond, gaps[0] - left)])
        else:
            thick = robot.capsules.copy()
            thick["radius"][[inner, outer]] = (gaps[0] - left) / 2.0
            pair = np.array([[inner, outer]])
            case = Case(Motion(dataclasses.replace(robot, capsules=thick, self_pairs=pair), motion.state, motion.jerk))
        assert (case.verdict(own=kind == "self")[0] == ver.SAFE) == safe


def test_links_come_to_rest_one_after_the_other(robot):
    """Who arrives when a link rests already may touch it, though others still move."""
    state = np.array([robot.home, np.zeros(6), np.zeros(6)])
    state[1, 4], state[1, 1] = 0.5 * robot.limits.velocity[4], 0.01
    motion = Motion(robot, state, np.zeros(6))
    rests = DT * (1 + motion.plan[1]["ramp"] + motion.plan[1]["hold"] + motion.plan[1]["release"])
    assert rests < 0.5 * motion.times[-1]
    start, end = motion.ends[0, 1]
    beside = (start + end) / 2.0 - np.array([1.0, 0.0, 0.0])
    gap = 1.0 - robot.capsules["radius"][1]
    for arrives, expected in ((rests + 0.004, ver.SAFE), (rests - 0.03, ver.REACH)):
        radius = gap - 0.3 * arrives
        assert Case(motion, people=[(beside, beside, radius, 0.0, 0.3, 0.0)]).verdict()[0] == expected


def test_endless_looks_end_undecided_not_safe(robot):
    """A turn close under a ceiling meets nothing and needs too many looks: it is not called SAFE."""
    state = np.array([robot.home, np.zeros(6), np.zeros(6)])
    state[1, 0] = 0.9 * robot.limits.velocity[0]
    motion = Motion(robot, state, np.zeros(6))
    top = (motion.ends[0, 1:, :, 2] + robot.capsules["radius"][1:, None]).max()
    found = [Case(motion, planes=[((0.0, 0.0, -1.0), -top - gap)]).verdict()[0] for gap in (0.03, 0.004, 0.001, -0.01)]
    assert found == [ver.SAFE, ver.UNDECIDED, ver.HALF_SPACE, ver.HALF_SPACE]


# ---- the step itself -----------------------------------------------------------------------------------


def test_speeds_that_are_still_to_come_are_foreseen(robot, times):
    """No joint is ever faster than what the verification takes for its largest speed from then on."""
    rng = np.random.default_rng(5)
    posture, fastest = np.zeros(6), np.zeros(6)
    for _ in range(60 * times):
        motion = Motion(robot, *a_motion(robot, rng, 1.0))
        _, positions, speeds = motion.samples
        later = np.maximum.accumulate(np.abs(speeds)[::-1])[::-1]
        # the first step, and anywhere
        for k in [*range(0, 32, 4), *rng.integers(len(positions), size=8)]:
            moved = ver.StepAndStop(motion.state, motion.jerk, motion.after, motion.plan, DT)
            ver.posture_at(moved, motion.times[k], posture, fastest)
            np.testing.assert_allclose(posture, positions[k], atol=1e-9)
            assert np.all(later[k] <= fastest + 1e-9)
            # and not taken for much faster
            assert np.all(fastest <= later[k] + SAMPLE * np.abs(limits_of(robot)[3]) * 1.5 + 1e-6)


@pytest.mark.long
def test_limits_are_those_of_every_instant_of_step_and_stop(robot, times):
    rng = np.random.default_rng(6)
    low, high, V, A, J = bounds = limits_of(robot)
    kept = broken = 0
    for _ in range(100 * times):
        state, jerk = a_motion(robot, rng, 1.0)
        if rng.random() < 0.7:
            state[0] = np.clip(state[0], 0.7 * low, 0.7 * high)
            state[1:] *= 0.8
        motion = Motion(robot, state, jerk)
        _, positions, speeds = motion.samples
        accelerations = np.diff(speeds, axis=0) / SAMPLE
        inside = (
            np.all((low <= positions) & (positions <= high))
            and np.all(np.abs(speeds) <= V) and np.all(np.abs(accelerations) <= A) and np.all(np.abs(jerk) <= J)
        )  # fmt: skip
        keeps = ver.keeps_limits(state, jerk, motion.after, motion.plan, bounds, DT)
        if keeps:
            assert np.all((low - 1e-9 <= positions) & (positions <= high + 1e-9))
            assert np.all(np.abs(speeds) <= V * (1 + 1e-9))
            assert np.all(np.abs(accelerations) <= A * (1 + 1e-6))
        else:
            # what only just passes between samples may differ
            worst = max(
                ((low - positions) / (high - low)).max(), ((positions - high) / (high - low)).max(),
                (np.abs(speeds) / V - 1.0).max(), (np.abs(accelerations) / A - 1.0).max(),
            )  # fmt: skip
            assert worst > -5e-3
        kept += keeps
        broken += not inside
    assert kept > 10 * times
    assert broken > 10 * times


def test_limits_hold_within_the_step_too(robot):
    """A jerk beyond its bound and a speed that is exceeded between two ticks, each harmless at both of them."""
    bounds = limits_of(robot)
    V, J = bounds[2], bounds[4]

    def keeps(state, jerk):
        motion = Motion(robot, state, jerk)
        return ver.keeps_limits(motion.state, motion.jerk, motion.after, motion.plan, bounds, DT)

    for joint in range(6):
        one = np.eye(6)[joint]
        rest = np.array([robot.home, np.zeros(6), np.zeros(6)])
        assert keeps(rest, one * J)
        assert not keeps(rest, one * J * 1.001)
        for share, kept in ((1.0 - 1e-5, False), (0.9, True)):
            over = rest.copy()
            over[1], over[2] = share * V * one, J * DT / 2.0 * one
            assert keeps(over, -one * J) == kept


# ---- choosing --------------------------------------------------------------------------------------------


@njit
def chosen(arm, settings, memory, wanted, jerk, room, work):
    room = room_behind(arm, settings, memory, wanted, work, 0) if room == 0.0 else room
    return choose(arm, settings, memory, wanted, jerk, room, work, 0), room


def choosing(robot, state, wanted, stored, tick, people=(), *, clipped, room):
    """What is chosen, as told of the room of what is clipped, 0 for the true one of what is wanted; and that room."""
    n, count = robot.n, len(people)
    case = Case(Motion(robot, state, wanted), people=people)
    arm = layout.ArmRecord(robot.links, robot.capsules, robot.self_pairs, levers(robot), limits_of(robot))
    settings = NoFilter(robot, DT, failsafe=FailsafeParams()).settings()
    assert settings.astray == 0.0
    memory, work, jerk = layout.memory(1, n, count, 0, 0), layout.work(arm, count, 0, 0, static_rows=False), np.zeros(n)
    memory.state[0], memory.stored[0], memory.arm["step"] = state, stored, tick
    memory.growth[0], memory.touch[0] = case.speed, case.touch
    work.grown[:], work.reach[:] = case.agents, case.reach
    work.clipped[:] = clipped
    (which, why, *where), room = chosen(arm, settings, memory, np.array(wanted, float), jerk, room, work)
    return (which, why, tuple(where), jerk, work.after, work.next), room


@pytest.mark.long
def test_the_choice_is_the_first_that_is_verified(robot, times):
    """The wanted jerk, or half way to the stored stop's, or that, bit for bit: as asking one by one says.

    What is known of the room of the wanted one, or of another, changes nothing of it.
    """
    rng = np.random.default_rng(9)
    seen, rooms = [0, 0, 0], []
    for _ in range(80 * times):
        state, _ = a_motion(robot, rng, rng.choice([0.15, 0.15, 1.0]))
        state[0] = robot.home + rng.uniform(-0.3, 0.3, 6)
        stored, bounds = records(6, STOP), limits_of(robot)
        plan_stop(state, bounds, DT, stored)
        tick = int(rng.integers(0, 3))
        wanted = rng.uniform(-1.0, 1.0, 6) * bounds[4]
        motion, way = Motion(robot, state, wanted), rng.normal(size=3)
        way /= np.linalg.norm(way)

        def beside(distance, motion=motion, way=way):
            spot = motion.start + distance * way
            return [(spot, spot, 0.1, 0.0, 1.6, 0.0)]

        # just too near for the wanted jerk, or anywhere
        near, far = 0.0, 3.0
        for _ in range(12):
            middle = (near + far) / 2.0
            safe = Case(motion, people=beside(middle)).verdict()[0] == ver.SAFE
            near, far = (near, middle) if safe else (middle, far)
        people = beside(near if rng.random() < 0.7 else rng.uniform(0.2, 1.5))
        case = (robot, state, wanted, stored, tick, people)
        (which, why, where, jerk, after, plan), _ = choosing(*case, clipped=wanted, room=np.nan)
        told, room = choosing(*case, clipped=wanted, room=0.0)
        others, _ = choosing(*case, clipped=0.5 * wanted, room=np.inf)
        for one in (told, others):
            assert one[:2] == (which, why)
            for mine, other in zip(one[3:], (jerk, after, plan if which < 2 else one[5]), strict=True):
                np.testing.assert_array_equal(mine, other)
        rooms.append((room > 0.3, which))
        tail = np.zeros(6)
        stop_jerk(stored, tick, tail)
        # a share of the bound, times the bound: what an environment integrates
        expected = [wanted, (tail + wanted) / 2.0 / bounds[4] * bounds[4], tail]
        np.testing.assert_array_equal(jerk, expected[which])
        follows = np.zeros((3, 6))
        integrate(state, jerk, DT, follows)
        np.testing.assert_array_equal(after, follows)
        for k in range(min(which + 1, 2)):
            motion = Motion(robot, state, expected[k])
            limited = ver.keeps_limits(state, expected[k], motion.after, motion.plan, bounds, DT)
            code, *rest = Case(motion, people=people).verdict(own=True)
            good = limited and code == ver.SAFE
            assert good == (k == which)
            if k == 0:
                assert why == (code if limited else ver.LIMITS)
                if limited and code != ver.SAFE:
                    assert where[:2] == tuple(rest[:2])
                    # the stop's jerks are rounded there to what an environment integrates
                    assert where[2] == pytest.approx(rest[2], rel=1e-12)
            if good:
                for name in ("ramp", "hold", "release"):
                    np.testing.assert_array_equal(plan[name], motion.plan[name])
                for name in ("jerk_in", "jerk_out"):
                    np.testing.assert_array_equal(plan[name], motion.plan[name] / bounds[4] * bounds[4])
        seen[which] += 1
    assert min(seen) >= 3
    assert rooms.count((True, 0)) >= 3  # of a room wide enough not to look at people again


@njit
def softest_of(arm, settings, memory, jerk, end, work):
    return softest(arm, settings, memory, jerk, 0, end, work, 0)


@pytest.mark.long
def test_the_softest_stop_is_the_same_whoever_was_in_the_way_before(robot, times):
    """Which pair is looked at first saves time only: number of the stop and what was in the way of the last one."""
    rng, seen = np.random.default_rng(22), set()
    settings = NoFilter(robot, DT, failsafe=FailsafeParams(graded=True)).settings()
    arm, count = layout.ArmRecord(robot.links, robot.capsules, robot.self_pairs, levers(robot), limits_of(robot)), 5
    memory, work = layout.memory(1, robot.n, 1, 0, 0), layout.work(arm, 1, 0, 0, static_rows=False)
    assert len(settings.hardness) == count
    for _ in range(25 * times):
        state, jerk = a_motion(robot, rng, rng.choice([0.1, 0.3]))
        state[0] = robot.home + rng.uniform(-0.3, 0.3, 6)
        case = a_case(robot, rng, "people")
        memory.state[0], memory.growth[0] = state, 1.6
        spot = Motion(robot, state, jerk).start + rng.normal(size=3) * rng.choice([0.2, 0.4])
        work.grown[:] = case.agents
        work.grown["start"] = work.grown["end"] = spot
        work.reach[:] = 0.0
        found = []
        for capsule in range(-1, len(robot.capsules)):
            work.met[:] = [capsule, 0] if capsule >= 0 else -1
            one = softest_of(arm, settings, memory, jerk, count, work)
            found.append((*one, work.after.tobytes(), work.next.tobytes()))
        assert all(one == found[0] for one in found)
        seen.add(found[0][0])
    assert {0, 1, count} <= seen


@pytest.mark.long
def test_a_faster_person_never_gets_more_let_through(robot, times):
    rng = np.random.default_rng(13)
    seen = set()
    for _ in range(60 * times):
        case = a_case(robot, rng, "people")
        found = []
        for speed in (0.01, 0.4, 1.0, 1.6, 2.0, 4.0):
            case.speed[:] = speed
            found.append(case.verdict()[0] == ver.SAFE)
        assert found == sorted(found, reverse=True)
        seen.add(sum(found))
    assert len(seen) >= 4
