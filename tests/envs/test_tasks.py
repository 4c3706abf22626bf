"""Track and Handover against hand computation; each by somebody who does it and somebody who does not."""

import gymnasium as gym
import numpy as np
import pytest
import reference as ref
from places import DOCS
from scipy.optimize import least_squares

import jssa_gym
from jssa_gym.control import Cascade
from jssa_gym.envs import ArmEnv
from jssa_gym.envs.tasks import TASKS, Handover, Progress, Reach, Track
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import HUMANS, HumanMotion, Nobody, RandomWalk, Receive, nobody
from jssa_gym.policies import StraightPolicy
from jssa_gym.safety.proximity import measure
from jssa_gym.types import CapsuleSet, JointState

DT, TABLE = 0.008, 0.87
OFFSET = 0.27
"""Of the handover's goal from the hand [m]."""
HOME = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0])
CHAIN = ref.lr_mate_chain()


def root_mean_square(gap):
    return float(np.sqrt(np.mean(np.square(gap))))


def minimum_jerk(begin, end, T, t):
    """Position, velocity, acceleration, jerk of the quintic between two rests, its six conditions solved."""
    powers = np.arange(6)

    def row(time, derivative):
        factors = np.array([np.prod(np.arange(p, p - derivative, -1)) if p >= derivative else 0 for p in powers])
        return factors * np.where(powers >= derivative, float(time) ** np.maximum(powers - derivative, 0), 0.0)

    matrix = np.array([row(time, d) for time in (0.0, T) for d in range(3)])
    right = np.array([begin, 0 * begin, 0 * begin, end, 0 * begin, 0 * begin])
    coefficients = np.linalg.solve(matrix, right)
    return [row(t, d) @ coefficients for d in range(4)]


# ---- Track --------------------------------------------------------------------------------------------


def track(**options):
    return ArmEnv("track", human="none", terminate_on=(), **options)


def put(env, position, velocity=0.0):
    """Put the arm somewhere; a step without jerk then measures it there."""
    env.state[0], env.state[1], env.state[2] = position, velocity, 0.0
    return env.step(np.zeros(6))


@pytest.mark.long
def test_the_reference_followed_succeeds_when_it_is_over():
    env = track()
    for seed in range(3):
        env.reset(seed=seed)
        legs = [HOME, *env.goal]
        visits, successes = [], []
        for k in range(800):
            leg, time = min(k * DT // 1.5, 3), (k + 0.5) * DT
            nominal = np.zeros(6)
            if k * DT < 6.0:
                target, rate, change, jerk = minimum_jerk(legs[int(leg)], legs[int(leg) + 1], 1.5, time - 1.5 * leg)
                position, velocity, acceleration = env.state + 0.0
                nominal = jerk + 1e3 * (target - position) + 3e2 * (rate - velocity) + 30.0 * (change - acceleration)
            _, reward, _, _, info = env.step(np.clip(nominal / env.robot.limits.jerk, -1.0, 1.0))
            visits.append(info["track/visited"])
            successes.append(info["success"])
            # the reference after this step, worked out anew
            now = min((k + 1) * DT, 6.0)
            leg = min(int(now / 1.5 - 1e-9), 3)
            expected, *_ = minimum_jerk(legs[leg], legs[leg + 1], 1.5, now - 1.5 * leg)
            error = root_mean_square(env.scene.robot.position - expected)
            assert info["track/error"] == pytest.approx(error, abs=1e-9)
            assert info["reward/track"] == pytest.approx(-error, abs=1e-9)
            assert reward == pytest.approx(sum(v for key, v in info.items() if key.startswith("reward/")), abs=1e-12)
            assert error < 0.02
        assert info["track/lateness"] == 0.0
        assert visits[-1] == 4
        # each waypoint as the reference comes near it, before it is due
        for waypoint in range(4):
            assert 1.0 < visits.index(waypoint + 1) * DT - 1.5 * waypoint <= 1.5
        assert successes.index(True) * DT == pytest.approx(6.1, abs=0.02)


def test_somebody_who_stays_at_home_is_late_and_fails():
    env = track()
    env.reset(seed=0)
    for _ in range(1000):
        *_, info = env.step(np.zeros(6))
    assert info["success"] is False
    assert info["track/visited"] == 0
    # the reference has waited at the first waypoint since 1.5 s
    assert info["track/lateness"] == pytest.approx(8.0 - 1.5, abs=1e-9)
    assert info["track/error"] == pytest.approx(root_mean_square(env.goal[0] - HOME), abs=1e-12)


def test_waypoints_count_in_their_order_only():
    env = track()
    env.reset(seed=0, options={"goal": [HOME + 0.3, HOME + 0.6, HOME - 0.3]})
    one, two, three = env.goal
    seen = [put(env, place)[-1]["track/visited"] for place in (two, three, HOME, one, three, one, two, two, one, three)]
    assert seen == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3]
    assert not env.step(np.zeros(6))[-1]["success"]


@pytest.mark.parametrize(("gap", "counts"), [(0.0499, True), (0.0501, False)])
def test_a_waypoint_is_visited_within_its_tolerance(gap, counts):
    env = track()
    env.reset(seed=0)
    offset = np.array([np.sqrt(6.0) * gap, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert put(env, env.goal[0] + offset)[-1]["track/visited"] == counts


def test_lateness_is_the_time_that_the_reference_waited():
    env = track()
    env.reset(seed=0, options={"goal": [HOME + 0.3, HOME + 0.6]})
    one, two = env.goal
    for _ in range(250):  # 2 s at home: 0.5 s late
        *_, info = env.step(np.zeros(6))
    assert info["track/lateness"] == pytest.approx(0.5, abs=1e-9)
    for _ in range(250):  # 2 s at the first: on time for 1.5 s, late again
        *_, info = put(env, one)
    # the visit itself takes the step in which it is seen
    assert info["track/lateness"] == pytest.approx(1.0, abs=2 * DT)
    for k in range(40):
        *_, info = put(env, two)
        assert info["success"] == (k >= 12)  # however late
    assert info["track/visited"] == 2


def test_being_early_does_not_end_it():
    env = track()
    env.reset(seed=0, options={"goal": [HOME + 0.3, HOME + 0.6]})
    successes = []
    for k in range(400):
        *_, info = put(env, env.goal[0] if k == 0 else env.goal[1])
        successes.append(info["success"])
    assert successes.index(True) == pytest.approx(3.1 / DT, abs=2)
    assert info["track/lateness"] == 0.0


@pytest.mark.parametrize(("speed", "expected"), [(0.049, True), (0.051, False)])
def test_the_joints_have_to_be_at_rest_even_where_the_tip_is(speed, expected):
    # joint 6 turns about the tip's own axis
    env = track()
    env.reset(seed=0, options={"goal": [HOME]})
    seen = [put(env, HOME, [0.0] * 5 + [np.sqrt(6.0) * speed])[-1]["success"] for _ in range(220)]
    assert any(seen) is expected


def test_an_episode_may_begin_elsewhere():
    env = track()
    start = HOME + 0.2
    env.reset(seed=0, options={"joint_position": start, "goal": [HOME + 0.8]})
    for _ in range(94):
        *_, info = env.step(np.zeros(6))
    expected, *_ = minimum_jerk(start, HOME + 0.8, 1.5, 94 * DT)
    assert info["track/error"] == pytest.approx(root_mean_square(expected - start), abs=1e-9)
    # a task alone, without a start, waits at its first waypoint
    np.testing.assert_allclose(env.task.reference(env.goal, Progress(clock=0.3)), HOME + 0.8, atol=1e-12)


@pytest.mark.long
def test_drawn_waypoints_are_reachable_in_time_and_clear(robot):
    env, goals = track(), []
    limits = robot.limits
    low, high = limits.position.T
    for seed in range(12):
        env.reset(seed=seed)
        goals.append(env.goal)
        assert env.goal.shape == (4, 6)
        for begin, end in zip([HOME, *env.goal], env.goal, strict=False):
            assert root_mean_square(end - begin) >= 0.2
            for t in np.linspace(0.0, 1.5, 31):
                position, velocity, acceleration, jerk = minimum_jerk(begin, end, 1.5, t)
                assert np.all((low < position) & (position < high))
                assert np.all(np.abs(velocity) <= 0.5 * limits.velocity)
                assert np.all(np.abs(acceleration) <= 0.5 * limits.acceleration)
                assert np.all(np.abs(jerk) <= 0.5 * limits.jerk + 1e-9)
                state = JointState(position, np.zeros(6), np.zeros(6))
                near = measure(robot, state, nobody(), env.planes)
                # 0.05 m at ten points of the way; between them not much less
                assert min(near.own.min(), near.planes.min()) > 0.02
    assert np.ptp([goal[0] for goal in goals], axis=0).min() > 0.3
    env.reset(seed=3)
    np.testing.assert_array_equal(env.goal, goals[3])


@pytest.mark.parametrize(
    "goal",
    [
        *([], [[]], 3.0, HOME, "home", np.zeros((2, 5)), np.zeros((2, 3, 6)), np.array(1.0)),
        *([HOME, HOME + np.nan], [HOME + 9.0], [[1.0], [2.0, 3.0]]),
    ],
    ids=str,
)
def test_bad_waypoints_are_refused_before_anything_changes(goal):
    env = track()
    env.reset(seed=0)
    before = env.goal
    with pytest.raises(ParameterError, match=r"waypoints"):
        env.reset(seed=1, options={"goal": goal})
    np.testing.assert_array_equal(env.goal, before)


@pytest.mark.parametrize(
    ("task", "goal", "told"),
    [
        ("reach", [5.0, 5.0, 5.0], r"cannot be reached: lr_mate_200id_7l is \d\.\d\d m long"),
        ("home", [9.0, 0.0, 0.0, 0.0, 0.0, 0.0], "inside the position limits"),
    ],
)
def test_goals_out_of_reach_are_refused_before_anything_changes(task, goal, told):
    env = ArmEnv(task, human="none")
    env.reset(seed=0)
    before = env.goal
    with pytest.raises(ParameterError, match=told):
        env.reset(seed=1, options={"goal": goal})
    np.testing.assert_array_equal(env.goal, before)


@pytest.mark.parametrize("count", [1, 3, 9])
def test_any_number_of_waypoints_is_observed_alike(count):
    env = track()
    observation, _ = env.reset(seed=0, options={"goal": HOME + 0.1 * np.arange(1, count + 1)[:, None]})
    assert env.goal.shape == (count, 6)
    assert observation in env.observation_space


@pytest.mark.parametrize(
    ("task", "arguments"),
    [
        (Track, {"period": 0.0}),
        (Track, {"count": 0}),
        (Track, {"tolerance": -1.0}),
        (Track, {"speed": np.nan}),
        (Handover, {"offset": -0.1}),
        (Handover, {"tolerance": "near"}),
        (Reach, {"speed": 0.0}),
    ],
    ids=str,
)
def test_bad_parameters_of_a_task_are_named(task, arguments):
    with pytest.raises(ParameterError, match=next(iter(arguments))):
        task(**arguments)


@pytest.mark.long
def test_somebody_in_the_way_makes_the_arm_late_but_not_fail():
    # an arm that goes where the reference is, under the whole shield; people who come, stay and go
    late = 0
    for seed in (0, 3, 4):
        env = jssa_gym.JSSAShield(gym.make("jssa_gym/Track-v0", human="approach_retreat", max_episode_steps=4000))
        base = env.unwrapped
        observation, _ = env.reset(seed=seed)
        span, seen = np.ptp(base.robot.limits.position, axis=1), base.layout.slices["reference"]
        cascade, intervened = Cascade(base.robot.limits, share=1.0, kp=4.0, kv=12.0, ka=40.0), False
        for _ in range(4000):
            target = base.scene.robot.position + span * observation[seen]
            observation, _, ended, _, info = env.step(cascade.jerk(base.scene.robot, target) / base.robot.limits.jerk)
            intervened |= info["shield/intervened"]
            assert info["contact_speed"] == 0.0
            if ended:
                break
        assert info["success"]
        late += intervened and info["track/lateness"] > 0.2
    assert late >= 1


# ---- Handover -----------------------------------------------------------------------------------------


class Statue(HumanMotion):
    """Six capsules that stand still, the end of the right arm at a given place."""

    reacts, speed_bound = False, 0.0

    def __init__(self, hand):
        self.hand = hand

    def reset(self, rng, start=None, person=0):
        people = Receive().reset(np.random.default_rng(0), np.array([1.5, 0.0]), person)
        people.end[people.names.index("right_arm")] = self.hand
        return people

    def step(self, dt, robot):
        return self.reset(None)


def handover_point(people, offset=OFFSET):
    hand = people.end[people.names.index("right_arm")]
    aside = np.array([hand[0], hand[1], 0.0])
    return hand - offset * aside / np.linalg.norm(aside)


def tip_of(position):
    return ref.point(CHAIN, position, 5, (0.16, 0.0, 0.0)) + np.array([0.0, 0.0, TABLE])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("human", ["receive", "hand", "random", ("none", "receive", "random")])
def test_the_goal_is_at_the_hand_in_every_step(human):
    env = ArmEnv("handover", human=human, terminate_on=())
    observation, info = env.reset(seed=1)
    goals, rng = [], np.random.default_rng(0)
    for k in range(400):
        assert env.goal.shape == (3,)
        np.testing.assert_allclose(env.goal, handover_point(env.scene.human), atol=1e-12)
        tip = tip_of(env.scene.robot.position)
        seen = observation[env.layout.slices["goal"]]
        np.testing.assert_allclose(seen, np.clip(env.goal - tip, -2.0, 2.0), atol=1e-6)
        if k:
            assert info["reward/handover"] == pytest.approx(-np.linalg.norm(env.goal - tip), abs=1e-9)
        goals.append(env.goal)
        observation, _, _, _, info = env.step(0.3 * rng.uniform(-1.0, 1.0, 6))
    assert np.ptp(goals, axis=0).max() > 0.1


def test_the_hand_at_the_base_axis_leaves_a_goal():
    people = Statue(np.array([0.0, 0.0, 1.3])).reset(None)
    np.testing.assert_array_equal(Handover().follow(np.zeros(3), people), [0.0, 0.0, 1.3])


@pytest.mark.long
def test_the_point_is_a_tools_breadth_and_more_from_everybody():
    task = Handover()
    for seed in range(30):
        motion = Receive()
        people = motion.reset(np.random.default_rng(seed))
        for k in range(1000):
            if k % 5 == 0:
                goal = task.follow(np.zeros(3), people)
                for i in range(6):
                    axis, *_ = ref.segment_distance(goal, goal, people.start[i], people.end[i])
                    assert axis - people.radius[i] - 0.06 >= 0.1 - 1e-9
            people = motion.step(DT, None)


@pytest.mark.parametrize("human", ["none", Nobody(), ["none", "none"]], ids=["name", "motion", "crowd"])
def test_without_a_hand_there_is_no_handover(human):
    with pytest.raises(ParameterError, match="right_arm"):
        ArmEnv("handover", human=human)
    with pytest.raises(ParameterError, match="right_arm"):
        gym.make("jssa_gym/HandoverShielded-v0", human=human)


def test_a_ball_has_no_hand():
    class Ball(RandomWalk):
        def reset(self, rng, start=None, person=0):
            zero, at = np.zeros((1, 3)), np.array([[1.5, 0.0, 1.5]])
            return CapsuleSet(at, at, zero, zero, np.array([0.1]), ("ball",), np.array([person]))

    with pytest.raises(ParameterError, match="ball"):
        ArmEnv("handover", human=Ball())


def test_the_goal_of_a_handover_cannot_be_set():
    env = ArmEnv("handover")
    env.reset(seed=0)
    before = env.goal
    with pytest.raises(ParameterError, match="hand"):
        env.reset(options={"goal": [0.5, 0.0, 1.4]})
    np.testing.assert_array_equal(env.goal, before)
    env.reset(seed=0, options={"human_start": [1.6, 0.2]})
    np.testing.assert_allclose(env.scene.human.start[0, :2], [1.6, 0.2], atol=1e-12)


@pytest.mark.parametrize(("gap", "expected"), [(0.029, True), (0.031, False)])
def test_a_handover_is_done_within_three_centimetres(gap, expected):
    env = ArmEnv("handover", human=Statue(tip_of(HOME) + np.array([OFFSET, 0.0, gap])))
    env.reset(seed=0)
    seen = []
    for _ in range(30):
        *_, ended, _, info = env.step(np.zeros(6))
        seen.append(info["success"])
        assert ended == info["success"]
        assert info["reward/handover"] == pytest.approx(-gap, abs=1e-9)
        assert info["reward/success"] == (10.0 if info["success"] else 0.0)
    # held for 0.1 s: 12.5 steps, so 13
    assert seen == ([False] * 12 + [True] * 18 if expected else [False] * 30)


def test_a_handover_is_done_at_rest_only():
    radius = float(np.hypot(*tip_of(HOME)[:2]))
    for speed, expected in ((0.045, True), (0.055, False)):
        env = ArmEnv("handover", human=Statue(tip_of(HOME) + np.array([OFFSET, 0.0, 0.0])), terminate_on=())
        env.reset(seed=0)
        seen = []
        for _ in range(30):
            env.state[0], env.state[1, 0] = HOME, speed / radius
            seen.append(env.step(np.zeros(6))[-1]["success"])
        assert any(seen) is expected


@pytest.mark.parametrize("seed", range(3))
def test_who_goes_there_hands_over_and_who_stays_does_not(seed):
    outcomes = {}
    for name, policy in (("goes", StraightPolicy), ("stays", jssa_gym.HoldPolicy)):
        env = gym.make("jssa_gym/Handover-v0", terminate_on=("success",))
        driver = policy(env)
        observation, info = env.reset(seed=seed)
        done = False
        while not done:
            observation, _, terminated, truncated, info = env.step(driver(observation))
            done = terminated or truncated
        outcomes[name] = info["success"]
    assert outcomes == {"goes": True, "stays": False}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(3))
def test_a_shield_that_is_told_of_the_handover_lets_it_happen(seed):
    allowed = jssa_gym.FailsafeParams(contact_speed={"right_arm": 0.25})
    env = gym.make("jssa_gym/Handover-v0", terminate_on=("success",))
    env = jssa_gym.JSSAShield(env, lambda1=1.0, lambda2=0.1, failsafe=allowed)
    policy = StraightPolicy(env)
    observation, info = env.reset(seed=seed)
    done, nearest = False, np.inf
    while not done:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        done, nearest = terminated or truncated, min(nearest, info["distance"])
    assert info["success"]
    assert nearest > 0.05


# ---- who receives -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("acceleration", "ramp"), [(None, 0), (30.0, 4)], ids=str)
def test_who_receives_holds_out_low_then_nearer_and_higher_and_goes_back(acceleration, ramp):
    for seed in range(20):
        motion = Receive(acceleration=acceleration)
        seen = [motion.reset(np.random.default_rng(seed))]
        seen += [motion.step(DT, None) for _ in range(1500)]
        right = seen[0].names.index("right_arm")
        hand, speed = (np.array([getattr(c, field)[right] for c in seen]) for field in ("end", "end_velocity"))
        others = [np.delete(c.end, right, axis=0) for c in seen] + [np.delete(seen[0].end, right, axis=0)]
        assert np.ptp(others, axis=0).max() == 0.0
        moving = np.linalg.norm(speed, axis=1) > 0.0
        begins = np.flatnonzero(~moving[:-1] & moving[1:]) + 1
        ends = np.flatnonzero(moving[:-1] & ~moving[1:]) + 1
        assert len(begins) == len(ends) == 3
        low, high, back = hand[ends]
        assert 1.0 - 1e-9 <= low[2] <= 1.1 + 1e-9
        assert 0.1 - 1e-9 <= high[2] - low[2] <= 0.25 + 1e-9
        assert np.hypot(*high[:2]) < np.hypot(*low[:2]) - 0.02
        np.testing.assert_allclose(back, hand[0], atol=1e-9)
        pauses = (begins - np.r_[0, ends[:2]]) * DT
        for pause, (least, most) in zip(pauses, ((0.2, 0.8), (0.8, 1.6), (3.5, 5.0)), strict=True):
            assert least - 2 * DT <= pause <= most + 2 * DT
        # straight ways at one speed each, but for ramps and the last step
        for begin, end in zip(begins, ends, strict=True):
            way = speed[begin + ramp : end - 1 - ramp]
            np.testing.assert_allclose(way, np.tile(way[0], (len(way), 1)), atol=1e-9)
            assert 0.4 <= np.linalg.norm(way[0]) <= 0.8
        assert np.linalg.norm(hand - [c.start[right] for c in seen], axis=1).max() <= 0.7 + 1e-9


@pytest.mark.long
def test_the_arm_reaches_what_is_to_be_handed_over(robot):
    low, high = robot.limits.position.T
    for seed in range(8):
        motion = Receive()
        motion.reset(np.random.default_rng(seed))
        # at 5.4 s at the latest it is held high
        people = [motion.step(DT, None) for _ in range(675)][-1]
        goal = handover_point(people)
        best = min(
            least_squares(lambda q, goal=goal: tip_of(q) - goal, start, bounds=(low, high)).cost
            for start in (HOME, HOME + 0.4, HOME - 0.4)
        )
        assert best < 1e-8


def test_bad_parameters_of_who_receives_are_named():
    for arguments in ({"speed": (0.0, 1.0)}, {"front": (0.3, 0.5)}, {"stay": (2.0, 1.0)}, {"height": (np.nan, 1.0)}):
        with pytest.raises(ParameterError, match=next(iter(arguments))):
            Receive(**arguments)


# ---- what is written about them -----------------------------------------------------------------------


def rows(page):
    """The cells of a page's table rows that begin with a name in back-quotes, by that name."""
    text = (DOCS / page).read_text()
    lines = [line for line in text.splitlines() if line.startswith("| `")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {line[0].strip("`"): line[1:] for line in cells}


def test_the_page_of_tasks_has_them_all():
    table = rows("tasks.md")
    for name, task in TASKS.items():
        goal, space, *_, human, _ = table[f"{name.capitalize()}-v0"]
        assert goal
        assert (space, human) == (f"`{task.space}`", f"`{task.human}`")


def test_the_page_of_people_has_them_all():
    table = rows("humans.md")
    for name, build in HUMANS.items():
        kind, _, fastest, bound, sees = table[name]
        if hasattr(build(), "acceleration"):
            assert float(bound) == build().acceleration
        assert kind == f"`{type(build()).__name__}`"
        if build().people:
            assert float(fastest.split(",")[0]) == pytest.approx(build().speed_bound, abs=0.05)
            assert sees == ("yes" if build().reacts else "no")
