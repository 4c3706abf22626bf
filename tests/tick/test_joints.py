"""Joint readings: which ones a shield believes, what it does with the others, and how far off a believed one can be."""

import logging

import gymnasium as gym
import numpy as np
import pytest
import reference as ref
from monitors import JointMonitor, stored, watch
from strollers import ball

from jssa_gym.envs import ArmEnv
from jssa_gym.exceptions import InvalidActionError, ParameterError
from jssa_gym.humans import nobody, together
from jssa_gym.kernels.motion import violates
from jssa_gym.policies import BangBangPolicy
from jssa_gym.safety.failsafe import FailsafeParams, levers
from jssa_gym.shields import FILTERS, JSSAShield, SafetyFilter, Shield, make_filter
from jssa_gym.tick import loop
from jssa_gym.tick.joints import AGREEMENTS
from jssa_gym.types import JointState, Planes, Scene, Status

DT = 0.008
NAN = np.full(6, np.nan)


class Reading(gym.Wrapper):
    """Shows a shield what ``told`` makes of the scenes of an episode, the newest last."""

    def __init__(self, env, told):
        super().__init__(env)
        self.told, self.scenes, self.scene = told, [], None

    def reset(self, **kwargs):
        result = self.env.reset(**kwargs)
        self.scenes = [self.env.unwrapped.scene]
        self.scene = self.scenes[0]
        return result

    def step(self, action):
        result = self.env.step(action)
        self.scenes.append(self.env.unwrapped.scene)
        self.scene = self.told(self.scenes)
        return result


def joints(scene: Scene, **changes) -> Scene:
    return scene._replace(robot=scene.robot._replace(**changes))


def frozen(start, ticks, parts=None):
    """A whole scene that is delivered again, or some parts of it."""

    def told(scenes):
        k = len(scenes) - 1
        if not start < k <= start + ticks:
            return scenes[-1]
        old = scenes[start]
        return old if parts is None else scenes[-1]._replace(**{part: getattr(old, part) for part in parts})

    return told


def lagging(ticks, parts=None):
    def told(scenes):
        old = scenes[max(len(scenes) - 1 - ticks, 0)]
        return old if parts is None else scenes[-1]._replace(**{part: getattr(old, part) for part in parts})

    return told


def wrong(change, share=1.0):
    """Readings that are false from 0.5 s on, always or by chance."""
    rng = np.random.default_rng(5)

    def told(scenes):
        late = len(scenes) > 62 and rng.random() < share
        return joints(scenes[-1], **change(scenes[-1].robot)) if late else scenes[-1]

    return told


LIES = {
    "at rest": lambda robot: {"velocity": np.zeros(6), "acceleration": np.zeros(6)},
    "accelerating backwards": lambda robot: {"acceleration": -ACCELERATION},
    "absurdly fast": lambda robot: {"velocity": np.full(6, 1e308)},
    "a radian off": lambda robot: {"position": robot.position + 1.0},
    "a little off": lambda robot: {"velocity": robot.velocity + 1e-5},
    "single precision": lambda robot: {"position": robot.position.astype(np.float32)},
    "masked": lambda robot: {"position": np.ma.masked_array(robot.position, [0, 0, 1, 0, 0, 0])},
}
ACCELERATION = np.radians([641.0, 576.0, 592.0, 1184.0, 1184.0, 1809.0])

HANGS = {
    **{f"the scene for {ticks} ticks": frozen(62, ticks) for ticks in (1, 5, 20, 10_000)},
    **{f"the joints for {ticks} ticks": frozen(62, ticks, ("robot",)) for ticks in (1, 5, 20, 10_000)},
    "the people": frozen(62, 40, ("human", "age", "valid")),
    "joints and clock": frozen(62, 20, ("robot", "time")),
    "the scene, late by 1": lagging(1),
    "the scene, late by 3": lagging(3),
    "the joints, late by 2": lagging(2, ("robot",)),
    **{f"false: {name}": wrong(lie) for name, lie in LIES.items()},
    **{f"false by chance: {name}": wrong(lie, 0.02) for name, lie in LIES.items()},
}
"""What field reports named, and their kin."""


def drive(told, name="jssa", human="pursuit", seed=0, steps=500, params=None, wrap=None):
    """Bang-bang under a shield that is told something; statuses, reasons, truth after each step."""
    base = ArmEnv("home", human=human, terminate_on=())
    env = Reading(base, told)
    env = wrap(env) if wrap else env
    failsafe = params or FailsafeParams()
    shield = Shield(env, make_filter(name, base.robot, DT, viability=True, failsafe=failsafe))
    shield.reset(seed=seed)
    policy = BangBangPolicy(base, seed)
    limits = base.robot.limits
    bounds = np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])
    seen = []
    for _ in range(steps):
        *_, info = shield.step(policy(None))
        robot = base.scene.robot
        state = np.array([robot.position, robot.velocity, robot.acceleration])
        seen.append((info["shield/status"], info["shield/reason"], info["contact_speed"], np.abs(state[1]).max(),
                     violates(state, info["jerk"], bounds, 1e-9)))  # fmt: skip
    return seen, shield


@pytest.mark.long
@pytest.mark.parametrize("name", ["jssa", "stop"])
@pytest.mark.parametrize("what", HANGS)
def test_no_reading_moves_the_arm_into_anybody(what, name, caplog):
    """The arm obeys exactly; whatever its sensors say, only what is verified from where it is moves it."""
    statuses = []
    for human, seed in (("pursuit", 0), ("hand", 1), ("walk_by", 2)):
        seen, _ = drive(HANGS[what], name, human, seed)
        assert max(speed for _, _, speed, _, _ in seen) < 1e-3
        assert not any(beyond for *_, beyond in seen)
        # the arm would have moved: a test of an arm at rest shows nothing
        assert max(fastest for *_, fastest, _ in seen[:62]) > 0.1 or "late by" in what
        statuses += [status for status, *_ in seen]
    assert Status.FAULT in statuses or what == "the people"


HURTS = [
    *("the scene for 20 ticks", "the scene for 10000 ticks", "the joints for 20 ticks", "the joints for 10000 ticks"),
    *("joints and clock", "the scene, late by 1", "the scene, late by 3", "false: at rest", "false: a radian off"),
    *("false: accelerating backwards", "false: absurdly fast", "false by chance: accelerating backwards"),
]
"""What hurts somebody within a few episodes, or drives the arm over a limit, where it is believed."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize("what", HURTS)
def test_a_shield_without_a_monitor_is_led_astray(what, monkeypatch, caplog):
    """The power of the test above: a shield that believes every reading is not safe."""
    monkeypatch.setattr("jssa_gym.shields.baselines.StopFilter.decide", _believe)
    for human, seed in (("pursuit", 0), ("hand", 1), ("walk_by", 2), ("pursuit", 3), ("pursuit", 4), ("hand", 5)):
        seen, _ = drive(HANGS[what], "stop", human, seed)
        if max(speed for _, _, speed, _, _ in seen) > 1e-3 or any(beyond for *_, beyond in seen):
            return
    pytest.fail("nobody was hurt: the readings are too harmless to test anything")


def _believe(filter, scene, nominal):
    """What a naive stop does: a plan from any finite reading that is not quite where it was expected."""
    state = np.array([np.asarray(rows, float) for rows in scene.robot])
    elsewhere = np.abs(state - filter.expected).max() > 1e-6
    filter.expected[:] = state
    if elsewhere:
        loop.rebase(filter.records.view.arms)
    return SafetyFilter.decide(filter, scene, nominal)


def test_trust_returns_only_after_several_readings_that_agree():
    seen, _ = drive(HANGS["the joints for 20 ticks"], "stop", "none")
    statuses = np.array([status for status, *_ in seen])
    faults = np.flatnonzero(statuses == Status.FAULT)
    # the reading of tick 62 is that of the decision before the next step
    assert faults[0] == 63
    assert faults[-1] == 82 + AGREEMENTS - 1
    assert len(faults) == 20 + AGREEMENTS - 1
    assert "frozen" in seen[faults[0]][1]
    assert "not for long enough" in seen[faults[-1]][1]
    assert (statuses[faults[-1] + 1 :] != Status.FAULT).all()


def test_nothing_is_lost_by_readings_that_are_missing():
    """Nothing false was said: the next reading that agrees is believed."""
    missing = lambda scenes: joints(scenes[-1], velocity=NAN) if 62 < len(scenes) < 72 else scenes[-1]  # noqa: E731
    seen, _ = drive(missing, "stop", "none")
    faults = [k for k, (status, *_) in enumerate(seen) if status == Status.FAULT]
    assert faults == list(range(62, 71))


@pytest.mark.parametrize("ticks", [1, 3])
def test_a_scene_that_lags_is_said_to_and_stops_the_arm_for_good(ticks):
    seen, shield = drive(lagging(ticks), "stop", "none", steps=300)
    word = f"lags by {ticks} tick"
    assert sum(word in reason for _, reason, *_ in seen) > 200
    assert all(status == Status.FAULT and word in reason for status, reason, *_ in seen[-150:])
    assert max(fastest for *_, fastest, _ in seen[-100:]) < 1e-9
    # until the next episode
    shield.unwrapped.human, shield.env.told = shield.unwrapped.human, lambda scenes: scenes[-1]
    shield.reset(seed=1)
    assert all(shield.step(np.full(6, 0.1))[4]["shield/status"] == Status.NOMINAL for _ in range(20))


def test_a_lag_that_ends_is_forgiven():
    told = lambda scenes: scenes[-3] if 62 < len(scenes) < 90 else scenes[-1]  # noqa: E731
    seen, _ = drive(told, "stop", "none")
    assert any("lags by 2 ticks" in reason for _, reason, *_ in seen)
    assert all(status != Status.FAULT for status, *_ in seen[90 + AGREEMENTS :])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", [name for name in FILTERS if name != "none"])
def test_a_lasting_disagreement_keeps_the_arm_at_rest_whatever_filter_is_inside(name):
    def off(scenes):
        scene = scenes[-1]
        return joints(scene, position=scene.robot.position + 1.0) if len(scenes) > 40 else scene

    seen, _ = drive(off, name, "none", steps=400)
    assert all(status == Status.FAULT for status, *_ in seen[41:])
    assert max(fastest for *_, fastest, _ in seen[200:]) < 1e-9


# ---- own environments that do not integrate what they are told ---------------------------------------------


class Own:
    """An arm of a user's own: ``integrate`` says where a jerk leads, ``show`` what is read of it."""

    def __init__(self, robot, make_scene, integrate, show=None, params=None):
        self.robot, self.make_scene, self.integrate = robot, make_scene, integrate
        self.show = show or (lambda state: state)
        self.filter = make_filter("stop", robot, DT, failsafe=params or FailsafeParams())
        self.state = np.array([robot.home, np.zeros(6), np.zeros(6)])
        self.time = 0.0
        self.filter.reset(self.scene())

    def scene(self):
        shown = self.show(self.state.copy())
        return self.make_scene(self.state, time=self.time)._replace(robot=JointState(*shown))

    def step(self, nominal):
        decision = self.filter.decide(self.scene(), nominal)
        self.state = self.integrate(self.state, decision.jerk)
        self.time += DT
        return decision


def exact(state, jerk):
    return np.array(ref.triple_integrator(*state, jerk, DT))


def euler(state, jerk):
    q, v, a = state
    return np.array([q + DT * v, v + DT * a, a + DT * jerk])


def biased(state, jerk):
    q, v, a = exact(state, jerk)
    return np.array([q, v, a + 5e-7 * ACCELERATION])


def single(state, jerk):
    return exact(state, jerk.astype(np.float32).astype(float))


def nudged(state, jerk):
    return exact(state, 1.01 * jerk)


@pytest.mark.parametrize("integrate", [euler, biased, nudged])
def test_an_arm_that_goes_its_own_way_is_seen_however_slowly(robot, make_scene, integrate, caplog):
    own = Own(robot, make_scene, integrate)
    rng, statuses = np.random.default_rng(0), []
    for k in range(400):
        if k % 15 == 0:
            nominal = rng.choice([-0.5, 0.5], 6) * robot.limits.jerk
        statuses.append(own.step(nominal).status)
    assert Status.FAULT in statuses[:20]
    # an Euler step ends where an exact one does once the arm rests, and is believed again, ever more rarely
    believed = sum(status != Status.FAULT for status in statuses[60:])
    assert believed == 0 or (integrate is euler and believed < 6)
    # it brakes what it can brake: its own jerks end, and that is all that it sends
    assert integrate is euler or not np.any(own.step(nominal).jerk)
    # a slow drift never comes to rest, and no jerk of the shield's can bring it there
    assert integrate is biased or np.abs(own.state[1]).max() < 0.05
    told = [record for record in caplog.records if "something else moves it" in record.message]
    assert len(told) == 1
    assert told[0].levelno >= logging.WARNING
    assert "check_env" in told[0].message


def test_rounding_to_single_precision_is_no_rounding(robot, make_scene, caplog):
    def run(own):
        rng, statuses = np.random.default_rng(0), []
        for k in range(400):
            if k % 15 == 0:
                # an irrational share, so that its rounding shows
                nominal = rng.uniform(-0.7, 0.7, 6) * robot.limits.jerk
            statuses.append(own.step(nominal).status)
        return statuses

    assert Status.FAULT in run(Own(robot, make_scene, single))
    read = run(Own(robot, make_scene, exact, lambda state: state.astype(np.float32)))
    assert all(status == Status.FAULT for status in read)
    # both are fine where they are within what is stated
    allowed = FailsafeParams(state_tolerance=(1e-5, 1e-4, 1e-3))
    for integrate, show in ((single, None), (exact, lambda state: state.astype(np.float32))):
        assert Status.FAULT not in run(Own(robot, make_scene, integrate, show, allowed))


# ---- measured states ----------------------------------------------------------------------------------------


def noisy(rng, tolerance):
    return lambda state: state + rng.uniform(-1.0, 1.0, (3, 6)) * np.array(tolerance)[:, None]


def test_measured_states_can_be_fed_within_their_tolerance(robot, make_scene, caplog):
    noise = (1e-4, 1e-3, 0.1)
    rng = np.random.default_rng(0)
    for params, trusted in (
        (FailsafeParams(), False),
        # twice the noise, since an episode begins where it was read for the first time
        (FailsafeParams(state_tolerance=(2e-4, 1e-3, 0.1)), True),
        (FailsafeParams(state_tolerance=(2e-4, np.inf, np.inf)), True),
        (FailsafeParams(state_tolerance=(5e-5, 1e-3, 0.1)), False),
    ):
        own = Own(robot, make_scene, exact, noisy(np.random.default_rng(1), noise), params)
        for k in range(300):
            if k % 20 == 0:
                nominal = rng.choice([-0.5, 0.5], 6) * robot.limits.jerk
            decision = own.step(nominal)
            if trusted:
                assert decision.status != Status.FAULT, decision.reason
        assert trusted == (decision.status != Status.FAULT)
        # what is planned from is not the noise: after the first reading it is reckoned
        off = np.abs(own.filter.expected - own.state).max(axis=1)
        assert not trusted or (off[0] <= noise[0] and off[1:].max() < 1e-9)


def test_what_is_not_measured_may_be_anything(robot, make_scene):
    params = FailsafeParams(state_tolerance=(1e-6, np.inf, np.inf))

    def show(state):
        return np.array([state[0], NAN, np.full(6, np.inf)])

    own = Own(robot, make_scene, exact, show, params)
    for _ in range(100):
        assert own.step(0.2 * robot.limits.jerk).status != Status.FAULT
    own.state[0, 2] += 1e-5
    assert own.step(0.2 * robot.limits.jerk).status == Status.FAULT


def test_an_encoder_that_repeats_itself_while_the_arm_creeps_is_not_frozen(robot, make_scene):
    step = 1e-4
    params = FailsafeParams(state_tolerance=(step, np.inf, np.inf))
    own = Own(robot, make_scene, exact, lambda state: np.array([np.round(state[0] / step) * step, *state[1:]]), params)
    own.filter.reset(own.scene())
    nominal = np.zeros(6)
    for k in range(300):
        nominal[0] = 0.02 * robot.limits.jerk[0] if k < 3 else -0.02 * robot.limits.jerk[0] if k < 6 else 0.0
        assert own.step(nominal).status != Status.FAULT
    assert own.state[0, 0] > 1e-3


@pytest.mark.long
def test_the_tolerance_is_kept_from_people_as_metres(robot, make_scene):
    """Largest lever times tolerance, from people and twice between the arm's own links; checked by kinematics."""
    tolerance = np.radians([0.1, 0.05, 0.2, 0.3, 0.1, 0.4])
    params = FailsafeParams(state_tolerance=(tuple(tolerance), 0.0, 0.0), tracking_error=0.01)
    metres = params.displacement(robot)
    assert metres == pytest.approx(0.01 + (levers(robot) @ tolerance).max())
    chain = [ref.lr_mate_chain()[0]._replace(offset=np.array([0.0, 0.0, 1.2])), *ref.lr_mate_chain()[1:]]
    rng, farthest = np.random.default_rng(0), 0.0
    for _ in range(300):
        q = rng.uniform(*robot.limits.position.T)
        off = tolerance * rng.choice([-1.0, 1.0], 6)
        for _, link, start, end, _ in ref.LR_MATE_CAPSULES:
            for point in (start, end):
                moved = ref.point(chain, q + off, link, point) - ref.point(chain, q, link, point)
                farthest = max(farthest, float(np.linalg.norm(moved)))
    assert 0.3 * (metres - 0.01) < farthest <= metres - 0.01


def test_a_tolerance_moves_the_edge_of_what_is_allowed_by_its_metres(robot, make_scene):
    """A person at whom a stop is just verified without a tolerance is too near with one."""

    def allowed(distance, params):
        own = Own(robot, make_scene, exact, None, params)
        own.scene = lambda: make_scene(own.state, ball([distance, 0.0, 1.2], 0.1), time=own.time)
        own.filter.reset(own.scene())
        return own.step(np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.0]) * robot.limits.jerk).status == Status.NOMINAL

    def edge(params):
        low, high = 0.1, 3.0
        for _ in range(40):
            middle = (low + high) / 2.0
            low, high = (low, middle) if allowed(middle, params) else (middle, high)
        return high

    params = FailsafeParams(state_tolerance=(0.01, 0.1, 1.0))
    assert edge(params) - edge(FailsafeParams()) == pytest.approx(params.displacement(robot), rel=0.1)


@pytest.mark.parametrize(
    "value",
    [0.0, (0.0, 0.0), (0.0, 0.0, -1.0), (np.inf, 0.0, 0.0), (np.nan, 0.0, 0.0), ("a", 0.0, 0.0), (0.0, [[1.0]], 0.0),
     (0.0, [], 0.0), None, "none"],
)  # fmt: skip
def test_a_tolerance_that_is_none_is_refused(value):
    with pytest.raises(ParameterError, match="state_tolerance has to be"):
        FailsafeParams(state_tolerance=value)


def test_a_tolerance_for_other_joints_is_refused(robot):
    params = FailsafeParams(state_tolerance=([1e-3] * 5, 0.0, 0.0))
    with pytest.raises(ParameterError, match="5 numbers for position, the robot 6"):
        make_filter("stop", robot, DT, failsafe=params)


def test_a_tolerance_survives_json():
    env = gym.make("jssa_gym/Home-v0")
    params = FailsafeParams(state_tolerance=((1e-3,) * 6, 0.1, np.inf))
    spec = JSSAShield(env, failsafe=params).spec
    again = gym.make(gym.envs.registration.EnvSpec.from_json(spec.to_json()))
    assert again.filter.failsafe == params


# ---- how far off a believed reading can be ------------------------------------------------------------------


@pytest.mark.long
def test_the_drift_that_is_believed_is_bounded(robot):
    """However a reading creeps away, what is believed is within the tolerance, or a billionth of the limits."""
    limits = robot.limits
    bounds = np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])
    size = np.array([bounds[1] - bounds[0], bounds[2], bounds[3]])
    rng = np.random.default_rng(0)
    for tolerance in (np.zeros((3, 6)), np.full((3, 6), 1e-3)):
        monitor = JointMonitor(bounds, DT, tolerance)
        start = JointState(robot.home, np.zeros(6), np.zeros(6))
        monitor.reset(start)
        off, believed = np.zeros((3, 6)), []
        for k in range(4000):
            off += rng.uniform(-1.0, 3.0, (3, 6)) * 1e-3 * (tolerance + 1e-9 * size)
            reading = monitor.read(JointState(*(monitor.expected + off)), k * DT)
            believed.append(not monitor.judge(reading))
            assert not believed[-1] or np.all(np.abs(off) <= tolerance + 1.0001e-9 * size)
        assert believed[0]
        assert sum(believed) > 100
        assert not any(believed[-1000:])


# ---- arms that were moved by hand ---------------------------------------------------------------------------


def test_an_arm_that_was_moved_by_hand_is_rebased_from_rest(robot, make_scene, caplog):
    own = Own(robot, make_scene, exact)
    for _ in range(10):
        own.step(0.2 * robot.limits.jerk)
    own.state[0, 1] += 0.2
    assert own.step(np.zeros(6)).status == Status.FAULT
    with pytest.raises(ParameterError, match="still braking"):
        own.filter.rebase(own.scene())
    for _ in range(100):
        assert own.step(np.zeros(6)).status == Status.FAULT
    early = own.scene()
    assert own.step(np.zeros(6)).status == Status.FAULT
    for told, word in (
        (lambda: joints(own.scene(), velocity=np.full(6, 1e-3)), "moves"),
        (lambda: joints(own.scene(), position=NAN), "not finite"),
        (lambda: joints(own.scene(), position=robot.home + 9.0), "outside"),
        (lambda: early, "has to be newer"),
        (lambda: own.scene()._replace(time=np.nan), "has to be newer"),
        (lambda: own.scene()._replace(time=None), "clock cannot be read"),
        (lambda: None, "cannot be read"),
    ):
        with pytest.raises(ParameterError, match=word):
            own.filter.rebase(told())
        assert own.step(np.zeros(6)).status == Status.FAULT
    own.filter.rebase(own.scene())
    for _ in range(30):
        assert own.step(0.1 * robot.limits.jerk).status == Status.NOMINAL
    np.testing.assert_allclose(own.filter.expected, own.state, atol=1e-12)


def moved_by_hand(scenes):
    """The second axis is elsewhere from the first step on."""
    return joints(scenes[-1], position=scenes[-1].robot.position + 0.1 * (np.arange(6) == 1))


def test_a_shield_rebases_by_its_scene():
    env = JSSAShield(Reading(ArmEnv("home", human="none", terminate_on=()), moved_by_hand))
    env.reset(seed=0)
    assert env.step(np.zeros(6))[4]["shield/status"] == Status.NOMINAL
    assert env.step(np.zeros(6))[4]["shield/status"] == Status.FAULT
    env.rebase()
    assert env.step(np.zeros(6))[4]["shield/status"] == Status.NOMINAL


def test_an_arm_that_was_not_seen_at_reset_begins_where_it_is_first_seen(robot, make_scene):
    own = Own(robot, make_scene, exact)
    good = own.scene()
    own.filter.reset(joints(good, position=NAN))
    assert own.filter.decide(joints(good, position=NAN), np.zeros(6)).status == Status.FAULT
    own.time += DT
    for _ in range(20):
        assert own.step(0.2 * robot.limits.jerk).status == Status.NOMINAL


# ---- what else of a scene is looked at ----------------------------------------------------------------------


def masked(array):
    return np.ma.masked_array(array, np.zeros(array.shape, bool))


POSTS = "static capsules are not those of the beginning"


def test_a_scene_that_is_not_what_it_was_is_a_fault(robot, make_scene):
    person = ball([2.0, 0.0, 1.2])
    post, nothing = ball([3.0, 1.0, 0.5], name="post"), Planes(np.zeros((0, 3)), np.zeros(0), ())
    cases = {
        "planes vanish": (lambda s: s._replace(planes=nothing), "half-spaces are not those of the beginning"),
        "planes sink": (
            lambda s: s._replace(planes=s.planes._replace(offset=np.array([0.5]))),
            "half-spaces are not those of the beginning",
        ),
        "a post vanishes": (lambda s: s._replace(static=nobody()), POSTS),
        "another post": (lambda s: s._replace(static=together([post, ball([3.0, 2.0, 0.5], name="other")])), POSTS),
        "a post leaps away": (lambda s: s._replace(static=ball([1e6, 1.0, 0.5], name="post")), POSTS),
        "a post shrinks": (lambda s: s._replace(static=ball([3.0, 1.0, 0.5], 1e-6, name="post")), POSTS),
        "no radius": (lambda s: s._replace(human=s.human._replace(radius=np.zeros(1))), "without a radius"),
        "masked people": (lambda s: s._replace(human=s.human._replace(start=masked(s.human.start))), "masked"),
        "masked age": (lambda s: s._replace(age=masked(s.age)), "masked"),
        "masked planes": (lambda s: s._replace(planes=s.planes._replace(offset=masked(s.planes.offset))), "masked"),
        "masked joints": (lambda s: joints(s, velocity=masked(s.robot.velocity)), "masked"),
    }
    for harm, word in cases.values():
        own = Own(robot, make_scene, exact)
        fine = lambda own=own: make_scene(own.state, person, time=own.time)._replace(static=post)  # noqa: E731
        own.scene = fine
        own.filter.reset(own.scene())
        for _ in range(5):
            assert own.step(0.1 * robot.limits.jerk).status == Status.NOMINAL
        own.scene = lambda fine=fine, harm=harm: harm(fine())
        decision = own.step(0.1 * robot.limits.jerk)
        assert decision.status == Status.FAULT, word
        assert word in decision.reason
        own.scene = fine
        for _ in range(AGREEMENTS):
            decision = own.step(np.zeros(6))
        assert decision.status == Status.NOMINAL, decision.reason


# ---- the monitor by itself ----------------------------------------------------------------------------------


def limits_of(robot):
    limits = robot.limits
    return np.array([*limits.position.T, limits.velocity, limits.acceleration, limits.jerk])


class Watched:
    """A monitor beside an arm that moves evenly, one tick after the other."""

    def __init__(self, robot, tolerance=None):
        self.bounds = limits_of(robot)
        self.monitor = JointMonitor(self.bounds, DT, np.zeros((3, 6)) if tolerance is None else tolerance)
        self.time, start = 0.0, np.array([robot.home, np.full(6, 0.1), np.zeros(6)])
        self.monitor.reset(JointState(*start))

    @property
    def truth(self):
        return self.monitor.expected.copy()

    def tick(self, state=None, time=None, still=False):
        """Why a reading, right unless another is given, is not believed."""
        state = self.truth if state is None else state
        reason = self.monitor.judge(self.monitor.read(JointState(*state), self.time if time is None else time))
        if not still:
            self.monitor.expected[0] += DT * self.monitor.expected[1]
        self.time += DT
        return reason


@pytest.mark.parametrize("row", [0, 1, 2])
def test_monitor_a_deviation_is_a_share_of_each_limit_and_nan_deviates(robot, row):
    rng, bounds = np.random.default_rng(4), limits_of(robot)
    size = np.array([bounds[1] - bounds[0], bounds[2], bounds[3]])
    for tolerance in (0.0, 1e-4):
        allowed = np.full((3, 6), tolerance)
        monitor = JointMonitor(bounds, DT, allowed)
        for share, agrees in ((0.9, True), (-0.9, True), (1.1, False), (-1.1, False), (np.nan, False)):
            expected, joint = rng.normal(size=(3, 6)), rng.integers(6)
            state = expected.copy()
            state[row, joint] += share * (tolerance + 1e-9 * size[row, joint])
            assert monitor.agrees(state, expected) == agrees


@pytest.mark.long
def test_monitor_says_what_is_wrong(robot):
    def told(harm):
        arm = Watched(robot)
        assert not any(arm.tick() for _ in range(8))
        return harm(arm)

    def lag(arm):
        past = [arm.truth]
        for _ in range(5):
            assert not arm.tick()
            past.append(arm.truth)
        return arm.tick(past[-4])

    def frozen(arm):
        last = arm.truth
        assert not arm.tick()
        return arm.tick(last)

    off = np.zeros((3, 6))
    off[1, 3] = 1e-6
    for harm, word in (
        (lag, "lags by 3 ticks"),
        (frozen, "frozen"),
        (lambda arm: arm.tick(arm.truth + off), "not where the last jerk led"),
        (lambda arm: arm.tick(arm.truth * np.nan), "not finite"),
        (lambda arm: arm.tick(arm.truth.astype(np.float32)), "float64"),
        (lambda arm: arm.tick(masked(arm.truth)), "masked"),
        (lambda arm: arm.tick(arm.truth[:, :5]), "shape"),
        (lambda arm: arm.tick(arm.truth.astype(complex)), "complex128, expected real numbers"),
        (lambda arm: arm.tick(time=arm.time - DT), "stands still"),
        (lambda arm: arm.tick(time=0.0), "went back"),
        (lambda arm: arm.tick(time=np.nan), "time is nan"),
        (lambda arm: arm.tick(time="noon"), "clock cannot be read"),
    ):
        assert word in told(harm), word


def test_monitor_clocks_that_are_wrong_cost_one_tick_and_wrong_readings_several(robot):
    for harm, ticks in (({"time": np.nan}, 1), ({"state": np.full((3, 6), np.nan)}, 1), ({"state": "off"}, AGREEMENTS)):
        arm = Watched(robot)
        assert not any(arm.tick() for _ in range(8))
        if isinstance(harm.get("state"), str):
            harm = {"state": arm.truth + 1e-3}
        reasons = [arm.tick(**harm), *(arm.tick() for _ in range(10))]
        assert [bool(reason) for reason in reasons] == [True] * ticks + [False] * (11 - ticks)


def test_monitor_relapses_ask_for_more_and_are_forgiven_in_the_end(robot):
    arm, asked = Watched(robot), []
    for _ in range(6):
        arm.tick(arm.truth + 1e-3)
        asked.append(1)
        while arm.tick():
            asked[-1] += 1
    assert asked == [AGREEMENTS * 2**k for k in range(6)]
    for _ in range(4):
        arm.tick(arm.truth + 1e-3)
        asked.append(1)
        while arm.tick():
            asked[-1] += 1
    assert asked[-1] == asked[-2] == AGREEMENTS * 2**7
    assert arm.monitor.persistent
    assert not any(arm.tick() for _ in range(130))
    assert not arm.monitor.persistent
    arm.tick(arm.truth + 1e-3)
    assert [bool(arm.tick()) for _ in range(6)] == [True] * 4 + [False] * 2


def test_monitor_a_lag_that_the_clock_shows_is_over_when_the_clock_has_caught_up(robot):
    for behind in (0.0, 2 * DT):
        arm, past = Watched(robot), []
        for k in range(14):
            past.append(arm.truth)
            reason = arm.tick() if k < 8 else arm.tick(past[-3], time=arm.time - behind)
            assert bool(reason) == (k >= 8)
            # the first of them is the reading of two ticks before, which is no news
            assert k < 10 or "lags by 2 ticks" in reason
        # it rests: nothing tells this tick's reading from older ones but the clock
        arm.monitor.expected[1:] = 0.0
        reasons = [arm.tick(still=True, time=arm.time - behind) for _ in range(40)]
        assert bool(reasons[-1]) == (behind > 0.0)
        reasons = [arm.tick(still=True) for _ in range(AGREEMENTS)]
        assert not reasons[-1]


def test_monitor_noise_in_the_first_reading_is_not_reckoned_with(robot):
    noise = np.full((3, 6), 1e-3)
    monitor = JointMonitor(limits_of(robot), DT, noise)
    monitor.reset(JointState(robot.home + 9e-4, np.full(6, 9e-4), np.full(6, -9e-4)))
    np.testing.assert_array_equal(monitor.expected, [robot.home + 9e-4, np.zeros(6), np.zeros(6)])


def test_monitor_readings_that_are_missing_undo_nothing(robot):
    """A dropout while trust is coming back is no relapse, and none of them wipes away what was right."""
    arm, missing = Watched(robot), np.full((3, 6), np.nan)
    arm.tick(arm.truth + 1e-3)
    reasons = [bool(arm.tick(missing if k % 2 else None)) for k in range(2 * AGREEMENTS)]
    assert reasons == [True] * (2 * AGREEMENTS - 2) + [False, True]


def test_monitor_a_clock_that_slips_is_no_lag(robot):
    """Clocks run a little slow for good; a lag that is over is over, whatever the clock was long ago."""
    for rate in (1.0, 0.9998, 0.999, 1.001):
        arm, past = Watched(robot), []
        for k in range(4000):
            past.append(arm.truth)
            arm.time = k * DT * rate
            if 3000 <= k < 3003:
                assert arm.tick(past[-2], time=arm.time - DT)
            else:
                assert bool(arm.tick()) == (3003 <= k < 3003 + AGREEMENTS - 1), (rate, k)


def test_monitor_with_a_tolerance_an_episode_begins_at_rest_or_not_at_all(robot):
    """Noise in the velocity of an arm that moves would be reckoned with for good."""
    noise = np.full((3, 6), 1e-3)
    monitor = JointMonitor(limits_of(robot), DT, noise)
    moving = JointState(robot.home, np.full(6, 0.1), np.zeros(6))
    monitor.reset(moving)
    for k in range(5):
        assert "has to begin at rest" in monitor.judge(monitor.read(moving, k * DT))
    assert not monitor.begun
    assert not monitor.judge(monitor.read(JointState(robot.home, np.full(6, 5e-4), np.zeros(6)), 5 * DT))
    assert monitor.begun
    np.testing.assert_array_equal(monitor.expected, [robot.home, np.zeros(6), np.zeros(6)])


@pytest.mark.long
def test_monitor_never_raises(robot):
    rng = np.random.default_rng(0)
    junk = [None, 3, "x", np.nan, np.inf, -1e308, 1e308, [], {}, object()]
    arm = Watched(robot)
    with np.errstate(all="ignore"):
        for _ in range(500):
            sizes = 10.0 ** rng.integers(-300, 300, 3)
            parts = [junk[rng.integers(len(junk))] if rng.random() < 0.3 else s * rng.normal(size=6) for s in sizes]
            robot_state = JointState(*parts) if rng.random() < 0.9 else junk[rng.integers(len(junk))]
            time = junk[rng.integers(len(junk))] if rng.random() < 0.3 else rng.normal()
            assert arm.monitor.judge(arm.monitor.read(robot_state, time))
            assert np.isfinite(arm.monitor.expected).all()


# ---- and its place in the verified stop ---------------------------------------------------------------------


def test_an_arm_that_is_first_seen_in_motion_is_stopped(robot, make_scene):
    own = Own(robot, make_scene, exact)
    own.state[1] = 0.3 * robot.limits.velocity
    own.filter.reset(joints(own.scene(), position=NAN))
    decision = own.filter.decide(joints(own.scene(), position=NAN), np.zeros(6))
    assert decision.status == Status.FAULT
    assert "no verified stop" in decision.reason
    own.time += DT
    for _ in range(200):
        own.step(np.full(6, np.nan))
    assert np.abs(own.state[1:]).max() < 1e-9


class Driver:
    """A scene whose parts raise when they are asked for, from some tick on."""

    def __init__(self, scene, broken):
        self.__dict__.update(scene._asdict())
        for part in broken:
            del self.__dict__[part]

    def __getattr__(self, name):
        raise RuntimeError(f"driver lost {name}")


@pytest.mark.parametrize("part", ["robot", "time", "human", "age", "valid", "static", "planes"])
def test_a_part_of_a_scene_that_raises_is_a_fault_and_named(robot, make_scene, part, caplog):
    own = Own(robot, make_scene, exact)
    fine = own.scene
    for _ in range(10):
        assert own.step(0.2 * robot.limits.jerk).status == Status.NOMINAL
    own.scene = lambda: Driver(fine(), [part])
    for _ in range(60):
        decision = own.step(0.2 * robot.limits.jerk)
        assert decision.status == Status.FAULT
        assert part == "time" or f"driver lost {part}" in decision.reason
        assert "the control step failed" not in decision.reason
    assert np.abs(own.state[1:]).max() < 1e-9
    own.filter.reset(own.scene())
    own.scene = fine
    own.filter.reset(own.scene())
    assert own.step(np.zeros(6)).status == Status.NOMINAL
    assert not caplog.records


def test_a_masked_action_is_no_action():
    env = JSSAShield(ArmEnv("home", human="none"))
    env.reset(seed=0)
    with pytest.raises(InvalidActionError, match="masked"):
        env.step(np.ma.masked_array(np.zeros(6), [0, 0, 1, 0, 0, 0]))


def test_missing_scenes_take_time_for_people_too(robot, make_scene):
    """A clock that stands still through them must not make what was measured before them fresh."""
    filter = make_filter("stop", robot, DT, failsafe=FailsafeParams())
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)], ball([2.0, 0.0, 1.2], velocity=(0.5, 0.0, 0.0)))
    filter.reset(scene)
    assert watch(filter, scene)
    assert filter.records.work.age == pytest.approx([0.0])
    for _ in range(3):
        assert not watch(filter, None)
    assert watch(filter, scene)
    assert filter.records.work.age == pytest.approx([4 * DT])


@pytest.mark.parametrize("hang", ["stands still", "goes back", "lags"])
def test_people_of_another_tick_are_not_those_of_now(robot, make_scene, hang):
    """A whole scene that hangs says that its people are fresh; they go on, and are believed where they are then."""
    own = Own(robot, make_scene, exact)
    people, scenes = [], []
    for k in range(40):
        x = 2.0 - 1.5 * DT * k  # walks, but is not said to
        scenes.append(make_scene(own.state, ball([x, 0.0, 1.2]), time=k * DT))
        hangs = 10 <= k < 25
        shown = {"stands still": 9, "goes back": 5, "lags": k - 4}[hang] if hangs else k
        own.filter.decide(scenes[shown], np.zeros(6))
        people.append(own.filter.records.memory.tracks[0, 0]["stamp"])
        assert people[-1] == pytest.approx(9 * DT if hangs else k * DT, abs=1e-9)
    assert own.filter.decide(make_scene(own.state, ball([x, 0.0, 1.2]), time=40 * DT), np.zeros(6)).status == 0


def test_a_stop_that_did_not_end_in_rest_is_seen(robot, make_scene):
    """Nobody verifies where an arm begins in motion: a stop of it that is wrong is followed by another."""
    own = Own(robot, make_scene, exact)
    own.state[1] = 0.3 * robot.limits.velocity
    own.filter.reset(own.scene())
    stored(own.filter)["jerk_out"] *= 0.5
    for _ in range(200):
        decision = own.step(np.full(6, np.nan))
        assert decision.status == Status.FAULT
    assert np.abs(own.state[1:]).max() < 1e-9
