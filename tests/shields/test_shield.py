"""Shields and filters: what they decide, that they fail closed, and that without them the same runs end badly."""

import copy

import gymnasium as gym
import numpy as np
import pytest
import reference as ref
from monitors import Unsolvable

import jssa_gym
from jssa_gym.cli.demo import paper_scene
from jssa_gym.envs import ArmEnv
from jssa_gym.exceptions import InterfaceError, InvalidActionError, ParameterError
from jssa_gym.humans import Body, nobody
from jssa_gym.policies import HoldPolicy
from jssa_gym.robots import JointLimits
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.safety.index import IndexParams
from jssa_gym.safety.projectors import PROJECTORS, ExactProjector, OSQPProjector, Projection
from jssa_gym.shields import FILTERS, JSSAFilter, JSSAShield, NoFilter, SafetyFilter, Shield, make_filter
from jssa_gym.types import CapsuleSet, Decision, HalfSpaces, JointState, Scene, Status

DT = 0.008
TABLE = 0.87
TOLERANCE = 1e-6
HOME = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0])
JERK = np.radians([3798.0, 3408.0, 3505.0, 7011.0, 7011.0, 10712.0])
PARAMS = ref.Params(0.05, 2.0, 0.25)
CHAIN = [ref.lr_mate_chain()[0]._replace(offset=np.array([0.0, 0.0, 0.330 + TABLE])), *ref.lr_mate_chain()[1:]]
PAIRS = [(i, j) for i in range(5) for j in range(6)]
BARE = [name for name in FILTERS if name != "stop"]
"""All but the one that is never without its verified stop, of which test_failsafe.py knows more."""


@pytest.fixture(params=BARE)
def filter(request, robot):
    """Every filter of the package, and every one that will be added."""
    return make_filter(request.param, robot, DT)


def changed(scene: Scene, part: str, **values) -> Scene:
    """A scene with some values of its robot or human replaced; ``part`` may be empty for the scene's own."""
    if not part:
        return scene._replace(**values)
    return scene._replace(**{part: getattr(scene, part)._replace(**values)})


def arrays(scene: Scene):
    for part in (scene.robot, scene.human, scene.static, scene.planes):
        yield from (v for v in part if isinstance(v, np.ndarray))
    yield from (scene.age, scene.valid)


def phis(scene: Scene, jerk, params=PARAMS, sliding=False) -> dict[tuple[int, int], float]:
    """Index of every robot-human pair one step ahead, from the textbook."""
    state, human = scene.robot, scene.human
    found = {}
    for i, (_, link, start, end, radius) in enumerate(ref.LR_MATE_CAPSULES):
        for j in range(len(human.radius)):
            found[i, j] = ref.phi_after(
                *(CHAIN, state.position, state.velocity, state.acceleration, jerk, DT, link, start, end),
                *(human.start[j], human.end[j], human.start_velocity[j], human.end_velocity[j]),
                *(radius + human.radius[j], params, sliding),
            )
    return found


def row(scene: Scene, jerk, pair, params=PARAMS):
    """L of one pair, differenced at a jerk."""
    state, human = scene.robot, scene.human
    (_, link, start, end, radius), j = ref.LR_MATE_CAPSULES[pair[0]], pair[1]
    return ref.row_by_differences(
        *(CHAIN, state.position, state.velocity, state.acceleration, jerk, DT, link, start, end),
        *(human.start[j], human.end[j], human.start_velocity[j], human.end_velocity[j]),
        *(radius + human.radius[j], params, False),
    )


def authority(L) -> float:
    """Normal jerk [m/s³] that the box can give to a pair."""
    return float(np.abs(L) @ JERK) / (PARAMS.lambda2 * DT)


def moving(scene_maker, human=None):
    """An arm in motion."""
    velocity = 0.3 * np.array([1.0, -1.0, 0.5, 1.0, -1.0, 1.0])
    return scene_maker([HOME, velocity, -2.0 * velocity], human)


def beside(distance=1.0):
    return Body.facing().at((distance, 0.0), (-0.3, 0.1))


# ---- every filter: decides, in the box, on whatever it is given ---------------------------------------


def check_decision(decision: Decision, filter: SafetyFilter) -> None:
    assert type(decision) is Decision
    assert isinstance(decision.status, Status)
    assert decision.jerk.shape == (filter.robot.n,)
    assert decision.jerk.dtype == np.float64
    assert np.isfinite(decision.jerk).all()
    assert np.all(decision.jerk >= filter.lower)
    assert np.all(decision.jerk <= filter.upper)
    assert (decision.reason == "") == (decision.status == Status.NOMINAL)
    assert isinstance(decision.reason, str)
    assert all(isinstance(x, float) for x in (decision.phi, decision.distance, decision.slack))
    assert all(isinstance(x, int) for x in decision.pair)
    # what cannot be computed is a fault, and nothing else is
    assert np.isnan(decision.slack) == (decision.status == Status.FAULT)
    if isinstance(filter, JSSAFilter):
        assert np.isnan(decision.phi) == (decision.status == Status.FAULT)
    if decision.status in (Status.NOMINAL, Status.PROJECTED):
        assert decision.slack < np.inf


@pytest.mark.parametrize("count", [60, pytest.param(3000, marks=pytest.mark.slow)])
def test_random_scenes_are_decided_inside_the_box(filter, random_scene, count):
    rng = np.random.default_rng(0)
    seen = set()
    for k in range(count):
        # from far away to deep inside the robot's base, from rest to twice the limits
        scene = random_scene(rng, 0.05 if k % 3 == 0 else 0.5, 1.8, motion=[0.0, 0.3, 2.0][k % 3])
        decision = filter.decide(scene, rng.uniform(-2.0, 2.0, 6) * JERK)
        check_decision(decision, filter)
        seen.add(decision.status)
    assert Status.PROJECTED in seen
    assert Status.FAULT not in seen


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", BARE)
@pytest.mark.parametrize("human", ["random", "close"])
@pytest.mark.parametrize("episodes", [4, pytest.param(200, marks=pytest.mark.slow)])
def test_sound_input_is_never_a_fault(name, human, episodes):
    # actions that drive the arm far beyond its limits, into people: rows that exclude each other in every way
    env = gym.make("jssa_gym/Home-v0", human=paper_scene(0.8) if human == "close" else human, terminate_on=())
    env = Shield(env, make_filter(name, env.unwrapped.robot, DT))
    rng, seen = np.random.default_rng(0), set()
    for seed in range(episodes):
        env.reset(seed=seed)
        for k in range(600):
            if k % 5 == 0:
                action = rng.uniform(-0.6, 0.6, 6)
            *_, info = env.step(action)
            check_decision(env.last_decision, env.filter)
            assert info["shield/status"] != Status.FAULT, info["shield/reason"]
            seen.add(info["shield/status"])
    assert Status.NOMINAL in seen


def degenerate():
    """People in places where formulas divide by zero."""
    shoulder = np.array([0.05, 0.0, TABLE + 0.33])
    zero = np.zeros((1, 3))

    def one(start, end, radius=0.1):
        return CapsuleSet(start[None], end[None], zero, zero, np.array([radius]), ("x",), np.zeros(1, np.int64))

    up, side = np.array([0.0, 0.0, 0.44]), np.array([0.0, 0.3, 0.0])
    yield one(shoulder, shoulder + up)  # on the upper arm's axis
    yield one(shoulder, shoulder)  # a point on it
    yield one(shoulder + side, shoulder + side + up / 2.0)  # parallel beside it
    yield one(shoulder - side, shoulder + side)  # across it
    yield one(shoulder, shoulder + 1e-12, 1e-9)
    yield one(shoulder * 0.0, shoulder * 0.0, 5.0)  # everything inside
    yield one(shoulder * 1e3, shoulder * 2e3)
    yield one(shoulder * 1e200, shoulder)
    yield nobody()


def test_degenerate_geometry_is_decided(filter, make_scene):
    for human in degenerate():
        for state in ([HOME, HOME * 0.0, HOME * 0.0], [HOME, HOME * 0.0 + 0.3, HOME * 0.0 - 1.0]):
            decision = filter.decide(make_scene(state, human), np.zeros(6))
            check_decision(decision, filter)


def test_absurd_motion_is_decided(filter, make_scene):
    for size in (1e3, 1e100, 1e200, 1e308):
        for rank in range(3):
            state = np.zeros((3, 6))
            state[0], state[rank] = HOME, size
            check_decision(filter.decide(make_scene(state, beside()), np.zeros(6)), filter)


MEASURED = {
    ("robot", "position"): "joint state",
    ("robot", "velocity"): "joint state",
    ("robot", "acceleration"): "joint state",
    ("human", "start"): "human",
    ("human", "end"): "human",
    ("human", "start_velocity"): "human",
    ("human", "end_velocity"): "human",
    ("human", "radius"): "human",
}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_measurement_that_is_not_finite_is_a_fault(filter, make_scene, bad):
    scene = moving(make_scene, beside())
    good = filter.decide(scene, np.zeros(6))
    assert good.status != Status.FAULT
    for (part, name), word in MEASURED.items():
        for position in (0, -1):
            values = getattr(getattr(scene, part), name).copy()
            values.reshape(-1)[position] = bad
            decision = filter.decide(changed(scene, part, **{name: values}), np.zeros(6))
            check_decision(decision, filter)
            assert decision.status == Status.FAULT, name
            assert word in decision.reason, name
        assert filter.decide(scene, np.zeros(6)).status == good.status, name


def test_a_negative_radius_is_a_fault(filter, make_scene):
    scene = changed(moving(make_scene, beside()), "human", radius=np.full(6, -0.1))
    assert filter.decide(scene, np.zeros(6)).status == Status.FAULT


@pytest.mark.parametrize("which", [0, 5])
def test_a_capsule_that_was_not_measured_is_a_fault(filter, make_scene, which):
    scene = moving(make_scene, beside())
    scene.valid[which] = False
    decision = filter.decide(scene, np.zeros(6))
    check_decision(decision, filter)
    assert decision.status == Status.FAULT
    assert "not measured" in decision.reason


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_nominal_that_is_not_finite_is_a_fault_that_brakes(filter, make_scene, bad):
    scene = moving(make_scene, beside())
    for joint in range(6):
        nominal = 0.1 * JERK
        nominal[joint] = bad
        filter.reset(scene)
        decision = filter.decide(scene, nominal)
        check_decision(decision, filter)
        assert decision.status == Status.FAULT, joint
        assert "nominal" in decision.reason, joint
        assert_brakes(decision, scene)


def assert_brakes(decision, scene):
    """The jerk is the one of a stop: a second step of the same kind starts slower, all the way to rest."""
    expected = braking(scene.robot)
    np.testing.assert_allclose(decision.jerk, expected, rtol=1e-9, atol=1e-9)
    assert np.abs(decision.jerk).max() > 0.0


def braking(state: JointState):
    """The stop from its description: next acceleration a' such that a ramp at the bound ends at zero velocity."""
    jerk = []
    for v, a, bound in zip(state.velocity, state.acceleration, JERK, strict=True):
        w = v + DT * a / 2.0
        target = -np.sign(w) * bound * (np.sqrt(DT**2 + 2.0 * abs(w) / bound) - DT)
        jerk.append(np.clip((target - a) / DT, -bound, bound))
    return np.array(jerk)


WRONG = {
    "robot position (5,)": ("robot", {"position": np.zeros(5)}),
    "robot position (1,)": ("robot", {"position": np.zeros(1)}),
    "robot velocity (1,)": ("robot", {"velocity": np.zeros(1)}),
    "robot velocity (7,)": ("robot", {"velocity": np.zeros(7)}),
    "robot acceleration ()": ("robot", {"acceleration": np.float64(0.0)}),
    "robot acceleration (6, 1)": ("robot", {"acceleration": np.zeros((6, 1))}),
    "robot position None": ("robot", {"position": None}),
    "robot position strings": ("robot", {"position": np.array(["a"] * 6)}),
    "robot position object": ("robot", {"position": np.array([None] * 6)}),
    "no robot": ("", {"robot": None}),
    "human start (5, 3)": ("human", {"start": np.zeros((5, 3))}),
    "human start (6, 2)": ("human", {"start": np.zeros((6, 2))}),
    "human end (6,)": ("human", {"end": np.zeros(6)}),
    "human end velocity ()": ("human", {"end_velocity": np.zeros(())}),
    "human start velocity (7, 3)": ("human", {"start_velocity": np.zeros((7, 3))}),
    "human radius (6, 1)": ("human", {"radius": np.zeros((6, 1))}),
    "human radius (5,)": ("human", {"radius": np.zeros(5)}),
    "human radius number": ("human", {"radius": 0.1}),
    "human start object": ("human", {"start": np.full((6, 3), None)}),
    "human start strings": ("human", {"start": np.full((6, 3), "a")}),
    "human start complex": ("human", {"start": np.full((6, 3), 1j)}),
    "human start list": ("human", {"start": [[0.0, 0.0, 0.0]] * 6}),
    "no human": ("", {"human": None}),
    "valid (5,)": ("", {"valid": np.ones(5, bool)}),
    "valid (6, 1)": ("", {"valid": np.ones((6, 1), bool)}),
    "valid None": ("", {"valid": None}),
    "valid object": ("", {"valid": np.array([None] * 6)}),
    "valid numbers": ("", {"valid": np.full(6, np.nan)}),
}


def test_a_scene_that_does_not_fit_is_a_fault_that_brakes(filter, make_scene):
    scene = moving(make_scene, beside())
    for what, (part, values) in WRONG.items():
        filter.reset(scene)
        decision = filter.decide(changed(scene, part, **values), 0.1 * JERK)
        check_decision(decision, filter)
        assert decision.status == Status.FAULT, what
        assert decision.reason, what
        if "robot" not in what:
            assert_brakes(decision, scene)
        # a good scene afterwards is decided as ever
        assert filter.decide(scene, np.zeros(6)).status != Status.FAULT, what


def test_faults_that_come_together_still_brake(filter, make_scene):
    scene = moving(make_scene, beside())
    nan = np.full(6, np.nan)
    velocity = scene.robot.velocity.copy()
    velocity[3] = np.nan
    wrong_human = scene.human._replace(start=np.zeros((2, 3)))
    for bad in (
        changed(scene, "robot", velocity=velocity),
        changed(scene, "robot", position=nan, velocity=nan, acceleration=nan),
        changed(changed(scene, "robot", velocity=velocity), "", human=wrong_human),
        changed(scene, "", human=wrong_human),
    ):
        for nominal in (nan, np.array([0.0, 0.0, 0.0, np.inf, 0.0, 0.0]), np.zeros(6)):
            filter.reset(scene)
            decision = filter.decide(bad, nominal)
            check_decision(decision, filter)
            assert decision.status == Status.FAULT
            # every joint moved when the episode began, so every joint is braked
            assert np.abs(decision.jerk).min() > 0.0


class Unplugged:
    """What a sensor without a cable may be like."""

    @property
    def radius(self):
        raise ConnectionError("unplugged")

    position = radius


@pytest.mark.parametrize("part", ["human", "robot"])
def test_a_sensor_that_raises_is_a_fault(filter, make_scene, part):
    scene = moving(make_scene, beside())
    filter.reset(scene)
    decision = filter.decide(changed(scene, "", **{part: Unplugged()}), 0.1 * JERK)
    check_decision(decision, filter)
    assert decision.status == Status.FAULT
    assert "unplugged" in decision.reason
    assert np.abs(decision.jerk).min() > 0.0


def test_an_arm_that_was_never_seen_is_braked_from_where_it_was_at_reset(filter, make_scene):
    velocity = np.array([0.5, -0.4, 0.3, 0.2, -0.5, 0.6])
    scene = make_scene([HOME, velocity, np.zeros(6)], beside())
    lost = changed(scene, "robot", position=np.full(6, np.nan))
    # an episode before leaves nothing behind
    filter.reset(scene)
    filter.decide(scene, 0.7 * JERK)
    filter.reset(scene)
    state = (HOME, velocity, np.zeros(6))
    for _ in range(250):
        state = ref.triple_integrator(*state, filter.decide(lost, np.zeros(6)).jerk, DT)
    assert np.abs(state[1]).max() < 1e-6
    assert np.abs(state[2]).max() < 1e-6
    # not even at reset: nothing is known, and nothing is done
    filter.decide(scene, 0.7 * JERK)
    filter.reset(changed(scene, "", robot=None))
    decision = filter.decide(lost, np.zeros(6))
    assert decision.status == Status.FAULT
    np.testing.assert_array_equal(decision.jerk, np.zeros(6))


def test_an_arm_that_can_no_longer_be_seen_is_brought_to_rest(filter, make_scene):
    # the joint state is lost for good: the brake goes on from where its own jerks must have led
    scene = moving(make_scene, beside())
    lost = changed(scene, "robot", position=np.full(6, np.nan))
    filter.reset(scene)
    state = (scene.robot.position, scene.robot.velocity, scene.robot.acceleration)
    first = filter.decide(scene, 0.2 * JERK)
    state = ref.triple_integrator(*state, first.jerk, DT)
    for _ in range(250):
        decision = filter.decide(lost, np.zeros(6))
        assert decision.status == Status.FAULT
        check_decision(decision, filter)
        state = ref.triple_integrator(*state, decision.jerk, DT)
    assert np.abs(state[1]).max() < 1e-6
    assert np.abs(state[2]).max() < 1e-6


def test_a_nominal_of_another_shape_is_refused(filter, make_scene):
    for shape in ((5,), (7,), (), (1, 6)):
        with pytest.raises(InvalidActionError, match="shape"):
            filter.decide(moving(make_scene), np.zeros(shape))


def test_deciding_changes_and_keeps_nothing_of_its_inputs(filter, random_scene):
    rng = np.random.default_rng(1)
    for k in range(20):
        scene = random_scene(rng, 0.3, 1.5)
        nominal = rng.uniform(-1.5, 1.5, 6) * JERK
        if k == 19:
            nominal[2] = np.nan
        before, given = copy.deepcopy(scene), nominal.copy()
        decision = filter.decide(scene, nominal)
        for ours, theirs in zip(arrays(scene), arrays(before), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        np.testing.assert_array_equal(nominal, given)
        for result in (decision.jerk, decision.nominal):
            assert not np.shares_memory(result, nominal)
            for array in arrays(scene):
                assert not np.shares_memory(result, array)
        np.testing.assert_array_equal(decision.nominal, given)
        # nor is an answer touched by the next decision
        kept = decision.jerk.copy()
        filter.decide(random_scene(rng, 0.3, 1.5), rng.uniform(-1.0, 1.0, 6) * JERK)
        np.testing.assert_array_equal(decision.jerk, kept)


def test_read_only_and_single_precision_scenes_are_decided_alike(filter, make_scene):
    scene = moving(make_scene, beside(0.9))
    expected = filter.decide(scene, 0.5 * JERK)
    frozen = copy.deepcopy(scene)
    for array in arrays(frozen):
        array.flags.writeable = False
    np.testing.assert_array_equal(filter.decide(frozen, 0.5 * JERK).jerk, expected.jerk)
    single = changed(scene, "human", start=scene.human.start.astype(np.float32))
    assert filter.decide(single, 0.5 * JERK).status == expected.status


@pytest.mark.sampled(2)
def test_decisions_have_no_memory_of_the_size_of_the_crowd(filter, robot, random_scene):
    rng, seen = np.random.default_rng(6), set()
    fresh = type(filter) if isinstance(filter, NoFilter) else lambda *_: copy.deepcopy(untouched)
    untouched = copy.deepcopy(filter)
    for _ in range(40):
        drawn = [random_scene(rng, 0.6, 1.3, motion=0.25) for _ in range(4)]
        people = jssa_gym.humans.together([scene.human for scene in drawn[: rng.integers(0, 4)]])
        scene = changed(drawn[0], "", human=people, **sized(people))
        nominal = rng.uniform(-1.0, 1.0, 6) * JERK
        filter.reset(scene)  # whether it has stopped may be remembered, but not across episodes
        one, other = filter.decide(scene, nominal), fresh(robot, DT).decide(scene, nominal)
        assert (one.status, one.rows, one.pair) == (other.status, other.rows, other.pair)
        np.testing.assert_array_equal(one.jerk, other.jerk)
        np.testing.assert_array_equal([one.phi, one.slack], [other.phi, other.slack])
        seen.add(one.status)
    assert isinstance(filter, NoFilter) or seen & {Status.PROJECTED, Status.RELAXED}


@pytest.mark.parametrize("dt", [0.0, -0.008, np.nan, np.inf, "fast"])
def test_a_time_step_is_a_positive_number(robot, dt):
    with pytest.raises(ParameterError, match="dt"):
        NoFilter(robot, dt)


def test_an_unknown_filter_is_told_the_valid_ones(robot):
    with pytest.raises(ParameterError, match=", ".join(FILTERS)):
        make_filter("magic", robot, DT)


def answer(jerk, status=Status.PROJECTED):
    return lambda nominal: Decision(jerk, nominal, status, "made up", 0.0, 0.0, (0, 0), 0.0, 0)


BROKEN = {
    "nan": answer(np.array([0.0, 0.0, np.nan, 0.0, 0.0, 0.0])),
    "inf": answer(np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.inf])),
    "outside the box": answer(1.01 * JERK),
    "shape (5,)": answer(np.zeros(5)),
    "shape (1, 6)": answer(np.zeros((1, 6))),
    "float32": answer(np.zeros(6, np.float32)),
    "object": answer(np.zeros(6, object)),
    "list": answer([0.0] * 6),
    "nominal that is another": answer(0.5 * JERK, Status.NOMINAL),
    "no decision": lambda nominal: None,
    "error": lambda nominal: 1 // 0,
    "odd error": lambda nominal: {}["x"],
}


@pytest.mark.parametrize("how", list(BROKEN))
def test_a_filter_that_fails_is_a_fault_that_brakes(robot, make_scene, how):
    class Broken(SafetyFilter):
        def respond(self, tick):
            return BROKEN[how](tick.nominal)

    scene = moving(make_scene)
    decision = Broken(robot, DT).decide(scene, np.zeros(6))
    assert decision.status == Status.FAULT
    assert decision.reason
    assert_brakes(decision, scene)


PROJECTIONS = {
    "no solution": lambda *_: Projection(np.zeros(6), False, np.nan, ""),
    "nan": lambda *_: Projection(np.full(6, np.nan), True, 0.0, ""),
    "far away": lambda *_: Projection(np.full(6, 1e200), True, 0.0, ""),
    "outside the box": lambda nominal, *_: Projection(50.0 * JERK, True, 0.0, ""),
    "error": lambda *_: 1 // 0,
}


@pytest.mark.parametrize("gradient", ["exact", "printed"])
@pytest.mark.parametrize("how", list(PROJECTIONS))
@pytest.mark.long
def test_a_projector_that_fails_is_a_fault_that_brakes(robot, random_scene, how, gradient):
    good, bad = JSSAFilter(robot, DT, gradient=gradient), JSSAFilter(robot, DT, gradient=gradient, projector="osqp")
    bad.projector.project = PROJECTIONS[how]
    for scene, nominal, _ in statuses(good, random_scene, {Status.PROJECTED: 3}, motion=0.25):
        decision = bad.decide(scene, nominal)
        check_decision(decision, bad)
        if not good.decide(scene, nominal).rows:
            continue
        assert decision.status == Status.FAULT
        assert_brakes(decision, scene)


@pytest.mark.parametrize("gradient", ["exact", "printed"])
def test_a_compiled_projection_that_fails_is_a_fault_that_brakes(robot, random_scene, gradient):
    good, bad, told = JSSAFilter(robot, DT, gradient=gradient), Unsolvable(robot, DT, gradient=gradient), set()
    bad.make_unsolvable()
    for scene, nominal, _ in statuses(good, random_scene, {Status.PROJECTED: 3}, motion=0.25):
        decision = bad.decide(scene, nominal)
        check_decision(decision, bad)
        if not good.decide(scene, nominal).rows:
            continue
        told.add(decision.reason)
        assert decision.status == Status.FAULT
        assert_brakes(decision, scene)
    assert told == {"the projection found no solution" if gradient == "exact" else "the printed row is not finite"}


def test_no_scene_at_all_is_a_fault(filter, make_scene):
    filter.reset(moving(make_scene))
    decision = filter.decide(None, np.zeros(6))
    check_decision(decision, filter)
    assert decision.status == Status.FAULT
    assert np.abs(decision.jerk).min() > 0.0


@pytest.mark.parametrize(
    "static",
    [
        {"planes": None},
        {"static": None},
        {"planes": jssa_gym.types.Planes(np.array([[0.0, 0.0, np.nan]]), np.array([TABLE]), ("table",))},
        {"planes": jssa_gym.types.Planes(np.array([[0.0, 0.0, 1.0]]), np.array([np.inf]), ("table",))},
        {"planes": jssa_gym.types.Planes(np.zeros((2, 3)), np.zeros(1), ("table",))},
        {"planes": jssa_gym.types.Planes(np.zeros(3), np.zeros(1), ("table",))},
        {"static": beside()._replace(start=np.full((6, 3), np.nan))},
        {"static": beside()._replace(start=np.zeros((2, 3)))},
        {"static": beside()._replace(radius=np.full(6, np.inf))},
    ],
    ids=lambda value: next(iter(value)),
)
def test_a_static_scene_that_cannot_be_used_is_a_fault_that_brakes(robot, make_scene, static):
    chosen = JSSAFilter(robot, DT, static_rows=True)
    scene = moving(make_scene, beside())
    decision = chosen.decide(changed(scene, "", **static), 0.1 * JERK)
    check_decision(decision, chosen)
    assert decision.status == Status.FAULT
    assert_brakes(decision, scene)
    # who does not ask for static rows does not mind
    assert JSSAFilter(robot, DT).decide(changed(scene, "", **static), np.zeros(6)).status != Status.FAULT


# ---- JSSA: what the decisions mean --------------------------------------------------------------------


def statuses(filter, random_scene, wanted, seed=0, limit=100_000, **draw):
    """Scenes with their decisions, ``wanted[status]`` of each."""
    rng = np.random.default_rng(seed)
    missing = dict(wanted)
    for _ in range(limit):
        if not missing:
            return
        scene = random_scene(rng, **draw)
        nominal = rng.uniform(-1.0, 1.0, 6) * JERK
        decision = filter.decide(scene, nominal)
        if missing.get(decision.status):
            missing[decision.status] -= 1
            if not missing[decision.status]:
                del missing[decision.status]
            yield scene, nominal, decision
    pytest.fail(f"too few scenes with {missing}")


COUNTS = {Status.NOMINAL: 6, Status.PROJECTED: 14, Status.RELAXED: 4}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("projector", list(PROJECTORS))
@pytest.mark.parametrize("factor", [1, pytest.param(20, marks=pytest.mark.slow)])
def test_kept_rows_keep_the_true_index(robot, random_scene, projector, factor):
    chosen = JSSAFilter(robot, DT, projector=projector, recovery=0.0)
    wanted = {status: factor * count for status, count in COUNTS.items()}
    for scene, nominal, decision in statuses(chosen, random_scene, wanted, motion=0.25):
        ahead = phis(scene, decision.jerk)
        worst = max(ahead.values())
        assert decision.phi == pytest.approx(worst, abs=1e-6, rel=1e-6)
        if decision.status == Status.NOMINAL:
            np.testing.assert_array_equal(decision.jerk, nominal)
        if decision.status == Status.RELAXED:
            # nothing in the box does better: the rows that are violated most exclude each other
            binding = [pair for pair, value in ahead.items() if abs(value / decision.slack - 1.0) < 1e-3]
            rows = [one for pair in binding if authority(one := row(scene, decision.jerk, pair)) > 5.0 * 0.999]
            S = [decision.slack + one @ decision.jerk for one in rows]
            least, _ = ref.least_violation(rows, S, -JERK, JERK)
            assert least > TOLERANCE
            assert decision.slack > TOLERANCE
            continue
        assert decision.slack <= TOLERANCE
        for pair, value in ahead.items():
            if value > TOLERANCE:
                assert authority(row(scene, decision.jerk, pair)) < 5.0 * 1.001


@pytest.mark.long
def test_relaxed_means_least_violation(robot, random_scene):
    chosen = JSSAFilter(robot, DT, min_authority=0.0, recovery=0.0)
    for scene, _, decision in statuses(chosen, random_scene, {Status.RELAXED: 2}, motion=0.25, seed=3):
        worst = max(phis(scene, decision.jerk).values())
        L, S = rows_near(scene, decision, reach=20.0)
        least, _ = ref.least_violation(L, S, -JERK, JERK)
        assert least == pytest.approx(worst, rel=2e-3, abs=1e-5)
        assert decision.slack == pytest.approx(worst, rel=1e-6)


@pytest.mark.long
def test_the_projected_jerk_is_the_nearest(robot, random_scene):
    chosen = JSSAFilter(robot, DT, min_authority=0.0, recovery=0.0)
    for scene, nominal, decision in statuses(chosen, random_scene, {Status.PROJECTED: 4}, motion=0.25, seed=4):
        L, S = rows_near(scene, decision)
        nearest = ref.project_reference(nominal, L, S, -JERK, JERK, np.eye(6))
        # the decision's rows were linearised at the nominal, these at its answer: a difference of second order
        np.testing.assert_allclose(decision.jerk / JERK, nearest / JERK, atol=2e-3)
        np.testing.assert_allclose(
            np.linalg.norm(decision.jerk - nominal), np.linalg.norm(nearest - nominal), rtol=2e-3
        )


def test_an_action_outside_the_box_is_clipped_when_nobody_is_near(filter, make_scene):
    scene = make_scene([HOME, HOME * 0.0, HOME * 0.0], nobody())
    decision = filter.decide(scene, 3.0 * JERK)
    assert decision.status == Status.PROJECTED
    assert "jerk bounds" in decision.reason
    np.testing.assert_array_equal(decision.jerk, filter.robot.limits.jerk)


@pytest.mark.long
def test_closest_rows_keep_the_closest_pair(robot, random_scene):
    chosen = JSSAFilter(robot, DT, rows="closest")
    everything = JSSAFilter(robot, DT)
    different = 0
    for scene, nominal, decision in statuses(chosen, random_scene, {Status.PROJECTED: 12}, motion=0.25):
        if decision.rows:
            assert decision.rows == 1
            assert min(phis(scene, decision.jerk).values()) <= TOLERANCE
        different += not np.allclose(everything.decide(scene, nominal).jerk, decision.jerk)
    assert different > 0


def test_osqp_agrees_with_the_exact_projector(robot, random_scene):
    exact, osqp = JSSAFilter(robot, DT), JSSAFilter(robot, DT, projector="osqp")
    notes = 0
    for scene, nominal, decision in statuses(exact, random_scene, {Status.PROJECTED: 40}, motion=0.25, seed=5):
        other = osqp.decide(scene, nominal)
        assert other.status == decision.status
        np.testing.assert_allclose(other.jerk / JERK, decision.jerk / JERK, atol=1e-6)
        notes += "repaired" in other.reason
    # it did the work itself, mostly
    assert notes < 20


@pytest.mark.parametrize("projector", list(PROJECTORS))
def test_weights_move_the_correction_to_the_light_joints(robot, random_scene, projector):
    heavy = np.array([1e3, 1.0, 1.0, 1.0, 1.0, 1.0])
    plain, weighted = (
        JSSAFilter(robot, DT, projector=projector),
        JSSAFilter(robot, DT, weight=heavy, projector=projector),
    )
    moved, seen = np.zeros(2), 0
    for scene, nominal, decision in statuses(plain, random_scene, {Status.PROJECTED: 15}, motion=0.25, seed=6):
        other = weighted.decide(scene, nominal)
        if decision.rows == 0 or other.status != Status.PROJECTED:
            continue
        seen += 1
        assert other.slack <= TOLERANCE
        cost = [float((d.jerk - nominal) @ (heavy * (d.jerk - nominal))) for d in (decision, other)]
        assert cost[1] <= cost[0] * (1.0 + 1e-6)
        moved += [abs(d.jerk[0] - nominal[0]) for d in (decision, other)]
    assert seen >= 5
    assert moved[1] < 0.5 * moved[0]


@pytest.mark.long
def test_a_full_weight_is_the_metric_of_the_projection(robot, random_scene):
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 6))
    V = root @ root.T + 0.5 * np.eye(6)
    chosen, plain = (JSSAFilter(robot, DT, weight=weight, min_authority=0.0) for weight in (V, None))
    saved = []
    for scene, nominal, decision in statuses(chosen, random_scene, {Status.PROJECTED: 4}, motion=0.25, seed=7):
        L, S = rows_near(scene, decision)
        nearest = ref.project_reference(nominal, L, S, -JERK, JERK, V)
        other = plain.decide(scene, nominal).jerk
        cost = [float((jerk - nominal) @ V @ (jerk - nominal)) for jerk in (nearest, decision.jerk, other)]
        # the rows are linearised at the nominal there and at the answer here
        assert cost[1] == pytest.approx(cost[0], rel=1e-2)
        saved.append(cost[1] / cost[2])
    assert max(saved) < 1.001
    assert min(saved) < 0.9


def rows_near(scene, decision, reach=5.0):
    """Rows of the pairs whose index is not far below zero, linearised at the decision's jerk."""
    ahead = phis(scene, decision.jerk)
    close = [pair for pair, value in ahead.items() if value > max(ahead.values()) - reach]
    L = np.array([row(scene, decision.jerk, pair) for pair in close])
    return L, np.array([ahead[pair] for pair in close]) + L @ decision.jerk


@pytest.mark.parametrize("somebody", [False, True])
def test_static_rows_make_the_table_an_agent(robot, make_scene, somebody):
    # the tool above the table, falling
    position = np.radians([0.0, 60.0, -20.0, 0.0, -60.0, 0.0])
    state = [position, np.array([0.0, 1.5, 0.0, 0.0, 0.0, 0.0]), np.zeros(6)]
    scene = make_scene(state, Body.facing().at((3.0, 0.0), (0.0, 0.0)) if somebody else nobody())
    without, with_rows = JSSAFilter(robot, DT), JSSAFilter(robot, DT, static_rows=True)
    assert without.decide(scene, np.zeros(6)).status == Status.NOMINAL
    decision = with_rows.decide(scene, np.zeros(6))
    assert decision.status in (Status.PROJECTED, Status.RELAXED)
    # the pair and its distance are those of people
    assert (decision.distance, decision.pair) == (np.inf, (-1, -1)) or somebody
    assert decision.pair[1] < 6


def test_a_static_capsule_makes_rows_too(robot, make_scene):
    tip = ref.point(CHAIN, HOME, 5, (0.16, 0.0, 0.0))
    zero = np.zeros((1, 3))
    post = CapsuleSet(
        tip[None] + [0.25, 0.0, -0.2],
        tip[None] + [0.25, 0.0, 0.2],
        zero,
        zero,
        np.array([0.03]),
        ("post",),
        np.zeros(1, np.int64),
    )
    free = jssa_gym.types.Planes(np.zeros((0, 3)), np.zeros(0), ())
    leaning = make_scene([HOME, np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]), HOME * 0.0], nobody())
    scene = changed(leaning, "", static=post, planes=free)
    chosen = JSSAFilter(robot, DT, static_rows=True)
    for human in (nobody(), Body.facing().at((3.0, 0.0), (0.0, 0.0)), nobody()):
        decision = chosen.decide(changed(scene, "", human=human, **sized(human)), np.zeros(6))
        assert decision.status in (Status.PROJECTED, Status.RELAXED)
        assert decision.rows >= 1
        assert decision.pair[1] < len(human.radius)
    assert JSSAFilter(robot, DT).decide(scene, np.zeros(6)).status == Status.NOMINAL
    # that the post is elsewhere in the next scene is noticed
    far = post._replace(start=post.start + 9.0, end=post.end + 9.0)
    assert chosen.decide(changed(scene, "", static=far), np.zeros(6)).status == Status.NOMINAL


def sized(human):
    return {"age": np.zeros(len(human.radius)), "valid": np.ones(len(human.radius), bool)}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"rows": "some"}, ("rows", "all", "closest")),
        ({"gradient": "rough"}, ("gradient", "exact", "printed")),
        ({"projector": "magic"}, ("projector", "exact", "osqp")),
        ({"projector": []}, ("projector", "exact", "osqp")),
        ({"weight": np.ones(5)}, ("weight", "(6,)")),
        ({"weight": "heavy"}, ("weight",)),
        ({"weight": -np.ones(6)}, ("positive definite",)),
        ({"weight": np.triu(np.ones((6, 6)))}, ("symmetric",)),
        ({"weight": np.full(6, np.nan)}, ("weight", "finite")),
        ({"min_authority": -1.0}, ("min_authority",)),
        ({"min_authority": np.nan}, ("min_authority",)),
        ({"static_rows": True, "gradient": "printed"}, ("static_rows", "exact")),
        ({"static_rows": True, "rows": "closest"}, ("static_rows", "all")),
    ],
    ids=str,
)
def test_a_bad_option_is_named_with_the_valid_ones(robot, arguments, words):
    with pytest.raises(ParameterError) as caught:
        JSSAFilter(robot, DT, **arguments)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "arguments",
    [{"d_min": 0.0}, {"lambda1": -1.0}, {"lambda2": np.nan}, {"lambda1": 0.1}, {"d_min": np.inf}, {"lambda1": "x"}],
    ids=str,
)
def test_bad_index_parameters_are_refused(arguments):
    with pytest.raises(ParameterError):
        JSSAShield(gym.make("jssa_gym/Home-v0"), **arguments)


def test_the_index_condition_is_the_published_one():
    IndexParams(d_min=0.05, lambda1=np.sqrt(8.0 * 0.39 * 0.05) + 1e-9, lambda2=0.39)
    with pytest.raises(ParameterError, match="lambda1"):
        IndexParams(d_min=0.05, lambda1=np.sqrt(8.0 * 0.39 * 0.05) - 1e-9, lambda2=0.39)


# ---- projectors: never trust a solver -----------------------------------------------------------------


class _Answer:
    def __init__(self, x):
        self.x, self.y = x, None


def _raise(error):
    def solve(*_, **__):
        raise error

    return solve


def _say(x):
    return lambda *_, **__: _Answer(x)


SABOTAGE = {
    "raises": _raise(RuntimeError("boom")),
    "raises oddly": _raise(ZeroDivisionError()),
    "no answer": _say(None),
    "nan": _say(np.full(6, np.nan)),
    "inf": _say(np.array([np.inf, 0, 0, 0, 0, 0])),
    "zeros": _say(np.zeros(6)),
    "far outside": _say(np.full(6, -1e9)),
    "wrong shape": _say(np.zeros(4)),
    "a matrix": _say(np.zeros((6, 6))),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("how", list(SABOTAGE))
def test_a_sabotaged_solver_is_still_safe(robot, random_scene, how):
    exact, osqp = JSSAFilter(robot, DT), JSSAFilter(robot, DT, projector="osqp")
    for scene, nominal, decision in statuses(
        exact, random_scene, {Status.PROJECTED: 8, Status.RELAXED: 2}, motion=0.25, seed=8
    ):
        osqp.decide(scene, nominal)
        assert osqp.projector._solver is not None
        osqp.projector._solver.solve = SABOTAGE[how]
        other = osqp.decide(scene, nominal)
        check_decision(other, osqp)
        assert other.status == decision.status
        assert other.slack == pytest.approx(decision.slack, rel=1e-6, abs=TOLERANCE)
        # nor is it believed where it happens to keep all rows: it is not the nearest jerk that does
        assert "repaired" in other.reason
        np.testing.assert_allclose(other.jerk / JERK, decision.jerk / JERK, atol=1e-6)


def test_a_solver_that_cannot_be_set_up_is_replaced(robot, random_scene, monkeypatch):
    monkeypatch.setattr(OSQPProjector, "_setup", _raise(MemoryError()))
    osqp, exact = JSSAFilter(robot, DT, projector="osqp"), JSSAFilter(robot, DT)
    for scene, nominal, decision in statuses(exact, random_scene, {Status.PROJECTED: 5}, motion=0.25, seed=9):
        np.testing.assert_array_equal(osqp.decide(scene, nominal).jerk, decision.jerk)


def test_a_solver_that_crosses_a_row_slightly_is_not_believed(robot):
    L, S = np.array([[1e-3, 0, 0, 0, 0, 0]]), np.array([1e-2])
    projector = OSQPProjector(6)
    projector.project(np.zeros(6), HalfSpaces(L, S), -JERK, JERK)
    short = np.zeros(6)
    short[0] = 10.0 - 2e-6  # 2e-9 m² short of the row
    projector._solver.solve = _say(short / JERK.max())
    answer = projector.project(np.zeros(6), HalfSpaces(L, S), -JERK, JERK)
    assert "repaired" in answer.note
    assert answer.jerk[0] >= 10.0 - 1e-12


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", list(PROJECTORS))
@pytest.mark.parametrize("kind", ["identity", "diagonal", "full"])
def test_projectors_solve_random_problems(name, kind):
    rng = np.random.default_rng(10)
    root = rng.normal(size=(6, 6))
    weight = {"identity": None, "diagonal": rng.uniform(0.5, 3.0, 6), "full": root @ root.T + np.eye(6)}[kind]
    V = np.eye(6) if weight is None else np.diag(weight) if kind == "diagonal" else weight
    projector = PROJECTORS[name](6, weight)
    feasible = infeasible = 0
    for _ in range(60):
        m = int(rng.integers(1, 5))
        L = rng.normal(size=(m, 6)) * 1e-3
        S = L @ (rng.uniform(-1.0, 1.0, 6) * JERK) + rng.normal(size=m) * 0.15
        nominal = rng.uniform(-1.0, 1.0, 6) * JERK
        answer = projector.project(nominal, HalfSpaces(L, S), -JERK, JERK)
        assert np.all(np.abs(answer.jerk) <= JERK)
        least, _ = ref.least_violation(L, S, -JERK, JERK)
        left = max(float(np.max(S - L @ answer.jerk)), 0.0)
        assert answer.violation == pytest.approx(left, abs=1e-15)
        if least < -1e-6:
            feasible += 1
            assert answer.feasible
            assert left <= 1e-9
            expected = ref.project_reference(nominal, L, S, -JERK, JERK, V)
            np.testing.assert_allclose(answer.jerk / JERK, expected / JERK, atol=1e-5)
        elif least > 1e-6:
            infeasible += 1
            assert not answer.feasible
            assert left == pytest.approx(least, rel=1e-4, abs=1e-8)
    assert feasible > 10
    assert infeasible > 3


def test_osqp_takes_more_rows_than_it_was_set_up_for():
    rng, projector, exact = np.random.default_rng(11), OSQPProjector(6), ExactProjector(6)
    for m in (1, 7, 20, 3, 30):
        L = rng.normal(size=(m, 6)) * 1e-3
        rows = HalfSpaces(L, L @ (0.3 * JERK) - rng.uniform(0.0, 0.05, m))
        nominal = rng.uniform(-1.0, 1.0, 6) * JERK
        answer = projector.project(nominal, rows, -JERK, JERK)
        assert "raised" not in answer.note
        expected = exact.project(nominal, rows, -JERK, JERK).jerk
        np.testing.assert_allclose(answer.jerk / JERK, expected / JERK, atol=1e-5)


def test_a_projectors_answer_is_the_callers_to_keep():
    projector = ExactProjector(6)
    rows = HalfSpaces(np.array([[1e-3, 0, 0, 0, 0, 0]]), np.array([1e-2]))
    one = projector.project(np.zeros(6), rows, -JERK, JERK).jerk
    kept = one.copy()
    projector.project(np.ones(6), rows, -JERK, JERK)
    np.testing.assert_array_equal(one, kept)


# ---- the wrapper --------------------------------------------------------------------------------------


class Recorder(gym.Wrapper):
    """Keeps the very objects that arrive below the shield."""

    def __init__(self, env):
        super().__init__(env)
        self.arrived = []

    def step(self, action):
        self.arrived.append(action)
        return self.env.step(action)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_a_nominal_action_is_forwarded_as_a_copy_equal_in_values_and_type(dtype):
    below = Recorder(ArmEnv("home", human="none", terminate_on=()))
    env = JSSAShield(below)
    env.reset(seed=0)
    for k in range(50):
        action = np.random.default_rng(k).uniform(-1.0, 1.0, 6).astype(dtype)
        given = action.copy()
        *_, info = env.step(action)
        assert info["shield/status"] == Status.NOMINAL
        assert below.arrived[-1].dtype == dtype
        assert not np.shares_memory(below.arrived[-1], action)
        np.testing.assert_array_equal(below.arrived[-1], given)
        np.testing.assert_array_equal(action, given)
        np.testing.assert_array_equal(info["jerk"], env.last_decision.jerk)
        assert info["shield/intervened"] is False
        assert info["shield/correction"] == 0.0
        assert info["shield/reason"] == ""
    env.step([0.1] * 6)
    np.testing.assert_array_equal(below.arrived[-1], [0.1] * 6)


class TwoFaced:
    """An action that answers differently each time it is read."""

    def __init__(self):
        self.reads = 0

    def __array__(self, dtype=None, copy=None):
        self.reads += 1
        return np.zeros(6) if self.reads % 2 else np.ones(6)


def test_an_action_is_read_once():
    below = Recorder(ArmEnv("home", human="none", terminate_on=()))
    env = JSSAShield(below)
    env.reset(seed=0)
    for _ in range(100):
        action = TwoFaced()
        *_, info = env.step(action)
        assert action.reads == 1
        np.testing.assert_array_equal(info["jerk"], env.last_decision.jerk)
        assert not np.any(info["jerk"])


class Meddling(gym.Wrapper):
    """Changes the policy's array after the shield has looked at it, as another thread might."""

    policys = None

    @property
    def scene(self):
        if self.policys is not None:
            self.policys[:] = 1.0
        return self.env.get_wrapper_attr("scene")


def test_an_action_that_another_thread_changes_is_the_one_that_was_checked():
    below = Meddling(ArmEnv("home", human="none", terminate_on=()))
    env = JSSAShield(below)
    env.reset(seed=0)
    for _ in range(50):
        below.policys = np.zeros(6)
        *_, info = env.step(below.policys)
        assert below.policys[0] == 1.0
        np.testing.assert_array_equal(info["jerk"], env.last_decision.jerk)
        assert not np.any(info["jerk"])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("stop", [False, True])
def test_the_jerk_that_is_decided_is_the_jerk_that_is_integrated_to_the_bit(name, stop):
    env = ArmEnv("home", human="pursuit", terminate_on=())
    options = {"viability": True, "failsafe": FailsafeParams()} if stop else {}
    env = Shield(env, make_filter(name, env.robot, DT, **options))
    env.reset(seed=3)
    rng, changed, held = np.random.default_rng(1), 0, rng_action(np.random.default_rng(2))
    for k in range(400):
        if k % 12 == 0:
            held = rng_action(rng)
        *_, info = env.step(held)
        np.testing.assert_array_equal(info["jerk"], env.last_decision.jerk)
        changed += env.last_decision.status != Status.NOMINAL
    assert changed > 20 or name in ("none", "jssa_published")


def rng_action(rng):
    return rng.uniform(-1.2, 1.2, 6)


def test_a_corrected_action_is_float64_and_what_the_filter_decided():
    below = Recorder(ArmEnv("home", human=paper_scene(0.8), terminate_on=()))
    env = JSSAShield(below)
    observation, _ = env.reset(seed=0)
    policy = HoldPolicy(env)
    corrected = 0
    for _ in range(500):
        action = policy(observation).astype(np.float32)
        observation, _, _, _, info = env.step(action)
        decision = env.last_decision
        assert info["shield/status"] == decision.status
        np.testing.assert_array_equal(info["shield/phi"], decision.phi)
        np.testing.assert_array_equal(info["shield/slack"], decision.slack)
        assert (info["shield/robot_pair"], info["shield/human_pair"]) == decision.pair
        assert info["shield/reason"] == decision.reason
        if decision.status == Status.NOMINAL:
            np.testing.assert_array_equal(below.arrived[-1], action)
            assert below.arrived[-1].dtype == action.dtype
            continue
        corrected += 1
        assert below.arrived[-1].dtype == np.float64
        np.testing.assert_allclose(below.arrived[-1], decision.jerk / JERK, rtol=1e-15)
        np.testing.assert_array_equal(info["jerk"], decision.jerk)
        change = np.abs(decision.jerk / JERK - action).max()
        assert info["shield/correction"] == pytest.approx(change, rel=1e-9, abs=1e-15)
        assert info["shield/intervened"] == (info["shield/correction"] > 1e-6)
    assert corrected > 20


def test_pairs_and_distance_of_a_decision_are_those_of_the_end_of_the_step():
    env = JSSAShield(ArmEnv("home", human=paper_scene(0.8), terminate_on=()))
    observation, _ = env.reset(seed=0)
    policy = HoldPolicy(env)
    for _ in range(400):
        observation, _, _, _, info = env.step(policy(observation))
        assert env.last_decision.distance == pytest.approx(info["distance"], abs=1e-9)
        assert env.last_decision.pair == (env.unwrapped.closest.robot, env.unwrapped.closest.human)


GOOD_ACTIONS = {
    "float16": np.full(6, 0.5, np.float16),
    "float32": np.full(6, 0.5, np.float32),
    "longdouble": np.full(6, 0.5, np.longdouble),
    "int": np.ones(6, int),
    "uint8": np.ones(6, np.uint8),
    "list": [0.5] * 6,
    "tuple": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
    "subnormal": np.full(6, 5e-324),
    "negative zero": np.full(6, -0.0),
    "strided": np.full(12, 0.5)[::2],
    "reversed": np.linspace(0.0, 1.0, 6)[::-1],
    "beyond": np.array([5.0, -5.0, 2.0, 0.0, 0.0, 1.5]),
    "1e308": np.full(6, 1e308),
    "-1e308": np.full(6, -1.7e308),
    "large int": np.full(6, 2**62),
}
BAD_ACTIONS = {
    "()": np.float64(0.0),
    "(5,)": np.zeros(5),
    "(7,)": np.zeros(7),
    "(1, 6)": np.zeros((1, 6)),
    "(6, 1)": np.zeros((6, 1)),
    "(0,)": np.zeros(0),
    "None": None,
    "bool": np.ones(6, bool),
    "object": np.array([0.0] * 6, object),
    "Nones": [None] * 6,
    "string": "action",
    "strings": ["0.1"] * 6,
    "complex": np.zeros(6, complex),
    "datetime": np.zeros(6, "datetime64[s]"),
    "dict": {0: 0.0},
    "set": {0.0, 1.0},
    "ragged": [[0.0], [0.0, 1.0]],
    "short list": [0.0] * 5,
    "huge integers": [10**30] * 6,
    "generator": (0.0 for _ in range(6)),
}


@pytest.fixture(params=BARE)
def shielded(request):
    """An environment under a bare filter, a few steps into an episode, somebody in front."""
    bare = gym.make("jssa_gym/Home-v0", terminate_on=(), human="approach_retreat")
    env = Shield(bare, make_filter(request.param, bare.unwrapped.robot, DT))
    env.reset(seed=0)
    for action in np.random.default_rng(0).uniform(-0.5, 0.5, (15, 6)):
        env.step(action)
    return env


def test_a_finite_action_is_decided_whatever_its_form(shielded):
    for name, action in GOOD_ACTIONS.items():
        if isinstance(action, np.ndarray):
            action = action.copy() if name[0] != "s" and name != "reversed" else action
            action.flags.writeable = False
        observation, reward, _, _, info = shielded.step(action)
        assert info["shield/status"] != Status.FAULT, name
        assert np.isfinite(info["jerk"]).all(), name
        assert np.all(np.abs(info["jerk"]) <= JERK * (1.0 + 1e-15)), name
        assert np.isfinite(observation).all(), name
        assert np.isfinite(reward), name
        if isinstance(shielded.filter, NoFilter):
            wanted = np.clip(np.asarray(action, float), -1.0, 1.0)
            np.testing.assert_allclose(info["jerk"] / JERK, wanted, atol=1e-12, err_msg=name)
            beyond = np.abs(np.asarray(action, float)).max() > 1.0
            assert info["shield/status"] == (Status.PROJECTED if beyond else Status.NOMINAL), name


def test_a_wrong_shape_or_type_is_refused_before_anything_moves(shielded):
    for name, action in BAD_ACTIONS.items():
        scene, kept = shielded.unwrapped.scene, copy.deepcopy(shielded.unwrapped.scene)
        decision = shielded.last_decision
        with pytest.raises(InvalidActionError) as caught:
            shielded.step(action)
        assert isinstance(caught.value, ValueError), name
        assert isinstance(caught.value, jssa_gym.JSSAGymError), name
        assert "6" in str(caught.value), name
        assert shielded.unwrapped.scene is scene, name
        for ours, theirs in zip(arrays(scene), arrays(kept), strict=True):
            np.testing.assert_array_equal(ours, theirs, err_msg=name)
        assert shielded.last_decision is decision, name
        assert shielded.step(np.zeros(6))[4]["shield/status"] != Status.FAULT, name


NOT_FINITE = {
    "nan": np.full(6, np.nan),
    "one nan": np.array([0.0, 0.1, np.nan, 0.2, 0.0, 0.0]),
    "inf": np.full(6, np.inf),
    "-inf": np.array([0.0, 0.0, 0.0, 0.0, 0.0, -np.inf]),
    "signalling nan": np.full(6, 0x7FF0000000000001, np.uint64).view(np.float64),
    "float16 nan": np.full(6, np.nan, np.float16),
    "longdouble beyond": np.full(6, np.longdouble("1e4000")),
    "list nan": [np.nan] * 6,
}


def test_an_action_that_is_not_finite_is_a_fault_that_brakes(shielded):
    for name, action in NOT_FINITE.items():  # "longdouble beyond" is infinite where longdouble is float64
        scene = shielded.unwrapped.scene
        observation, reward, _, _, info = shielded.step(action)
        assert info["shield/status"] == Status.FAULT, name
        assert "not finite" in info["shield/reason"], name
        assert info["shield/intervened"] is True, name
        np.testing.assert_allclose(info["jerk"], braking(scene.robot), rtol=1e-9, atol=1e-9, err_msg=name)
        assert np.abs(info["jerk"]).max() > 0.0, name
        assert np.isfinite(observation).all(), name
        assert np.isfinite(reward), name


def test_torch_tensors(shielded):
    torch = pytest.importorskip("torch", reason="torch is not installed")
    assert shielded.step(torch.full((6,), 0.1))[4]["shield/status"] != Status.FAULT
    shielded.step(torch.full((6,), 3.0))
    for wrong in (torch.zeros(6, requires_grad=True), torch.zeros(5)):
        with pytest.raises(InvalidActionError):
            shielded.step(wrong)


@pytest.mark.parametrize("count", [400, pytest.param(100_000, marks=pytest.mark.slow)])
def test_random_bits_as_actions(count):
    env = JSSAShield(gym.make("jssa_gym/Reach-v0", terminate_on=()))
    env.reset(seed=0)
    rng, faults = np.random.default_rng(0), 0
    for k in range(count):
        if k % 500 == 0:
            env.reset(seed=k)
        action = rng.integers(0, 2**64, 6, np.uint64).view(np.float64)
        if k % 3 == 0:
            action = rng.choice([0.0, -0.0, 1.0, -1.0, 1e308, -1e308, 5e-324, np.nan, np.inf, 1.0 + 1e-16], 6)
        observation, _, _, truncated, info = env.step(action)
        faults += info["shield/status"] == Status.FAULT
        assert (info["shield/status"] == Status.FAULT) == (not np.isfinite(action).all())
        assert np.isfinite(info["jerk"]).all()
        assert np.all(np.abs(info["jerk"]) <= JERK * (1.0 + 1e-15))
        assert np.isfinite(observation).all()
        if truncated:
            env.reset()
    assert 0 < faults < count


@pytest.mark.sampled(8)
def test_faults_bring_the_arm_to_rest_and_keep_it_there(shielded):
    for action in np.random.default_rng(3).uniform(-1.0, 1.0, (40, 6)):
        shielded.step(action)
    speed = np.abs(shielded.unwrapped.scene.robot.velocity).max()
    assert speed > 0.05
    for _ in range(200):
        *_, info = shielded.step(np.full(6, np.nan))
        assert info["shield/status"] == Status.FAULT
    robot = shielded.unwrapped.scene.robot
    assert np.abs(robot.velocity).max() < 1e-9
    assert np.abs(robot.acceleration).max() < 1e-9
    where = robot.position.copy()
    for _ in range(50):
        *_, info = shielded.step(np.full(6, np.inf))
        assert np.abs(info["jerk"]).max() < 1e-5
    np.testing.assert_allclose(shielded.unwrapped.scene.robot.position, where, atol=1e-9)
    # and it goes on afterwards
    *_, info = shielded.step(np.zeros(6))
    assert info["shield/status"] != Status.FAULT


def test_reset_forgets_the_last_decision():
    env = JSSAShield(gym.make("jssa_gym/Home-v0"))
    env.reset(seed=0)
    assert env.last_decision is None
    env.step(np.zeros(6))
    assert env.last_decision is not None
    _, info = env.reset()
    assert env.last_decision is None
    assert (info["shield/status"], info["shield/reason"]) == (Status.NOMINAL, "")


def test_the_filter_is_reset_with_the_scene_of_the_new_episode():
    class Remembers(NoFilter):
        def reset(self, scene):
            super().reset(scene)
            self.scene = scene

    bare = ArmEnv("home")
    env = Shield(bare, Remembers(bare.robot, DT))
    env.reset(seed=0, options={"joint_position": HOME + 0.1})
    assert env.filter.scene is bare.scene
    assert env.filter.scene.time == 0.0


# ---- a degraded sensor between shield and environment -------------------------------------------------


class Blindfold(gym.Wrapper):
    """A sensor that loses a human capsule from some step on."""

    def __init__(self, env, after):
        super().__init__(env)
        self.after = after

    @property
    def scene(self):
        scene = self.env.unwrapped.scene
        if scene.time < self.after:
            return scene
        valid = scene.valid.copy()
        valid[1] = False
        return scene._replace(valid=valid)


class Dark(gym.Wrapper):
    """A sensor that breaks down altogether."""

    dark = False

    @property
    def scene(self):
        if self.dark:
            raise ConnectionError("no camera")
        return self.env.unwrapped.scene


def test_a_scene_that_cannot_be_had_is_a_fault_that_brakes():
    sensor = Dark(gym.make("jssa_gym/Home-v0", human="none", terminate_on=()))
    env = JSSAShield(sensor)
    env.reset(seed=0)
    for _ in range(20):
        env.step(np.full(6, 0.5))
    assert np.abs(env.unwrapped.scene.robot.velocity).min() > 0.01
    sensor.dark = True
    for _ in range(200):
        *_, info = env.step(np.full(6, 0.5))
        assert info["shield/status"] == Status.FAULT
    assert np.abs(env.unwrapped.scene.robot.velocity).max() < 1e-6


def test_the_shield_reads_the_outermost_scene():
    env = JSSAShield(Blindfold(gym.make("jssa_gym/Home-v0", terminate_on=()), 0.1), failsafe=False)
    env.reset(seed=0)
    seen = [env.step(np.full(6, 0.3))[4]["shield/status"] for _ in range(40)]
    assert Status.FAULT not in seen[:13]
    assert set(seen[14:]) == {Status.FAULT}


# ---- environments that are not ours -------------------------------------------------------------------


class ToyEnv(gym.Env):
    """A user's planar arm: three joints, a ball that comes along the x axis, thirty lines."""

    def __init__(self, robot, dt=0.02):
        self.robot, self.dt = robot, dt
        self.state, self.time, self.ball = np.zeros((3, 3)), 0.0, 1.6
        self.action_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.observation_space = gym.spaces.Box(-10.0, 10.0, (9,), np.float64)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state, self.time, self.ball = (np.array([0.3, 0.0, 0.0]), np.zeros(3), np.zeros(3)), 0.0, 1.6
        return np.concatenate(self.state), {}

    def step(self, action):
        self.state = ref.triple_integrator(*self.state, np.asarray(action) * self.robot.limits.jerk, self.dt)
        self.time, self.ball = self.time + self.dt, max(self.ball - 0.5 * self.dt, 0.6)
        axis = [ref.rodrigues([0, 0, 1], sum(self.state[0][: i + 1])) @ [0.3, 0, 0] for i in range(3)]
        ends = [np.array([0.0, 0.0, 0.1]), *(np.array([0, 0, 0.1]) + np.cumsum(axis, axis=0))]
        ends[3] = ends[2] + (ends[3] - ends[2]) * 2.0 / 3.0
        here = np.array([self.ball, 0.0, 0.1])
        gaps = [ref.segment_distance(ends[i], ends[i + 1], here, here)[0] - [0.04, 0.03, 0.03][i] for i in range(3)]
        return np.concatenate(self.state), 0.0, False, False, {"distance": min(gaps) - 0.1}

    @property
    def scene(self):
        here, walk = np.array([[self.ball, 0.0, 0.1]]), np.array([[-0.5 if self.ball > 0.6 else 0.0, 0.0, 0.0]])
        ball = CapsuleSet(here, here, walk, walk, np.array([0.1]), ("ball",), np.zeros(1, np.int64))
        nothing = jssa_gym.types.Planes(np.zeros((0, 3)), np.zeros(0), ())
        return Scene(self.time, JointState(*self.state), ball, nobody(), nothing, np.zeros(1), np.ones(1, bool))


def toy_run(env, steps=250):
    """Smallest distance while a policy turns the arm towards the x axis, where the ball is."""
    env.reset(seed=0)
    smallest, statuses_seen = np.inf, set()
    base = env.unwrapped
    for _ in range(steps):
        position, velocity, acceleration = base.state
        wanted = np.clip(4.0 * (np.clip(3.0 * -position, -0.8, 0.8) - velocity), -3.0, 3.0)
        jerk = 15.0 * (wanted - acceleration)
        *_, info = env.step(np.clip(jerk / 80.0, -1.0, 1.0))
        smallest = min(smallest, info["distance"])
        statuses_seen.add(info.get("shield/status"))
    return smallest, statuses_seen


def test_a_shield_protects_around_a_users_own_arm(toy_robot):
    bare, _ = toy_run(ToyEnv(toy_robot))
    assert bare < 0.0
    shield = JSSAShield(ToyEnv(toy_robot))
    smallest, seen = toy_run(shield)
    assert smallest > 0.05 - 1e-3
    assert Status.PROJECTED in seen
    assert Status.FAULT not in seen


def test_an_environment_needs_robot_dt_and_scene(toy_robot):
    class Bare(gym.Env):
        action_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
        observation_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)

    for offered, missing in (({}, "robot"), ({"dt": 0.02}, "robot"), ({"robot": toy_robot}, "dt")):
        env = Bare()
        for name, value in offered.items():
            setattr(env, name, value)
        for build in (lambda env=env: Shield(env, NoFilter(toy_robot, 0.02)), lambda env=env: JSSAShield(env)):
            with pytest.raises(InterfaceError, match=f"no attribute '{missing}'"):
                build()
    # an environment may know its scene only once it has been reset; if it then has none, that is an error
    env = Bare()
    env.robot, env.dt, env.reset = toy_robot, 0.02, lambda **_: (np.zeros(3), {})
    with pytest.raises(InterfaceError, match="no attribute 'scene'"):
        Shield(env, NoFilter(toy_robot, 0.02)).reset()
    env = Bare()
    env.scene, env.dt, env.robot = None, 0.02, "lr_mate"
    for build in (lambda: Shield(env, NoFilter(toy_robot, 0.02)), lambda: JSSAShield(env)):
        with pytest.raises(InterfaceError, match="RobotModel, got str") as caught:
            build()
        assert isinstance(caught.value, TypeError)


@pytest.mark.parametrize("wrong", [NoFilter, 3, None])
def test_what_is_no_filter_is_refused(toy_robot, wrong):
    with pytest.raises(ParameterError, match="a filter is a name or a SafetyFilter built"):
        Shield(ToyEnv(toy_robot), wrong)


def test_a_filter_for_another_time_step_is_refused_with_both(toy_robot):
    with pytest.raises(InterfaceError, match=r"0\.008.*0\.02"):
        Shield(ToyEnv(toy_robot), NoFilter(toy_robot, 0.008))


def test_a_filter_for_another_robot_is_refused_with_both(toy_robot, robot):
    with pytest.raises(InterfaceError, match=r"lr_mate_200id_7l.*toy"):
        Shield(ToyEnv(toy_robot), NoFilter(robot, 0.02))
    elsewhere = toy_robot.mounted([0.0, 0.0, 0.5])
    with pytest.raises(InterfaceError, match=r"0\.5.*0\."):
        Shield(ToyEnv(toy_robot), NoFilter(elsewhere, 0.02))
    limits = toy_robot.limits
    for name in ("jerk", "velocity", "acceleration"):
        values = {n: getattr(limits, n) for n in ("position", "velocity", "acceleration", "jerk")}
        values[name] = values[name] * 2.0
        with pytest.raises(InterfaceError, match="limits"):
            Shield(ToyEnv(toy_robot), NoFilter(toy_robot.with_limits(JointLimits(**values)), 0.02))
    # an equal one, built again, is as good
    Shield(ToyEnv(toy_robot), NoFilter(toy_robot.with_limits(limits).mounted([0.0, 0.0, 0.0]), 0.02))


@pytest.mark.parametrize(
    ("space", "word"),
    [
        (gym.spaces.Box(-1.0, 1.0, (4,), np.float32), r"\(4,\).*3 joints"),
        (gym.spaces.Box(-2.0, 2.0, (3,), np.float32), r"\[-1, 1\]"),
        (gym.spaces.Box(-1.0, np.float32([1.0, 1.0, 0.5]), (3,), np.float32), r"\[-1, 1\]"),
        (gym.spaces.Discrete(3), "shape"),
    ],
    ids=str,
)
def test_another_action_space_is_refused(toy_robot, space, word):
    env = ToyEnv(toy_robot)
    env.action_space = space
    with pytest.raises(InterfaceError, match=word):
        JSSAShield(env)


def test_what_makes_something_else_of_a_jerk_belongs_outside():
    for wrap in (
        lambda env: jssa_gym.JPCAction(env),
        lambda env: jssa_gym.JPCAction(env, mode="velocity"),
        lambda env: jssa_gym.ActionRepeat(env, 5),
    ):
        inside = gym.wrappers.TransformReward(wrap(gym.make("jssa_gym/Home-v0")), float)
        with pytest.raises(InterfaceError, match=r"(JPCAction|ActionRepeat) belongs outside the shield"):
            JSSAShield(inside)
        wrap(JSSAShield(gym.make("jssa_gym/Home-v0")))


# ---- the paper ----------------------------------------------------------------------------------------


def test_as_published_is_the_papers_setting():
    env = JSSAShield.as_published(gym.make("jssa_gym/Home-v0"))
    index = env.filter.index
    assert (index.lambda1, index.lambda2, index.d_min, index.sliding) == (3.0, 1.0, 0.05, False)
    assert (env.filter.rows, env.filter.gradient, env.filter.static_rows) == ("closest", "printed", False)
    np.testing.assert_allclose(env.filter.upper, JERK)
    np.testing.assert_allclose(env.filter.lower, -JERK)
    named = make_filter("jssa_published", env.unwrapped.robot, DT)
    assert (named.index, named.rows, named.gradient) == (index, "closest", "printed")


def printed(scene, robot_pair, human_pair):
    """The row of Eq. (13) for the closest surface points, from the reference."""
    state, human = scene.robot, scene.human
    _, link, start, end, radius = ref.LR_MATE_CAPSULES[robot_pair]
    a0, a1 = (ref.point(CHAIN, state.position, link, x) for x in (start, end))
    b0, b1 = human.start[human_pair], human.end[human_pair]
    _, s, r = ref.segment_distance(a0, a1, b0, b1)
    on_axis, on_human = a0 + s * (a1 - a0), b0 + r * (b1 - b0)
    n = (on_axis - on_human) / np.linalg.norm(on_axis - on_human)
    walk = human.start_velocity[human_pair]
    pose = ref.link_poses(CHAIN, state.position)[link]
    local = pose[:3, :3].T @ (on_axis - radius * n - pose[:3, 3])
    motion = (CHAIN, state.position, state.velocity, state.acceleration, np.zeros(6), link, local)
    p, v, a, drift = ref.point_motion(*motion)
    delta_p = p + DT * v + DT**2 / 2 * a + DT**3 / 6 * drift - (on_human + human.radius[human_pair] * n + DT * walk)
    delta_v = v + DT * a + DT**2 / 2 * drift - walk
    delta_a = a + DT * drift
    return ref.printed_row(
        delta_p, delta_v, delta_a, ref.jacobian(CHAIN, state.position, link, local), DT, 0.05, 3.0, 1.0
    )


def test_the_published_shield_keeps_the_printed_row_by_the_nearest_jerk(robot, random_scene):
    published = make_filter("jssa_published", robot, DT)
    wanted = {Status.NOMINAL: 4, Status.PROJECTED: 10, Status.RELAXED: 2}
    for scene, nominal, decision in statuses(published, random_scene, wanted, motion=0.15, near=0.75, seed=11):
        if decision.distance < 0.01:
            continue
        L, S = printed(scene, *decision.pair)
        scale = np.abs(L) @ JERK
        if decision.status == Status.RELAXED:
            assert scale < S
            np.testing.assert_array_equal(decision.jerk, np.sign(L) * JERK * (L != 0.0) + decision.jerk * (L == 0.0))
            continue
        assert L @ decision.jerk >= S - 1e-9 * max(1.0, scale)
        nearest = ref.project_reference(nominal, L[None], [S], -JERK, JERK, np.eye(6))
        np.testing.assert_allclose(decision.jerk / JERK, nearest / JERK, atol=1e-6)
        assert (decision.status == Status.NOMINAL) == bool(L @ nominal >= S)


def test_printed_rows_of_all_pairs_are_kept_too(robot, random_scene):
    chosen = JSSAFilter(robot, DT, IndexParams(lambda1=3.0, lambda2=1.0), gradient="printed", min_authority=0.0)
    for scene, _, decision in statuses(chosen, random_scene, {Status.PROJECTED: 5}, motion=0.1, near=0.9, seed=12):
        if decision.distance < 0.01:
            continue
        for pair in PAIRS:
            L, S = printed(scene, *pair)
            assert L @ decision.jerk >= S - 1e-6 * max(1.0, np.abs(L) @ JERK)


# ---- safety, two-sided --------------------------------------------------------------------------------


def hold(env, steps=1000):
    """Infos of an episode of holding the home position, and the joint states."""
    observation, _ = env.reset(seed=0)
    policy = HoldPolicy(env)
    seen = []
    for _ in range(steps):
        observation, _, terminated, truncated, info = env.step(policy(observation))
        seen.append(info)
        if terminated or truncated:
            break
    return seen


@pytest.mark.sampled(1)
@pytest.mark.parametrize("speed", [0.4, 0.8])
@pytest.mark.parametrize(
    "options",
    [{}, {"projector": "osqp"}, {"lambda1": 3.0, "lambda2": 1.0}, {"weight": [5.0, 1.0, 1.0, 1.0, 1.0, 1.0]}],
    ids=str,
)
def test_the_shield_keeps_the_paper_scene_free_of_contact(speed, options):
    bare = hold(gym.make("jssa_gym/Home-v0", human=paper_scene(speed), terminate_on=()))
    assert min(info["distance"] for info in bare) < 0.05
    assert any(info["contact"] for info in bare)
    assert any(info["cost"] for info in bare)
    shielded = hold(JSSAShield(gym.make("jssa_gym/Home-v0", human=paper_scene(speed), terminate_on=()), **options))
    assert len(shielded) == len(bare) == 1000
    assert min(info["distance"] for info in shielded) > 0.05
    assert not any(info["contact"] or info["cost"] for info in shielded)
    assert any(info["shield/intervened"] for info in shielded)
    assert not any(info["shield/status"] == Status.FAULT for info in shielded)


def lowest(env, steps=200):
    """Height of the arm's lowest surface above the table while the shoulder is driven down."""
    env.reset(seed=0)
    heights = []
    target = np.radians([0.0, 100.0, 0.0, 0.0, -90.0, 0.0])
    policy = HoldPolicy(env, target)
    for _ in range(steps):
        env.step(policy(None))
        capsules = env.unwrapped.robot_capsules
        ends = np.minimum(capsules.start[1:, 2], capsules.end[1:, 2]) - capsules.radius[1:]
        heights.append(float(ends.min()) - TABLE)
    return min(heights)


def test_static_rows_keep_the_arm_off_the_table():
    make = lambda: gym.make("jssa_gym/Home-v0", human="none", terminate_on=())  # noqa: E731
    assert lowest(JSSAShield(make(), failsafe=False)) < -0.05
    assert lowest(JSSAShield(make(), failsafe=False, static_rows=True)) > 0.0
    assert lowest(JSSAShield(make())) > 0.0


# ---- repeated actions ---------------------------------------------------------------------------------


def test_action_repeat_tells_about_all_ticks():
    def build():
        return JSSAShield(gym.make("jssa_gym/Home-v0", human=paper_scene(0.8), terminate_on=(), max_episode_steps=303))

    repeated, single = jssa_gym.ActionRepeat(build(), 5), build()
    repeated.reset(seed=0)
    single.reset(seed=0)
    rng, compared = np.random.default_rng(0), 0
    while True:
        action = rng.uniform(-0.6, 0.6, 6)
        observation, reward, terminated, truncated, info = repeated.step(action)
        seen, rewards = [], 0.0
        for _ in range(5):
            expected, one, *flags, tick = single.step(action)
            seen.append(tick)
            rewards += one
            if any(flags):
                break
        np.testing.assert_array_equal(observation, expected)
        assert reward == pytest.approx(rewards, abs=1e-12)
        assert [terminated, truncated] == flags
        assert info["distance"] == min(i["distance"] for i in seen)
        assert info["cost"] == sum(i["cost"] for i in seen)
        for key in ("contact", "limit_violation", "success", "shield/intervened"):
            assert info[key] is any(i[key] for i in seen)
        for key in ("contact_speed", "shield/status", "shield/phi", "shield/correction", "shield/slack"):
            # NaN, what a stored stop leaves of the rows, is not hidden
            np.testing.assert_array_equal(info[key], np.max([i[key] for i in seen]))
        np.testing.assert_array_equal(info["jerk"], seen[-1]["jerk"])
        compared += 1
        if truncated:
            break
    assert compared == 61
    assert len(seen) == 3


def test_a_fault_in_any_tick_is_not_hidden_by_repetition():
    class Stutter(gym.ActionWrapper):
        """Every second action arrives as NaN."""

        count = 0

        def action(self, action):
            self.count += 1
            return np.full(6, np.nan) if self.count % 2 == self.parity else action

    for parity in (0, 1):
        inner = Stutter(JSSAShield(gym.make("jssa_gym/Home-v0", terminate_on=())))
        inner.parity = parity
        env = jssa_gym.ActionRepeat(inner, 2)
        env.reset(seed=0)
        *_, info = env.step(np.zeros(6))
        assert info["shield/status"] == Status.FAULT
        assert info["shield/intervened"] is True
        # NaN in one tick: the same answer whichever tick it was
        assert np.isnan(info["shield/correction"])
        assert np.isnan(info["shield/phi"])


@pytest.mark.parametrize("ticks", [0, -1, 2.5, "5", None])
def test_ticks_are_a_positive_integer(ticks):
    with pytest.raises(ParameterError, match="ticks"):
        jssa_gym.ActionRepeat(gym.make("jssa_gym/Home-v0"), ticks)


def test_action_repeat_works_without_a_shield_and_passes_reset_on():
    env = jssa_gym.ActionRepeat(gym.make("jssa_gym/Reach-v0", human="none"), 3)
    env.reset(seed=0, options={"joint_position": HOME + 0.1})
    *_, info = env.step(np.zeros(6))
    assert info["distance"] == np.inf
    assert env.unwrapped.scene.time == pytest.approx(3 * DT)
    assert not any(key.startswith("shield/") for key in info)
