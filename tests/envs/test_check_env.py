"""check_env: an environment of one's own is told what is wrong with it, by name, and a right one is left alone."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
import reference as ref

import jssa_gym
from jssa_gym.envs.check import check_env
from jssa_gym.envs.tasks import TASKS
from jssa_gym.exceptions import InterfaceError, ParameterError
from jssa_gym.humans import HUMANS, nobody
from jssa_gym.types import CapsuleSet, JointState, Planes, Scene

DT = 0.02


class Arm(gym.Env):
    """Somebody's arm of three joints beside a hand that comes and a head that stays: what each method does is right."""

    def __init__(self, robot):
        self.robot, self.dt = robot, DT
        self.bound = np.array(robot.limits.jerk)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.observation_space = gym.spaces.Box(-10.0, 10.0, (3,), np.float64)
        self.start = np.array([[0.3, -0.2, 0.1], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.ticks, self.state, self.past = 0, self.start.copy(), [self.start.copy()]
        return self.state[0].copy(), {}

    def step(self, action):
        self.ticks += 1
        self.state = self.move(self.state, self.take(np.asarray(action, float)))
        self.past.append(self.state.copy())
        return self.state[0].copy(), 0.0, False, False, {}

    def take(self, action):
        return action

    def move(self, state, action):
        return np.array(ref.triple_integrator(*state, action * self.bound, DT))

    def clock(self):
        return self.ticks * DT

    def report(self):
        return JointState(*self.state.copy())

    def people(self):
        walk = np.array([[-0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
        start = np.array([[1.6, 0.0, 0.1], [2.0, 0.5, 0.4]]) + walk * self.clock()
        end = start + np.array([0.1, 0.0, 0.0])
        return CapsuleSet(start, end, walk, walk, np.array([0.1, 0.12]), ("hand", "head"), np.zeros(2, np.int64))

    @property
    def scene(self):
        floor = Planes(np.array([[0.0, 0.0, 1.0]]), np.array([0.0]), ("floor",))
        return Scene(self.clock(), self.report(), self.people(), nobody(), floor, np.zeros(2), np.ones(2, bool))


def found(env, **arguments) -> dict[str, str]:
    """Messages by name."""
    report = check_env(env, raise_on_error=False, **arguments)
    told: dict[str, str] = {}
    for name, _, message in map(dataclasses.astuple, report.findings):
        told[name] = f"{told[name]}\n{message}" if name in told else message
    return told


# ---- what is right is left alone -----------------------------------------------------------------------


def test_a_right_environment_is_clean(toy_robot):
    report = check_env(Arm(toy_robot))
    assert report.findings == ()
    assert str(report) == "nothing found"
    assert jssa_gym.check_env is check_env


@pytest.mark.long
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("dynamics", ["kinematic", "servo"])
def test_our_own_environments_are_clean(task, dynamics):
    # people are the same beside a servoed arm
    for human in HUMANS if dynamics == "kinematic" else (TASKS[task].human, "hand"):
        if (task, human) == ("handover", "none"):  # needs somebody to hand over to
            with pytest.raises(ParameterError):
                gym.make("jssa_gym/Handover-v0", human=human)
            continue
        env = gym.make(f"jssa_gym/{task.capitalize()}-v0", human=human, dynamics=dynamics)
        assert check_env(env, ticks=40).findings == ()
        assert check_env(jssa_gym.SensorModel(env, "none"), ticks=40).findings == ()
        env.close()


def test_a_reported_fault_is_no_mistake():
    for name in ("latency 100 ms", "stale dropouts", "noise"):
        env = jssa_gym.SensorModel(gym.make("jssa_gym/Home-v0", human="walk_by"), name)
        params = jssa_gym.FailsafeParams(position_error=env.faults.noise)
        # before the first sample has arrived nobody was measured
        assert set(found(env, params=params)) <= {"valid"}


# ---- the arm's motion ----------------------------------------------------------------------------------


class Euler(Arm):
    def move(self, state, action):
        q, v, a = state
        return np.array([q + DT * v, v + DT * a, a + DT * action * self.bound])


class Symplectic(Arm):
    def move(self, state, action):
        q, v, a = state
        a = a + DT * action * self.bound
        v = v + DT * a
        return np.array([q + DT * v, v, a])


class SecondOrder(Arm):
    def move(self, state, action):
        q, v, a = state
        return np.array([q + DT * v + DT**2 / 2 * a, v + DT * a, a + DT * action * self.bound])


class Lags(Arm):
    def report(self):
        return JointState(*self.past[max(self.ticks - 3, 0)].copy())


class ActsLate(Arm):
    def step(self, action):
        self.waiting, action = action, self.waiting
        return super().step(action)

    def reset(self, **arguments):
        self.waiting = np.zeros(3)
        return super().reset(**arguments)


class Stale(Arm):
    def report(self):
        return JointState(*self.past[self.ticks - self.ticks % 5].copy())


class Frozen(Arm):
    def report(self):
        return JointState(*self.past[0].copy())


class Float32State(Arm):
    def report(self):
        return JointState(*self.state.astype(np.float32))


class RoundedState(Arm):
    def move(self, state, action):
        return super().move(state, action).astype(np.float32).astype(float)


class RoundedActions(Arm):
    def take(self, action):
        return action.astype(np.float32).astype(float)


class RoundedJerks(Arm):
    def move(self, state, action):
        return np.array(ref.triple_integrator(*state, (action * self.bound).astype(np.float32).astype(float), DT))


class Scaled(Arm):
    def take(self, action):
        return 0.97 * action


class ScaledJoint(Arm):
    def take(self, action):
        return action * [1.0, 1.0, 1.1]


class Flipped(Arm):
    def take(self, action):
        return -action


class Clipped(Arm):
    def take(self, action):
        return np.clip(action, -0.7, 0.7)


class Repeated(Arm):
    def move(self, state, action):
        return super().move(super().move(state, action), action)


class Biased(Arm):
    def move(self, state, action):
        state = super().move(state, action)
        state[2] += 5e-7 * self.robot.limits.acceleration
        return state


class BiasedJerk(Arm):
    def take(self, action):
        return action + 1e-6


class Drifts(Arm):
    def report(self):
        return JointState(self.state[0], self.state[1], self.state[2] + 5e-7 * self.ticks * 8.0)


class NoVelocity(Arm):
    def report(self):
        return JointState(self.state[0], 0.0 * self.state[1], self.state[2])


class Degrees(Arm):
    def report(self):
        return JointState(self.state[0], np.degrees(self.state[1]), self.state[2])


class Differenced(Arm):
    def report(self):
        before = self.past[max(self.ticks - 1, 0)]
        return JointState(self.state[0], (self.state[0] - before[0]) / DT, self.state[2])


class AllDegrees(Arm):
    def __init__(self, robot):
        super().__init__(robot)
        self.start[0] /= 10.0  # within the limits either way

    def report(self):
        return JointState(*np.degrees(self.state))


class PositionDegrees(AllDegrees):
    def report(self):
        return JointState(np.degrees(self.state[0]), *self.state[1:])


class Simulated(Arm):
    """Obeys as a drive does: a second late, and never quite."""

    def take(self, action):
        self.follows = 0.9 * (self.follows if self.ticks > 1 else 0.0 * action) + 0.1 * action
        return self.follows


class Measured(Arm):
    def report(self):
        noise = np.random.default_rng(self.ticks).uniform(-1e-4, 1e-4, (3, 3)) * (self.ticks > 0)
        return JointState(*(self.state + noise))


MOTION = {
    Euler: ("euler", "integrated by Euler"),
    Symplectic: ("euler", "integrated by Euler"),
    SecondOrder: ("euler", "integrated by Euler"),
    Lags: ("lag", "lags by 3 ticks"),
    ActsLate: ("lag", "lags by 1 tick, or actions are applied 1 tick late"),
    Stale: ("stale", "of an earlier tick at 64 of 80 ticks, up to 4 ticks old"),
    Frozen: ("frozen", "never changes"),
    Float32State: ("float32", "has to be float64, got float32"),
    RoundedState: ("float32", "single precision"),
    RoundedActions: ("rounded", "rounded to float32"),
    RoundedJerks: ("rounded", "rounded to float32"),
    Scaled: ("scaled", "by a factor 0.97:"),
    ScaledJoint: ("scaled", "by a factor [1.  1.  1.1]"),
    Flipped: ("scaled", "by a factor -1 (the sign is flipped)"),
    Clipped: ("clipped", "clipped at 0.7:"),
    Repeated: ("repeated", "applied 2 times a step"),
    Biased: ("bias", "bias of 4e-06 rad/s² at C (5e-07 of its limit) a tick"),
    BiasedJerk: ("bias", "bias of"),
    Drifts: ("drift", "drifts off by 4e-06 rad/s² at A (5e-07 of its limit) a tick"),
    NoVelocity: ("velocity", "position and acceleration are right, velocity reads 0 throughout"),
    Degrees: ("velocity", "position and acceleration are right, velocity is 57.2958 times what it has to be (degrees?"),
    Differenced: ("velocity", "position and acceleration are right, velocity is not, by up to 0.0"),
    AllDegrees: ("scaled", "scene.robot is 57.2958 times what the actions make of it: degrees? radians are expected"),
    PositionDegrees: ("position", "position is 57.2958 times what it has to be (degrees? radians are expected)"),
    Measured: ("measured", "Report the commanded state, integrated exactly (Eq. 1), or allow for what was seen"),
    Simulated: ("motion", "rad/s² at C (0.2 of its limit), from tick 1 on"),
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", MOTION)
def test_a_wrong_motion_is_told_by_name(toy_robot, kind):
    name, words = MOTION[kind]
    messages = found(kind(toy_robot))
    assert set(messages) == {name}
    assert words in messages[name]
    with pytest.raises(InterfaceError, match=f"- {name} .error.: "):
        check_env(kind(toy_robot))


def noisy(position=0.0, velocity=0.0, acceleration=0.0, first=True, kind=float):
    """An arm whose sensors have errors up to so much; inf where there are none."""
    size = np.array([position, velocity, acceleration])[:, None]

    class Noisy(Arm):
        def report(self):
            noise = np.random.default_rng(self.ticks).uniform(-1.0, 1.0, (3, 3)) * (first or self.ticks > 0)
            noise = np.where(size < np.inf, np.where(size < np.inf, size, 0.0) * noise, np.nan)
            return JointState(*(self.state + noise).astype(kind))

    return Noisy


def advised(message: str) -> jssa_gym.FailsafeParams:
    """What a message says, as it stands."""
    return eval(message[message.index("FailsafeParams(") :], {"FailsafeParams": jssa_gym.FailsafeParams})


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("sizes", "tolerance", "words"),
    [
        ((1e-4, 0.0, 0.0), (0.0, 0.0, 0.0), ["position by up to ", " rad at "]),
        ((0.0, 2e-3, 0.0), (0.0, 0.0, 0.0), ["velocity by up to 0.00", " rad/s at "]),
        ((1e-4, 1e-3, 0.1), (0.0, 0.0, 0.0), ["position by", "velocity by", "acceleration by", " rad/s² at "]),
        ((1e-4, np.inf, np.inf), (0.0, np.inf, np.inf), ["position by"]),
        ((1e-4, 1e-3, np.inf), (1e-3, 0.0, np.inf), ["position by", "velocity by"]),
        ((1e-4, 1e-3, 6.0), (0.0, 0.0, 0.0), ["acceleration by up to ", 'float("inf")']),
    ],
)
def test_measured_states_are_told_what_tolerance_would_do(toy_robot, sizes, tolerance, words):
    for env in (noisy(*sizes)(toy_robot), noisy(*sizes, first=False)(toy_robot)):
        messages = found(env, params=jssa_gym.FailsafeParams(state_tolerance=tolerance))
        assert set(messages) == {"measured"}
        text = messages["measured"]
        for word in words:
            assert word in text
        assert text.count("by up to") == sum(0.0 < size < np.inf for size in sizes)
        # it can be pasted, and is no more than needed
        params = advised(text)
        report = check_env(env, params=params)
        assert [finding.severity for finding in report.findings] == ["warning"]
        for size, told in zip(sizes, params.state_tolerance, strict=True):
            assert told == np.inf if size > 1.0 else size <= told <= 5.0 * size


def test_the_joint_that_deviates_most_is_named(toy_robot):
    class One(Arm):
        def report(self):
            noise = np.random.default_rng(self.ticks).uniform(-1e-4, 1e-4)
            return JointState(self.state[0] + [0.0, noise, 0.0], *self.state[1:])

    assert " rad at B (" in found(One(toy_robot))["measured"]


def test_what_is_far_off_is_not_said_to_be_measured(toy_robot):
    assert set(found(noisy(0.2, 0.0, 0.0, first=False)(toy_robot))) == {"position"}


def test_single_precision_is_not_blamed_for_noise(toy_robot):
    messages = found(noisy(1e-4, 1e-3, 0.1, kind=np.float32)(toy_robot))
    assert set(messages) == {"float32", "measured"}


def test_what_is_not_measured_is_not_said_to_be_wrong(toy_robot):
    class Zeros(Arm):
        """Integrates its positions by Euler, and has no tachometer."""

        move = Symplectic.move

        def report(self):
            return JointState(self.state[0], np.zeros(3), np.zeros(3))

    assumed = jssa_gym.FailsafeParams(state_tolerance=(1e-9, np.inf, np.inf))
    assert set(found(Zeros(toy_robot), params=assumed)) == {"euler"}

    class Hangs(Arm):
        def report(self):
            return JointState(self.start[0].copy(), np.full(3, 0.1 * self.ticks), np.full(3, np.nan))

    assert set(found(Hangs(toy_robot), params=assumed)) == {"frozen"}

    class Off(Zeros):
        def report(self):
            return JointState(self.state[0] + 1e-3 * (self.ticks > 9), np.zeros(3), np.zeros(3))

    messages = found(Off(toy_robot), params=assumed)
    assert set(messages) == {"motion"}
    assert " rad at " in messages["motion"]
    assert "rad/s" not in messages["motion"]


def test_measured_states_are_no_error_within_the_tolerance(toy_robot):
    for kind, tolerance in (
        (noisy(1e-4, 1e-4, 1e-4), (3e-4, 1e-3, 1e-3)),
        (noisy(1e-4, np.inf, np.inf, kind=np.float32), (3e-4, np.inf, np.inf)),
    ):
        report = check_env(kind(toy_robot), params=jssa_gym.FailsafeParams(state_tolerance=tolerance))
        assert [(finding.name, finding.severity) for finding in report.findings] == [("measured", "warning")]
        assert "within state_tolerance" in str(report)
        assert "FailsafeParams(" not in str(report)
        with pytest.raises(InterfaceError):
            check_env(kind(toy_robot))
        # a tolerance forgives no more than itself
        small = jssa_gym.FailsafeParams(state_tolerance=(5e-5, *tolerance[1:]))
        with pytest.raises(InterfaceError):
            check_env(kind(toy_robot), params=small)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "faults", ["joint glitch", "lasting joint glitch", "stale joints", "drift", "rare joint faults"]
)
def test_what_is_wrong_now_and_then_is_not_said_to_be_measured(faults):
    env = jssa_gym.SensorModel(gym.make("jssa_gym/Home-v0", human="none"), faults)
    assert "measured" not in found(env)
    assert "measured" in found(jssa_gym.SensorModel(env.env, "noisy joints"))


def test_wrappers_that_change_actions_are_found():
    inner = gym.make("jssa_gym/Home-v0", human="none")
    for wrapped, name in (
        (gym.wrappers.TransformAction(inner, lambda a: -a, inner.action_space), "scaled"),
        (gym.wrappers.RepeatAction(inner, 3), "repeated"),
        (gym.wrappers.StickyAction(inner, 0.3), "motion"),
    ):
        assert name in found(wrapped)


# ---- scenes --------------------------------------------------------------------------------------------


def changing(change):
    """An arm whose scenes are changed by a function of scene and tick."""

    class Changed(Arm):
        scene = property(lambda self: change(Arm.scene.fget(self), self.ticks))

    return Changed


def people(**values):
    return lambda scene, k: scene._replace(human=scene.human._replace(**values))


def with_planes(**values):
    return lambda scene, k: scene._replace(planes=scene.planes._replace(**values))


def gone(scene, k):
    empty = Planes(np.zeros((0, 3)), np.zeros(0), ())
    return scene._replace(planes=empty) if k > 10 else scene


def moved(speed=1.0, velocity=1.0):
    """People who come at other speeds, and say so or not."""

    def change(scene, k):
        human = scene.human
        shift = (speed - 1.0) * human.start_velocity * scene.time
        told = velocity * human.start_velocity
        human = human._replace(start=human.start + shift, end=human.end + shift, start_velocity=told, end_velocity=told)
        return scene._replace(human=human)

    return change


def jumped(scene, k):
    return people(start=scene.human.start + 0.3 * (k >= 30))(scene, k)


def grown(scene, k):
    return people(radius=scene.human.radius + 0.1 * (k >= 30))(scene, k)


def late_start(scene, k):
    return scene._replace(human=scene.human._replace(names=("hand", "head" if k < 7 else "torso")))


def hung(first=0, last=1000, every=1000):
    """People who are those of an earlier tick for a while, as if measured anew."""

    def change(scene, k):
        seen = first + (k - first) // every * every if first <= k <= last else k
        back = scene.human.start_velocity * (k - seen) * DT
        # to the bit
        return people(start=np.round(scene.human.start - back, 9), end=np.round(scene.human.end - back, 9))(scene, k)

    return change


def trembling(scene, k):
    human = hung()(scene, k).human
    return people(start=human.start + 1e-6 * (k % 2), end=human.end)(scene, k)


ODD = np.array([0.1, 0.1])

SCENES = {
    "clock stands still": (lambda s, k: s._replace(time=0.0), {"time": "scene.time stands still"}),
    "clock too fast": (lambda s, k: s._replace(time=2.0 * s.time), {"time": "advances by 0.04 s", "velocities": ""}),
    "clock stumbles": (
        lambda s, k: s._replace(time=s.time - DT * (k == 9)),
        {"time": "advances by 0 s from tick 8 to the next"},
    ),
    "clock is NaN": (lambda s, k: s._replace(time=np.nan), {"time": "a finite number of seconds, got nan"}),
    "clock is text": (lambda s, k: s._replace(time="now"), {"time": "a finite number of seconds, got 'now'"}),
    "no scene": (lambda s, k: None, {"scene": "all its fields: 'NoneType'"}),
    "list": (people(radius=[0.1, 0.1]), {"fields": "radius has to be a numpy array, got list"}),
    "shape": (people(start=np.zeros((2, 2))), {"fields": "start has to have the shape (2, 3), got (2, 2)"}),
    "one too few": (people(radius=np.array([0.1])), {"fields": "radius has to have the shape (2,), got (1,)"}),
    "integers": (people(start=np.zeros((2, 3), int)), {"fields": "start has to be float64, got int64"}),
    "valid of numbers": (lambda s, k: s._replace(valid=np.ones(2)), {"fields": "valid has to be of bool, got float64"}),
    "not finite": (people(end=np.full((2, 3), np.nan)), {"fields": "end has to be finite where valid"}),
    "joints of another number": (
        lambda s, k: s._replace(robot=s.robot._replace(velocity=np.zeros(2))),
        {"fields": "robot.velocity has to have the shape (3,), got (2,)"},
    ),
    "joints not finite": (
        lambda s, k: s._replace(robot=s.robot._replace(velocity=np.full(3, np.inf))),
        {"fields": "robot.velocity has to be finite"},
    ),
    "masked people": (
        lambda s, k: people(start=np.ma.masked_array(s.human.start, np.zeros((2, 3), bool)))(s, k),
        {"masked": "scene.human.start is a masked array"},
    ),
    "masked joints": (
        lambda s, k: s._replace(robot=s.robot._replace(velocity=np.ma.masked_array(s.robot.velocity))),
        {"masked": "scene.robot.velocity is a masked array"},
    ),
    "single precision": (
        lambda s, k: people(start_velocity=s.human.start_velocity.astype(np.float32))(s, k),
        {"precision": "belongs into position_error"},
    ),
    "negative age": (lambda s, k: s._replace(age=-ODD), {"age": "finite and at least 0; got [-0.1 -0.1]"}),
    "endless age": (lambda s, k: s._replace(age=np.full(2, np.inf)), {"age": "finite"}),
    "not measured": (lambda s, k: s._replace(valid=np.array([True, False])), {"valid": "not measured"}),
    "radius 0": (people(radius=np.array([0.1, 0.0])), {"radius": "above 0, got [0.1 0. ]"}),
    "long normal": (with_planes(normal=np.array([[0.0, 0.0, 2.0]])), {"planes": "unit vectors out of the solid"}),
    "planes vanish": (gone, {"constant": "scene.planes.offset has to stay as it was at reset, it changes at tick 11"}),
    "a plane moves": (
        lambda s, k: with_planes(offset=np.array([0.01 * k]))(s, k),
        {"constant": "scene.planes.offset has to stay as it was at reset, it changes at tick 1"},
    ),
    "names change": (
        late_start,
        {"constant": "scene.human.names has to stay as it was at reset, it changes at tick 7"},
    ),
    "numbers for names": (people(names=(1, 2)), {"names": "a string a member, got (1, 2)"}),
    "unknown name": (people(names=("hand", "tail")), {"names": "'tail': no body part that is known by name"}),
    "same name": (people(names=("hand", "hand")), {"names": "'hand': a person has several capsules of that name"}),
    "too fast": (
        moved(5.0, 5.0),
        {"speed": "hand moves at 2.5 m/s, first from tick 0 to the next; its bound is 2 m/s"},
    ),
    "jumps": (jumped, {"speed": "from tick 29 to the next"}),
    "swells": (grown, {"speed": "from tick 29 to the next"}),
    "no velocities": (moved(velocity=0.0), {"velocities": "hand moves and has a velocity of 0"}),
    "hanging people": (hung(), {"frozen": "hand said to move, at up to 0.5 m/s, and the same again at 80 of 80 ticks"}),
    "people who hang for a while": (hung(30, 40), {"frozen": "at 10 of 80 ticks, first from tick 30 to the next"}),
    "a camera that is slow and does not say so": (hung(every=5), {"frozen": "at 64 of 80 ticks"}),
    "people who hang but for noise": (trembling, {"velocities": "is said to by [-0.5, 0.0, 0.0]"}),
    "old measurements": (
        lambda s, k: s._replace(age=0.25 + 0.0 * ODD),
        {"age": "older than max_age, 0.2 s, at 81 of 81 ticks, up to 0.25 s: the shield stands still; "},
    ),
    "reversed velocities": (
        moved(velocity=-1.0),
        {"velocities": "moves by [-0.5, 0.0, 0.0] m/s and is said to by [0.5, "},
    ),
    "velocities in mm/s": (moved(velocity=1e3), {"velocities": "is said to by [-500.0, 0.0, 0.0]"}),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("what", SCENES)
def test_a_wrong_scene_is_told_by_name(toy_robot, what):
    change, expected = SCENES[what]
    messages = found(changing(change)(toy_robot))
    assert set(messages) == set(expected)
    for name, words in expected.items():
        assert words in messages[name]


def test_people_who_are_known_to_be_fast_are_no_mistake(toy_robot):
    fast = changing(moved(5.0, 5.0))(toy_robot)
    assert found(fast, params=jssa_gym.FailsafeParams(limb_speed=3.0)) == {}


def test_people_whose_age_tells_that_they_hang_are_no_mistake(toy_robot):
    for every in (5, 10):

        def late(scene, k, every=every):
            return hung(every=every)(scene, k)._replace(age=np.full(2, k % every * DT))

        assert found(changing(late)(toy_robot)) == {}
    # a whole second: older than max_age now and then
    report = check_env(changing(lambda s, k: hung(every=18)(s, k)._replace(age=np.full(2, k % 18 * DT)))(toy_robot))
    assert [(finding.name, finding.severity) for finding in report.findings] == [("age", "warning")]
    assert "at 28 of 81 ticks, up to 0.34 s: the shield stands still meanwhile" in str(report)
    patient = jssa_gym.FailsafeParams(max_age=0.4)
    assert found(changing(lambda s, k: s._replace(age=0.25 + 0.0 * ODD))(toy_robot), params=patient) == {}


def test_arm_and_people_who_hang_are_both_told(toy_robot):
    class Still(changing(hung())):
        def report(self):
            return JointState(*self.start.copy())

    messages = check_env(Still(toy_robot), raise_on_error=False)
    assert ["never changes" in f.message for f in messages.findings if f.name == "frozen"] == [False, True]


@pytest.mark.parametrize(("faults", "expected"), [("silent freeze", "frozen"), ("freeze", "age")])
def test_a_sensor_that_freezes_is_told(faults, expected):
    env = jssa_gym.SensorModel(gym.make("jssa_gym/Home-v0", human="walk_by"), faults)
    assert set(found(env, ticks=400)) == {expected}


def test_warnings_are_no_errors(toy_robot):
    report = check_env(changing(people(names=("hand", "tail")))(toy_robot))
    assert [finding.severity for finding in report.findings] == ["warning"]
    assert (report.errors, report.warnings) == ((), report.findings)


# ---- reset, randomness, interface ----------------------------------------------------------------------


def test_an_arm_in_motion_or_beyond_its_limits_is_told(toy_robot):
    env = Arm(toy_robot)
    env.start[1, 0] = 0.1
    assert "it moves at 0.1 rad/s at A (0.05 of its limit)" in found(env)["reset"]
    env = Arm(toy_robot)
    env.start[0, 2] = 3.5
    low, high = toy_robot.limits.position[2]
    text = f"inside its position limits after reset: C is at 3.5 rad, its limits are {low:.4g} to {high:.4g} rad"
    assert text in found(env)["reset"]


class Leftover(Arm):
    """Goes on from where the last episode ended."""

    def reset(self, **arguments):
        before = getattr(self, "state", self.start)
        result = super().reset(**arguments)
        self.state = before
        return result


def test_what_is_left_of_the_last_episode_is_told(toy_robot):
    messages = found(Leftover(toy_robot), ticks=10)
    assert "after reset the second time, it moves" in messages["reset"]
    assert "begins where the last episode ended: with the same seed" in messages["reset"]
    assert "robot.position is another one at tick 0" in messages["random"]


class Stays(Arm):
    """Stops and stays where it is at the end of an episode."""

    def reset(self, **arguments):
        before = getattr(self, "state", self.start)
        result = super().reset(**arguments)
        self.state[0] = before[0]
        self.past = [self.state.copy()]
        return result


class BeginsAnywhere(Arm):
    def reset(self, **arguments):
        self.start[0] += 0.01
        return super().reset(**arguments)


def test_an_arm_that_stays_where_the_last_episode_ended_is_told(toy_robot):
    report = check_env(Stays(toy_robot), raise_on_error=False)
    assert [(one.name, one.severity) for one in report.findings] == [("reset", "error"), ("random", "warning")]
    assert "begins where the last episode ended: with the same seed" in report.errors[0].message
    # chance is no mistake that a shield minds
    assert set(found(BeginsAnywhere(toy_robot))) == {"random"}


class Random(Arm):
    def people(self):
        people = super().people()
        return people._replace(start=people.start + np.random.default_rng().uniform(0.0, 1e-9))


class EndsByChance(Arm):
    """Each episode a tick earlier than the last."""

    longest = 40

    def reset(self, **arguments):
        self.longest -= 1
        return super().reset(**arguments)

    def step(self, action):
        seen, reward, *_ = super().step(action)
        return seen, reward, self.ticks == self.longest, False, {}


class RandomReward(Arm):
    def step(self, action):
        seen, _, *rest = super().step(action)
        return seen, float(np.random.default_rng().random()), *rest


def test_chance_that_no_seed_governs_is_told(toy_robot):
    messages = found(Random(toy_robot))
    assert "human.start is another one at tick 0 the second time" in messages["random"]
    assert "human.start was another one when tick 0's scene was read again" in messages["reread"]
    assert set(messages) == {"random", "reread"}
    assert "observation or reward is another one at tick 1" in found(RandomReward(toy_robot))["random"]
    assert "ends at another tick the second time" in found(EndsByChance(toy_robot))["random"]


class Ends(Arm):
    def step(self, action):
        seen, reward, *_ = super().step(action)
        return seen, reward, self.ticks == 4, False, {}


class Raises(Arm):
    def step(self, action):
        if self.ticks == 5:
            raise ConnectionError("cable")
        return super().step(action)


class RaisesAtReset(Arm):
    def reset(self, **arguments):
        raise ConnectionError("cable")


def test_an_episode_that_ends_or_breaks_is_told(toy_robot):
    assert found(Ends(toy_robot)) == {"short": "the episode ended after 4 steps: too early to see much"}
    assert found(Raises(toy_robot)) == {"raises": "step 6 raised ConnectionError: cable"}
    assert found(RaisesAtReset(toy_robot)) == {"raises": "reset raised ConnectionError: cable"}


class Bare(gym.Env):
    action_space = gym.spaces.Box(-2.0, 2.0, (3,))
    observation_space = gym.spaces.Box(-1.0, 1.0, (1,))

    def reset(self, *, seed=None, options=None):
        return np.zeros(1), {}


def test_an_interface_that_is_not_there_is_told_all_at_once(toy_robot):
    env = Bare()
    assert set(found(env)) == {"robot", "dt", "action_space", "scene"}
    env.robot, env.dt, env.scene = "lr_mate", -0.1, None
    assert "got str" in found(env)["robot"]
    assert "got -0.1" in found(env)["dt"]
    env.robot, env.dt, env.action_space = toy_robot, DT, gym.spaces.Box(-1.0, 1.0, (4,))
    assert set(found(env)) == {"action_space"}
    assert "Box(-1, 1, (3,))" in found(env)["action_space"]
    env = Arm(toy_robot)
    env.action_space = gym.spaces.Discrete(3)
    assert set(found(env)) == {"action_space"}
    env = Bare()
    env.reset = None
    assert set(found(env)) == {"robot", "dt", "action_space", "raises"}
    with pytest.raises(InterfaceError) as caught:
        check_env(Bare())
    for name in ("robot", "dt", "action_space", "scene"):
        assert f"- {name} (error): " in str(caught.value)


def test_a_shield_inside_is_told():
    assert set(found(gym.make("jssa_gym/HomeShielded-v0"))) == {"shield"}


def test_it_may_be_wrapped(toy_robot):
    assert found(gym.wrappers.TimeLimit(gym.wrappers.OrderEnforcing(Arm(toy_robot)), 1000)) == {}


@pytest.mark.parametrize(
    "arguments", [{"ticks": 7}, {"ticks": "many"}, {"seed": -1}, {"params": {"limb_speed": 2.0}}], ids=str
)
def test_bad_arguments_are_named(toy_robot, arguments):
    with pytest.raises(ParameterError, match=next(iter(arguments))):
        check_env(Arm(toy_robot), **arguments)
    with pytest.raises(ParameterError, match=r"gymnasium\.Env"):
        check_env("jssa_gym/Home-v0")


def test_the_table_lists_every_name():
    table = (check_env.__doc__ or "").partition("Args:")[0]
    names = {name for name, _ in MOTION.values()} | {name for _, expected in SCENES.values() for name in expected}
    for name in (
        *names,
        "robot",
        "dt",
        "scene",
        "action_space",
        "shield",
        "raises",
        "reset",
        "reread",
        "random",
        "short",
    ):
        assert f"``{name}``" in table
