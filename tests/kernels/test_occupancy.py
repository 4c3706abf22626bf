"""Closer sets of where people can be: nobody who keeps the bounds touches a moving arm, and more is let pass."""

import numpy as np
import pytest
from numba import njit

from jssa_gym.kernels import verification as ver
from jssa_gym.kernels.chain import place_axes, pose
from jssa_gym.kernels.motion import integrate
from jssa_gym.kernels.occupancy import STEADY, SWERVED, UNCONFIRMED, apart_for, confine_people
from jssa_gym.kernels.records import AGENT, CONFINED, FRAME, PLANE, SEGMENT, STOP, TRACK, records
from jssa_gym.kernels.stopping import plan_stop, stop_at
from jssa_gym.safety.failsafe import levers
from jssa_gym.tick import layout

DT = 0.008
STEP = 0.002
"""What the oracle looks at [s]."""


@pytest.fixture(params=[1, pytest.param(20, marks=pytest.mark.slow)])
def times(request):
    """Factor on the number of cases; the large one runs with -m slow."""
    return request.param


# ---- an arm that stops ----------------------------------------------------------------------------------


@njit
def sampled(links, capsules, state, jerk, after, plan, moments):
    """Capsule axes at many moments of a step and the stop after it, shape (t, m, 2, 3)."""
    n, m = len(links), len(capsules)
    frames, segments, q = np.zeros(n, FRAME), np.zeros(m, SEGMENT), np.zeros(n)
    out = np.zeros((len(moments), m, 2, 3))
    for k, t in enumerate(moments):
        for j in range(n):
            if t < DT:
                q[j] = state[0, j] + t * state[1, j] + t**2 / 2.0 * state[2, j] + t**3 / 6.0 * jerk[j]
            else:
                q[j] = stop_at(after[0, j], after[1, j], after[2, j], plan[j], DT, t - DT)[0]
        pose(links, q, frames)
        place_axes(frames, capsules, segments)
        for i in range(m):
            out[k, i, 0], out[k, i, 1] = segments[i]["start"], segments[i]["end"]
    return out


class Stop:
    """A random step of an arm and the stop after it."""

    def __init__(self, robot, rng):
        limits = robot.limits.bounds()
        share = rng.choice([0.1, 0.3, 0.6])
        way = rng.uniform(-1.0, 1.0, (3, robot.n))
        self.robot = robot
        self.state = np.array([robot.home + rng.uniform(-0.4, 0.4, robot.n), *(share * way[:2] * limits[2:4])])
        self.jerk, self.after = share * way[2] * limits[4], np.zeros((3, robot.n))
        self.plan = records(robot.n, STOP)
        integrate(self.state, self.jerk, DT, self.after)
        self.ticks = plan_stop(self.after, limits, DT, self.plan)
        self.times = np.arange(0.0, DT * (1 + self.ticks) + STEP / 2.0, STEP)
        self.ends = sampled(robot.links, robot.capsules, self.state, self.jerk, self.after, self.plan, self.times)
        moved = np.linalg.norm(np.diff(self.ends, axis=0), axis=3).max(axis=2) / STEP
        self.moving = np.vstack([moved, np.zeros(len(robot.capsules))]) > 1e-4
        self.arm = layout.ArmRecord(robot.links, robot.capsules, robot.self_pairs[:0], levers(robot), limits)


# ---- somebody beside it -----------------------------------------------------------------------------------


class Someone:
    """One capsule as it was measured, and what is assumed of it: all that a verdict depends on, and what can happen."""

    def __init__(self, ends, velocity, *, speeds=(2.0, 2.0), acceleration=0.0, velocity_error=0.0, age=0.0, lag=0.0,
                 error=0.0, radius=0.05, steady=STEADY):  # fmt: skip
        self.ends, self.velocity, self.speeds = np.array(ends), np.array(velocity), np.array(speeds)
        self.acceleration, self.velocity_error = acceleration, velocity_error
        self.age, self.lag, self.error, self.radius, self.steady = age, lag, error, radius, steady

    def told(self, **changes):
        """The same person as a verdict is told of, something in it false."""
        fields = {**vars(self), **changes}
        return Someone(fields.pop("ends"), fields.pop("velocity"), **fields)

    def at(self, place):
        return self.told(ends=self.ends + place)

    def verdict(self, stop):
        tracks, work = records(1, TRACK), layout.work(stop.arm, 1, 0, 0, static_rows=False)
        growth = self.speeds.max()
        tracks["slower"], tracks["acceleration"] = growth - self.speeds, self.acceleration
        tracks["velocity_error"], tracks["steady"] = self.velocity_error, self.steady
        people, age = np.vstack([self.ends, self.velocity])[:, None], np.array([self.age])
        ver.load_people(
            people[0], people[1], np.array([self.radius]), np.array([growth]), age, self.lag, self.error, work.grown,
            work.reach,
        )  # fmt: skip
        confine_people(people, age, self.lag, self.error, tracks, work.confined)
        around = ver.Around(
            work.grown, work.reach, np.array([growth]), np.zeros(1), work.confined, records(0, AGENT),
            records(0, PLANE), 0.0,
        )  # fmt: skip
        motion = ver.StepAndStop(stop.state, stop.jerk, stop.after, stop.plan, DT)
        return ver.keeps_clear(stop.arm, motion, stop.ticks, around, work)

    def motions(self, ways, changes, count):
        """Ends that keep all bounds, at every instant since the measurement, shape (w, count, 2, 3).

        Args:
            ways: What both ends strive for at first, shape (w, 3), units.
            changes: ... and after a random part of the time, shape (w, 2, 3), each end for itself.
            count: Instants, STEP apart.
        """
        turn = (np.arange(len(ways)) * 7919 % 97 / 96.0 * count).astype(int)
        turn[: len(ways) // 2] = count  # half of them never change their mind
        position = self.ends + self.error * ways[:, None]
        velocity = self.velocity + self.velocity_error * ways[:, None]
        out = np.empty((len(ways), count, 2, 3))
        for k in range(count):
            way = np.where((k < turn)[:, None, None], ways[:, None], changes)
            if self.acceleration > 0.0:
                velocity = velocity + (k > 0) * self.acceleration * STEP * way
            else:
                velocity = self.speeds[:, None] * way
            # cutting to a ball never adds acceleration
            length = np.linalg.norm(velocity, axis=2, keepdims=True)
            velocity = velocity * np.minimum(1.0, self.speeds[:, None] / np.maximum(length, 1e-12))
            out[:, k] = position
            position = position + STEP * velocity
        return out

    def nearest(self, stop, rng, samples=20):
        """Smallest gap [m] to the arm while that moves, of many motions, those that aim at it among them."""
        late = round((self.age + self.lag) / STEP)
        count = len(stop.times) + late
        seen = np.linspace(0, len(stop.times) - 1, 7).astype(int)
        aims = [_aim(self.ends + self.velocity * stop.times[k], stop.ends[k]) for k in seen]
        random = rng.normal(size=(samples, 3))
        ways = np.vstack([*aims, random / np.linalg.norm(random, axis=1, keepdims=True)])
        changes = rng.normal(size=(len(ways), 2, 3))
        changes /= np.linalg.norm(changes, axis=2, keepdims=True)
        ends, best = self.motions(ways, changes, count), np.inf
        for passed in {0, late, int(rng.integers(0, late + 1))}:
            there = ends[:, passed : passed + len(stop.times)]
            for i in range(len(stop.robot.capsules)):
                last = np.flatnonzero(stop.moving[:, i])
                if len(last):
                    upto = last[-1] + 1
                    gaps = axis_gaps(there[:, :upto], stop.ends[:upto, i])
                    best = min(best, gaps.min() - self.radius - stop.robot.capsules["radius"][i])
        return best


def _aim(ends, arm):
    """Units from the closest point of a person's axis to that of each of the arm's capsules, shape (m, 3)."""
    share = np.linspace(0.0, 1.0, 9)[:, None]
    here = ends[0] + share * (ends[1] - ends[0])
    there = arm[:, :1] + share * (arm[:, 1:] - arm[:, :1])
    way = there[:, None] - here[None, :, None]
    length = np.linalg.norm(way, axis=3).reshape(len(arm), -1)
    way = way.reshape(len(arm), -1, 3)[np.arange(len(arm)), length.argmin(axis=1)]
    return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)


def axis_gaps(ends, arm):
    """Distances of axes (w, t, 2, 3) from those of an arm (t, 2, 3), shape (w, t): points against segments."""

    def to_segment(p, start, end):
        along = end - start
        length2 = np.maximum((along**2).sum(axis=-1), 1e-18)
        share = np.clip(((p - start) * along).sum(axis=-1) / length2, 0.0, 1.0)
        return np.linalg.norm(p - start - share[..., None] * along, axis=-1)

    a, b = ends[:, :, 0], ends[:, :, 1]
    found = [to_segment(a + r * (b - a), arm[:, 0], arm[:, 1]) for r in np.linspace(0.0, 1.0, 5)]
    return np.min(found, axis=0)


def beside(robot, rng, kind, lie=lambda one: {}):
    """A stop, and somebody as near to it as is let pass if something in them is false."""
    stop = Stop(robot, rng)
    k = rng.integers(len(stop.times))
    near, way = stop.ends[k, rng.integers(1, len(robot.capsules))].mean(axis=0), rng.normal(size=3)
    way /= np.linalg.norm(way)
    start, along = np.zeros(3), rng.normal(size=3)
    along *= rng.choice([0.05, 0.4, 0.7]) / np.linalg.norm(along)
    velocity = rng.normal(size=3)
    velocity *= rng.uniform(0.0, 1.0) / np.linalg.norm(velocity)
    late = {"age": float(rng.choice([0.0, 0.05, 0.15])), "lag": float(rng.choice([0.0, 0.06]))}
    one = Someone([start, start + along], [velocity, velocity], error=float(rng.choice([0.0, 0.02])), **late)
    if kind != "swerving":
        one = one.told(speeds=rng.choice([1.6, 0.8]) * np.array([1.0, rng.choice([1.0, 1.25, 2.5])]))
    # who is measured to be faster than the bound breaks it, or the error of velocities
    one.velocity *= min(1.0, one.speeds.min() / np.linalg.norm(one.velocity[0]))
    if kind != "tapered":
        one = one.told(acceleration=float(rng.choice([2.0, 6.0])), velocity_error=float(rng.choice([0.0, 0.2])))
    low, high = 0.0, 2.5
    for _ in range(12):
        middle = (low + high) / 2.0
        told = one.at(near + middle * way).told(**lie(one))
        safe = told.verdict(stop)[0] == ver.SAFE
        low, high = (low, middle) if safe else (middle, high)
    return stop, one.at(near + high * way), way


KINDS = ("tapered", "swerving", "both")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.long
def test_nobody_who_keeps_the_bounds_touches_a_moving_arm(robot, kind, times):
    """SAFE at the very edge: no sampled motion of both ends touches, those that aim at the arm included."""
    rng, nearest = np.random.default_rng(KINDS.index(kind)), []
    more = 0
    for _ in range(40 * times):
        stop, one, way = beside(robot, rng, kind)
        one = one.at(rng.choice([0.0, 0.0, 0.05]) * way)
        if one.verdict(stop)[0] != ver.SAFE:
            continue
        nearest.append(one.nearest(stop, rng))
        assert nearest[-1] > -1e-6
        plain = one.told(speeds=np.full(2, one.speeds.max()), acceleration=0.0).verdict(stop)[0]
        more += plain != ver.SAFE
    assert len(nearest) > 30 * times
    # they come near indeed, and the plain ball would not have let them
    assert np.sort(nearest)[3 * times] < 0.03
    assert more > 10 * times


@pytest.mark.parametrize(
    ("kind", "lie"),
    [
        ("tapered", lambda one: {"speeds": one.speeds[::-1]}),
        ("tapered", lambda one: {"age": 0.0, "lag": 0.0}),
        ("swerving", lambda one: {"velocity_error": 0.0}),
        ("swerving", lambda one: {"age": 0.0, "lag": 0.0}),
        ("swerving", lambda one: {"acceleration": one.acceleration / 2.0}),
        ("swerving", lambda one: {"velocity": 0.0 * one.velocity}),
    ],
    ids=["reversed ends", "tapered, no age", "no velocity error", "swerving, no age", "half of it", "no velocity"],
)
@pytest.mark.long
def test_the_oracle_hits_who_was_told_wrong(robot, kind, lie, times):
    """What the sets are made of is needed: who is placed as near as false bounds allow can touch the moving arm."""
    rng, hits = np.random.default_rng(5), 0
    for _ in range(40 * times):
        stop, one, _ = beside(robot, rng, kind, lie)
        hits += one.told(**lie(one)).verdict(stop)[0] == ver.SAFE and one.nearest(stop, rng) < -1e-4
    assert hits > 2 * times


# ---- the sets themselves ----------------------------------------------------------------------------------


def a_pair(rng):
    """A resting robot capsule and a person's axis beside it."""
    part = records(1, SEGMENT)
    part["start"], part["end"], part["radius"] = rng.normal(size=3) * 0.3, rng.normal(size=3) * 0.3, 0.05
    ends = rng.normal(size=3) * 0.9 + np.array([np.zeros(3), rng.normal(size=3) * 0.4])
    return part[0], ends


def confined(ends, velocity, *, slower=(0.0, 0.0), acceleration=0.0, velocity_error=0.0, age=0.0, lag=0.0, error=0.0):
    one, track = records(1, CONFINED), records(1, TRACK)
    track["slower"], track["acceleration"], track["velocity_error"] = slower, acceleration, velocity_error
    track["steady"] = STEADY
    confine_people(np.vstack([ends, velocity])[:, None], np.array([age]), lag, error, track, one)
    return one[0]


def hull_gap(part, ends, radius_at):
    """Of the hull of balls along an axis, by sampling it densely [m]."""
    r = np.linspace(0.0, 1.0, 4001)
    arm = np.array([part["start"], part["end"]])
    points = ends[0] + r[:, None] * (ends[1] - ends[0])
    along = arm[1] - arm[0]
    share = np.clip((points - arm[0]) @ along / (along @ along), 0.0, 1.0)
    axis = np.linalg.norm(points - arm[0] - share[:, None] * along, axis=1)
    return (axis - radius_at(r)).min(), axis, radius_at(r)


def test_pieces_hold_the_hull_and_not_much_more():
    """At the moment that pieces are apart until, the hull just is, or a piece's taper is in between."""
    rng, trapped, seen = np.random.default_rng(0), 0, 0
    for _ in range(400):
        part, ends = a_pair(rng)
        speeds, late, error = rng.uniform(0.3, 2.5, 2), rng.uniform(0.0, 0.2), rng.choice([0.0, 0.02])
        radii, growth, t = 0.15, speeds.max(), rng.uniform(0.0, 0.2)
        one = confined(ends, np.zeros((2, 3)), slower=growth - speeds, age=late, error=error)
        reach = growth * late + error

        def radius_at(r, time, speeds=speeds, late=late, error=error, radii=radii):
            return radii + error + ((1.0 - r) * speeds[0] + r * speeds[1]) * (late + time)

        lasts = apart_for(part, radii, one, reach, growth, 0.0, t)
        before, axis, radius = hull_gap(part, ends, lambda r, t=t, at=radius_at: at(r, t))
        trapped += axis.min() - radius[axis.argmin()] > 1e-3 and before < -1e-3
        if not lasts > 0.0:
            slack = np.abs(np.diff(speeds))[0] / 4 * (late + t)
            assert before < slack + 1e-6
            continue
        seen += 1
        gap, _, _ = hull_gap(part, ends, lambda r, at=t + lasts, of=radius_at: of(r, at))
        assert gap > -1e-6
        assert gap < np.abs(np.diff(speeds))[0] / 4 * (late + t + lasts) + 1e-5
    assert seen > 100
    # the ball at the closest point of the axis would be clear where the hull is not
    assert trapped


@pytest.mark.long
def test_a_swerve_lasts_as_long_as_the_worst_one_needs():
    """Against a resting arm: until the first of all that can swerve towards it is there, whenever it was measured."""
    rng, seen = np.random.default_rng(1), 0
    for _ in range(300):
        part, ends = a_pair(rng)
        velocity = np.tile(rng.normal(size=3) * rng.choice([0.0, 0.8]), (2, 1))
        a, off, error = rng.uniform(1.0, 8.0), rng.choice([0.0, 0.2]), rng.choice([0.0, 0.02])
        age, lag, t = rng.choice([0.0, 0.1]), rng.choice([0.0, 0.05]), rng.uniform(0.0, 0.2)
        one = confined(ends, velocity, acceleration=a, velocity_error=off, age=age, lag=lag, error=error)
        lasts = apart_for(part, 0.15, one, np.inf, 2.0, 0.0, t)

        def gap_at(time, passed, ends=ends, velocity=velocity, a=a, off=off, error=error, part=part):
            """When so much has passed since the measurement beyond the time from now."""
            since = time + passed
            radius = 0.15 + error + off * since + a * since**2 / 2.0
            return hull_gap(part, ends + since * velocity, lambda r: radius + 0.0 * r)[0]

        worst = [gap_at(t, late) for late in np.linspace(0.0, age + lag, 7)]
        if not lasts > 0.0:
            # the ball around the middle holds those of all times, with their motion to spare
            spare = (np.linalg.norm(velocity[0]) + off + a * (t + age + lag)) * (age + lag)
            assert min(worst) < spare + 1e-6
            continue
        seen += 1
        for time in np.linspace(t, t + lasts, 9):
            assert min(gap_at(time, late) for late in np.linspace(0.0, age + lag, 7)) > -1e-6
    assert seen > 60


def test_a_straight_swerve_is_exact():
    """Somebody who stands, accelerates straight at a resting point and was measured just now: d = e v t + a t² / 2."""
    part = records(1, SEGMENT)[0]
    ends = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.5]])
    for a, off, error, speed in ((2.0, 0.0, 0.0, 0.0), (4.0, 0.3, 0.02, 0.0), (4.0, 0.1, 0.0, 0.7)):
        velocity = np.tile([-speed, 0.0, 0.0], (2, 1))
        one = confined(ends, velocity, acceleration=a, velocity_error=off, error=error)
        lasts = apart_for(part, 0.1, one, np.inf, 2.0, 0.0, 0.0)
        assert 0.9 - error == pytest.approx((speed + off) * lasts + a * lasts**2 / 2.0, rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("steady", [UNCONFIRMED, SWERVED])
def test_only_who_has_kept_the_bound_is_granted_it(robot, steady):
    rng, more = np.random.default_rng(9), 0
    for _ in range(40):
        stop, one, _ = beside(robot, rng, "swerving")
        plain = one.told(acceleration=0.0).verdict(stop)
        assert one.told(steady=steady).verdict(stop) == plain
        more += plain != one.verdict(stop)
    assert more > 5


@pytest.mark.long
def test_closer_sets_never_let_less_pass(robot):
    rng, refused = np.random.default_rng(11), 0
    for _ in range(60):
        stop, one, way = beside(robot, rng, "both")
        moved = one.at(way * rng.uniform(-0.1, 0.2))
        plain = moved.told(speeds=np.full(2, moved.speeds.max()), acceleration=0.0).verdict(stop)[0]
        closer = moved.verdict(stop)[0]
        assert closer == ver.SAFE or plain != ver.SAFE
        refused += plain != ver.SAFE and closer == ver.SAFE
    assert refused > 10


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("where", ["ends", "velocity", "age", "radius"])
def test_what_is_no_number_is_never_safe(robot, where, bad):
    rng = np.random.default_rng(2)
    stop = Stop(robot, rng)
    far = Someone(
        [[0.0, 0.0, 9.0], [0.0, 0.3, 9.0]], np.zeros((2, 3)), speeds=(1.0, 2.0), acceleration=3.0, radius=0.05
    )
    assert far.verdict(stop)[0] == ver.SAFE
    near = far.at(stop.ends[0, 3, 1] - far.ends[0])
    value = getattr(near, where)
    if np.ndim(value):
        value = value.copy()
        value[0, 1] = bad
    else:
        value = bad
    assert near.told(**{where: value}).verdict(stop)[0] != ver.SAFE
