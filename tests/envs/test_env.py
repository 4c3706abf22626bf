"""The environments: Gymnasium's rules, what is observed, rewarded and reported, and that a seed fixes everything."""

import ast
import copy
import hashlib
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
import reference as ref
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

import jssa_gym
from jssa_gym.envs import TASKS, ArmEnv
from jssa_gym.envs.observation import Feature, Observation, arm_features
from jssa_gym.envs.tasks import COMMON_TERMS, Reach
from jssa_gym.exceptions import DisplayError, InvalidActionError, JSSAGymError, ParameterError, RobotModelError
from jssa_gym.humans import ApproachRetreat, HumanMotion, nobody
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.types import CapsuleSet, Scene

IDS = sorted(name for name in gym.registry if name.startswith("jssa_gym/"))
DT = 0.008
HOME = np.array([0.0, 0.0, 0.0, 0.0, -np.pi / 2.0, 0.0])
TABLE = 0.87
CHAIN = ref.lr_mate_chain()

STEP_INFO = {
    "distance": float,
    "contact": bool,
    "contact_speed": float,
    "cost": float,
    "jerk": np.ndarray,
    "limit_violation": bool,
    "success": bool,
    "is_success": bool,
}
SHIELD_INFO = {
    "shield/status": int,
    "shield/reason": str,
    "shield/reason_code": int,
    "shield/intervened": bool,
    "shield/phi": float,
    "shield/correction": float,
    "shield/robot_pair": int,
    "shield/human_pair": int,
    "shield/slack": float,
    "shield/margin": float,
    "shield/kind": str,
    "shield/choice": int,
    "shield/override": float,
}


def rewards(task):
    return {f"reward/{term.name}": float for term in (*task.terms, *COMMON_TERMS)}


TASK_INFO = {
    "track": {"track/visited": int, "track/lateness": float, "track/error": float},
    "deliver": {"deliver/legs": int, "deliver/deliveries": int, "deliver/per_minute": float},
}


def still(distance=0.62):
    """Somebody who walks up to ``distance`` in front of the base and stays."""
    return ApproachRetreat(
        start=1.5, nearest=(distance,) * 2, side=(0.0, 0.0), speed=(0.8, 0.8), wait=(0.0, 0.0), stay=(60.0, 60.0)
    )


WIGGLE = 0.3 * np.sign(np.sin(np.arange(300) * DT * 2 * np.pi * 8.0))[:, None] * np.ones(6)
"""Jerks that keep the arm moving about where it is."""


def random_actions(env, count, seed=0, size=1.0):
    return size * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, *env.action_space.shape))


# ---- Gymnasium and Stable-Baselines3 ------------------------------------------------------------------


@pytest.mark.parametrize("name", IDS)
def test_gymnasium_finds_nothing_to_complain_about(name):
    check_env(gym.make(name).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("name", [name for name in IDS if "Shielded" in name])
def test_gymnasium_finds_nothing_in_the_shielded_ids(name):
    with warnings.catch_warnings():
        # the check wants the bare environment; it is the wrapped one that is to be checked here
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version")
        check_env(gym.make(name), skip_render_check=True)


@pytest.mark.sampled(1)
@pytest.mark.gl
@pytest.mark.parametrize("name", IDS)
def test_gymnasium_finds_nothing_when_it_draws_either(monkeypatch, name):
    monkeypatch.setitem(ArmEnv.metadata, "render_modes", ["rgb_array"])  # no window opens, even where one could
    env = gym.make(name)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version")
        check_env(env if "Shielded" in name else env.unwrapped)


@pytest.mark.parametrize("name", IDS)
def test_stable_baselines3_finds_nothing_to_complain_about(name):
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable_baselines3 is not installed")
    checker.check_env(gym.make(name))


@pytest.mark.long
def test_an_id_can_name_the_module_that_registers_it():
    script = (
        "import gymnasium; env = gymnasium.make('jssa_gym:jssa_gym/Home-v0'); env.reset(seed=0); print(env.spec.id)"
    )
    run = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "jssa_gym/Home-v0"


@pytest.mark.parametrize("through_json", [False, True])
def test_a_spec_rebuilds_the_shielded_environment(through_json):
    env = jssa_gym.ActionRepeat(
        jssa_gym.JSSAShield(
            gym.make("jssa_gym/Home-v0", human="random", d_min=0.07, terminate_on=("contact",)),
            lambda1=3.0,
            lambda2=1.0,
            d_min=0.04,
            projector="osqp",
            weight=[1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            static_rows=True,
        ),
        4,
    )
    spec = EnvSpec.from_json(env.spec.to_json()) if through_json else env.spec
    twin = spec.make()
    assert str(twin) == str(env)
    assert twin.ticks == 4
    ours, theirs = env.env.filter, twin.env.filter
    assert theirs.index == ours.index
    assert theirs.index.lambda1 == 3.0
    assert (theirs.rows, theirs.gradient, theirs.static_rows) == ("all", "exact", True)
    assert type(theirs.projector) is type(ours.projector)
    np.testing.assert_array_equal(theirs.projector.weight, ours.projector.weight)
    assert tuple(twin.unwrapped.terminate_on) == ("contact",)
    assert twin.unwrapped.d_min == 0.07
    for one, other in zip(play(env, 30), play(twin, 30), strict=True):
        assert one == other


ALLOWED = {"human_speed": 1.2, "contact_speed": {"right_arm": 0.1}}


@pytest.mark.parametrize("failsafe", [ALLOWED, jssa_gym.FailsafeParams(**ALLOWED)], ids=["mapping", "dataclass"])
def test_assumptions_of_the_stop_pass_through_json(failsafe):
    env = jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0"), failsafe=failsafe)
    twin = EnvSpec.from_json(env.spec.to_json()).make()
    assert twin.filter.failsafe == env.filter.failsafe == jssa_gym.FailsafeParams(**ALLOWED)


def test_an_unknown_assumption_is_refused():
    with pytest.raises(ParameterError, match="unknown assumption 'speed'; valid: human_speed, limb_speed"):
        jssa_gym.JSSAShield(gym.make("jssa_gym/Home-v0"), failsafe={"speed": 1.0})


def test_the_shielded_handover_may_touch_a_right_arm_slowly_and_nothing_else():
    params = gym.make("jssa_gym/HandoverShielded-v0").get_wrapper_attr("filter").failsafe
    assert params == jssa_gym.FailsafeParams(contact_speed={"right_arm": 0.1})
    assert params.contact_speed_of("left_arm") == params.contact_speed_of("head") == 0.0
    for name in ("Home", "Reach", "Track"):
        params = gym.make(f"jssa_gym/{name}Shielded-v0").get_wrapper_attr("filter").failsafe
        assert params == jssa_gym.FailsafeParams()


def test_as_published_is_rebuilt_by_its_spec():
    env = jssa_gym.JSSAShield.as_published(gym.make("jssa_gym/Home-v0"))
    twin = env.spec.make()
    assert (twin.filter.rows, twin.filter.gradient) == ("closest", "printed")
    assert (twin.filter.index.lambda1, twin.filter.index.lambda2) == (3.0, 1.0)


# ---- same seed, same bits -----------------------------------------------------------------------------

FINGERPRINT = """
import hashlib
import numpy as np
import gymnasium as gym
import jssa_gym

def bits(value):
    return value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()

def fingerprint(name, seed, steps):
    env = gym.make(name, terminate_on=())
    actions = np.random.default_rng(7).uniform(-1.0, 1.0, (steps, 6)).astype(np.float32)
    digest = hashlib.sha256()
    observation, info = env.reset(seed=seed)
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        for value in (observation, reward, terminated, truncated, *(v for k, v in sorted(info.items()))):
            digest.update(bits(value))
    return digest.hexdigest()
"""
_space: dict = {}
exec(FINGERPRINT, _space)
bits, fingerprint = _space["bits"], _space["fingerprint"]


def slices_of(env, parts=6):
    """Where in the observation what is, by the tables of arm and task, beside somebody of so many parts."""
    table = Observation((*arm_features(env.robot, parts), *env.task.features(env.robot)))
    assert env.observation_space.shape == (table.size,)
    return table.slices


def play(env, steps, seed=3, actions=7):
    """Observation, reward and info of an episode, hashed step by step."""
    chosen = np.random.default_rng(actions).uniform(-1.0, 1.0, (steps, *env.action_space.shape))
    observation, info = env.reset(seed=seed)
    seen = [hashlib.sha256(observation.tobytes() + b"".join(bits(info[k]) for k in sorted(info))).hexdigest()]
    for action in chosen:
        observation, reward, terminated, truncated, info = env.step(action)
        values = (observation, reward, terminated, truncated, *(info[k] for k in sorted(info)))
        seen.append(hashlib.sha256(b"".join(bits(v) for v in values)).hexdigest())
    return seen


FINGERPRINTED = ("jssa_gym/ReachShielded-v0", "jssa_gym/Home-v0", "jssa_gym/Track-v0", "jssa_gym/HandoverShielded-v0")


@pytest.fixture(scope="module")
def elsewhere():
    """Fingerprints that another process found."""
    script = FINGERPRINT + f"\nfor name in {FINGERPRINTED}:\n    print(fingerprint(name, 5, 300))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return dict(zip(FINGERPRINTED, run.stdout.split(), strict=True))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", FINGERPRINTED)
def test_a_seed_fixes_every_bit_in_another_process_too(name, elsewhere):
    here = fingerprint(name, 5, 300)
    assert here == fingerprint(name, 5, 300)
    assert here != fingerprint(name, 6, 300)
    assert elsewhere[name] == here


@pytest.mark.parametrize("human", ["random", "constant_velocity", "approach_retreat", ["random", "constant_velocity"]])
def test_an_earlier_episode_leaves_no_trace(human):
    fresh = gym.make("jssa_gym/ReachShielded-v0", human=human, terminate_on=())
    used = gym.make("jssa_gym/ReachShielded-v0", human=human, terminate_on=())
    play(used, 60, seed=11, actions=12)
    assert play(fresh, 100) == play(used, 100)


def test_a_reset_without_a_seed_goes_on_drawing():
    env = gym.make("jssa_gym/Reach-v0")
    env.reset(seed=1)
    first = env.unwrapped.goal
    env.reset()
    assert not np.array_equal(env.unwrapped.goal, first)


def test_two_environments_with_one_name_share_no_person():
    one, two = gym.make("jssa_gym/Reach-v0"), gym.make("jssa_gym/Reach-v0")
    alone = play(gym.make("jssa_gym/Reach-v0", terminate_on=()), 20)
    one.reset(seed=3)
    assert play(two, 20) == alone


# ---- conventions of action and observation ------------------------------------------------------------


@pytest.mark.parametrize("name", IDS)
def test_spaces_are_float32(name):
    env = gym.make(name)
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (6,), np.float32)
    assert env.observation_space.dtype == np.float32
    assert np.isfinite(env.observation_space.low).all()
    assert np.isfinite(env.observation_space.high).all()
    observation, _ = env.reset(seed=0)
    assert observation.dtype == np.float32


@pytest.mark.parametrize("task", list(TASKS))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_observations_keep_their_bounds_in_wild_states(task, sign):
    env = ArmEnv(task, human="random", terminate_on=())
    env.reset(seed=0)
    low, high = env.observation_space.low, env.observation_space.high
    at_bounds = np.zeros(low.shape, bool)
    for _ in range(400):
        observation, reward, _, _, info = env.step(np.full(6, sign))
        assert np.all(low <= observation)
        assert np.all(observation <= high)
        assert np.isfinite(reward)
        at_bounds |= (observation == low) | (observation == high)
    assert info["limit_violation"]
    # 400 steps of full jerk are far beyond every limit: the bounds were really met
    assert at_bounds[6:18].all()


def test_without_a_human_the_human_entries_are_at_their_upper_bounds():
    env = ArmEnv("reach", human="none")
    observation, info = env.reset(seed=0)
    slices = slices_of(env, parts=1)
    for name in ("gap", "human_point", "human_distance"):
        assert np.all(observation[slices[name]] == env.observation_space.high[slices[name]])
    assert np.all(observation[slices["human_velocity"]] == 0.0)
    assert info["distance"] == np.inf
    assert info["contact"] is False


def expected_observation(env, state, goal, places):
    """Every feature computed from the published numbers and the textbook reference, unclipped."""
    q, v, a = state
    low, high = np.radians([(-170, 170), (-100, 145), (-70, 213), (-190, 190), (-125, 125), (-360, 360)]).T
    velocity = np.radians([370.0, 310.0, 410.0, 550.0, 545.0, 1000.0])
    acceleration = np.radians([641.0, 576.0, 592.0, 1184.0, 1184.0, 1809.0])
    people = env.scene.human
    up = np.array([0.0, 0.0, TABLE])
    best, parts = (np.inf,), {}
    for _, link, start, end, radius in ref.LR_MATE_CAPSULES:
        a0, a1 = (ref.point(CHAIN, q, link, x) + up for x in (start, end))
        for j in range(len(people.radius)):
            axis, s, r = ref.segment_distance(a0, a1, people.start[j], people.end[j])
            distance = axis - radius - people.radius[j]
            parts[j % 6] = min(parts.get(j % 6, np.inf), distance)
            if distance < best[0]:
                on_robot, on_human = a0 + s * (a1 - a0), people.start[j] + r * (people.end[j] - people.start[j])
                rate = people.start_velocity[j] + r * (people.end_velocity[j] - people.start_velocity[j])
                best = (distance, on_human - on_robot, on_human - up, rate)
    tip = ref.point(CHAIN, q, 5, (0.16, 0.0, 0.0))
    own = {"goal": goal - tip - up} if env.task.space == "tip" else {"goal": (HOME - q) / (high - low)}
    if env.task.name == "track":
        # seconds after the start: the first waypoint is still to come, the reference on its way to it
        share = env.scene.time / 1.5
        eased = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        reference = HOME + eased * (goal[0] - HOME)
        own = {
            "goal": (goal[0] - q) / (high - low),
            "reference": (reference - q) / (high - low),
            "due": 1.0 - share,
            "visited": 0.0,
        }
    if env.task.name == "deliver":  # nothing was fetched yet
        own |= {"other": places[1] - tip - up, "done": 0.0, "stay": 0.0}
    return {
        "position": (q - (low + high) / 2.0) / ((high - low) / 2.0),
        "velocity": v / velocity,
        "acceleration": a / acceleration,
        "tip": tip,
        "gap": best[1],
        "human_point": best[2],
        "human_velocity": best[3],
        "human_distance": np.array([parts[j] for j in range(6)]),
        "distance": best[0],
        **own,
    }


@pytest.mark.sampled(3)
@pytest.mark.parametrize("task", list(TASKS))
@pytest.mark.parametrize("human", ["random", ("approach_retreat", "random")])
def test_observation_is_what_its_table_says(task, human):
    env = ArmEnv(task, human=human, terminate_on=())
    env.reset(seed=2)
    places = env.task.draw_goal(np.random.default_rng(2), env.robot, env.planes)  # as the environment has drawn it
    slices = slices_of(env)
    state = [np.array(x) for x in (HOME, np.zeros(6), np.zeros(6))]
    jerk_bound = np.radians([3798.0, 3408.0, 3505.0, 7011.0, 7011.0, 10712.0])
    for k, action in enumerate(random_actions(env, 120, seed=1)):
        state = ref.triple_integrator(*state, action * jerk_bound, DT)
        observation, _, _, _, info = env.step(action)
        if k % 12:
            continue
        expected = expected_observation(env, state, env.goal, places)
        assert info["distance"] == pytest.approx(expected.pop("distance"), abs=1e-9)
        assert set(expected) == set(slices)
        for name, value in expected.items():
            bounded = np.clip(value, env.observation_space.low[slices[name]], env.observation_space.high[slices[name]])
            np.testing.assert_allclose(observation[slices[name]], bounded, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("task", list(TASKS))
def test_the_table_covers_the_vector_once(task, robot):
    env = ArmEnv(task)
    covered = np.zeros(env.observation_space.shape, int)
    features = (*arm_features(robot, 6), *TASKS[task]().features(robot))
    slices = slices_of(env)
    for feature in features:
        part = slices[feature.name]
        covered[part] += 1
        assert part.stop - part.start == feature.size
        assert np.all(env.observation_space.low[part] == np.float32(feature.low))
        assert np.all(env.observation_space.high[part] == np.float32(feature.high))
    assert np.all(covered == 1)


def test_a_feature_with_the_wrong_number_of_scales_is_refused():
    with pytest.raises(ParameterError, match="2 scales for 3 numbers"):
        Feature("x", 3, (1.0, 2.0), 0.0, 1.0, "")


# ---- motion -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_step_is_equation_1(dtype):
    env = ArmEnv("home", human="none", terminate_on=())
    env.reset(seed=0)
    bound = np.array(env.robot.limits.jerk)
    state = (HOME, np.zeros(6), np.zeros(6))
    for action in random_actions(env, 200, seed=4).astype(dtype):
        state = ref.triple_integrator(*state, action.astype(np.float64) * bound, DT)
        *_, info = env.step(action)
        seen = env.scene.robot
        for ours, theirs in zip((seen.position, seen.velocity, seen.acceleration), state, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(info["jerk"], action.astype(np.float64) * bound, rtol=1e-15)


def test_time_counts_steps_exactly():
    env = ArmEnv("home", human="none", terminate_on=())
    env.reset()
    for k in range(1, 200):
        env.step(np.zeros(6))
        assert env.scene.time == k * DT


def test_actions_beyond_the_bounds_are_clipped():
    env = ArmEnv("home", human="none", terminate_on=())
    env.reset()
    *_, info = env.step([3.0, -7.0, 0.5, 1.0, -1.0, 1e300])
    share = info["jerk"] / env.robot.limits.jerk
    np.testing.assert_allclose(share, [1.0, -1.0, 0.5, 1.0, -1.0, 1.0], rtol=1e-15)
    assert info["limit_violation"] is False


@pytest.mark.parametrize(
    "action",
    [
        np.zeros(5),
        np.zeros(7),
        np.zeros((1, 6)),
        np.float64(0.0),
        None,
        "zero",
        ["a"] * 6,
        np.zeros(6, bool),
        np.zeros(6, object),
        np.zeros(6, complex),
        [[0.0], [0.0, 0.0]],
        np.full(6, np.nan),
        np.array([0.0, 0.0, np.inf, 0.0, 0.0, 0.0]),
        {"a": 1},
    ],
    ids=lambda action: repr(action)[:40],
)
def test_a_bad_action_is_refused_before_anything_moves(action):
    env = ArmEnv("reach", terminate_on=())
    env.reset(seed=0)
    env.step(np.full(6, 0.3))
    scene, before = env.scene, copy.deepcopy(env.scene)
    with pytest.raises(InvalidActionError) as caught:
        env.step(action)
    assert isinstance(caught.value, ValueError)
    assert env.scene is scene
    same_scene(scene, before)
    env.step(np.zeros(6))


# ---- reward -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, 2, 4])
def test_a_task_rewards_as_many_values_as_it_has_terms(count):
    class Other(Reach):
        __slots__ = ()
        name = "other"
        terms = Reach.terms[:1] * count

    with pytest.raises(ParameterError, match=r"'other' has the terms .*gives 3 values"):
        ArmEnv(Other())


def test_reward_is_the_sum_of_its_terms():
    env = ArmEnv("reach", human=still(), terminate_on=())
    env.reset(seed=0)
    names = {"reward/reach", "reward/near", "reward/success", "reward/effort", "reward/closeness", "reward/contact"}
    seen = set()
    for action in WIGGLE * np.array([1.0, 0.8, -0.5, 0.3, 0.6, -1.0]):
        _, reward, _, _, info = env.step(action)
        terms = {key: value for key, value in info.items() if key.startswith("reward/")}
        assert set(terms) == names
        assert all(type(value) is float for value in terms.values())
        assert type(reward) is float
        assert reward == pytest.approx(sum(terms.values()), abs=1e-12)
        tip = tip_of(env.scene.robot.position)
        assert terms["reward/reach"] == pytest.approx(-np.linalg.norm(env.goal - tip), abs=1e-9)
        assert terms["reward/near"] == pytest.approx(-np.tanh(10.0 * np.linalg.norm(env.goal - tip)), abs=1e-8)
        assert terms["reward/effort"] == pytest.approx(-0.01 * np.mean(action**2), abs=1e-12)
        assert terms["reward/closeness"] == (-0.5 if info["distance"] < 0.05 else 0.0)
        assert terms["reward/contact"] == (-5.0 if info["contact_speed"] > 1e-3 else 0.0)
        seen.add((terms["reward/closeness"] != 0.0, terms["reward/contact"] != 0.0))
    assert seen >= {(False, False), (True, True)}


def test_home_reward_is_the_distance_from_home():
    env = ArmEnv("home", human="none", terminate_on=())
    env.reset()
    for action in random_actions(env, 50):
        _, reward, _, _, info = env.step(action)
        posture = -np.sqrt(np.mean((env.scene.robot.position - HOME) ** 2))
        assert info["reward/posture"] == pytest.approx(posture, abs=1e-12)
        assert reward == pytest.approx(posture - 0.01 * np.mean(action**2), abs=1e-12)


@pytest.mark.parametrize("d_min", [0.03, 0.2])
def test_cost_counts_steps_closer_than_d_min(d_min):
    env = ArmEnv("home", human=still(0.8), d_min=d_min, terminate_on=())
    env.reset(seed=0)
    costs = set()
    for _ in range(300):
        *_, info = env.step(np.zeros(6))
        assert info["cost"] == float(info["distance"] < d_min)
        costs.add(info["cost"])
    assert costs == ({0.0, 1.0} if info["distance"] < d_min else {0.0})
    assert (d_min == 0.2) == (1.0 in costs)


# ---- endings ------------------------------------------------------------------------------------------


def run(env, actions, seed=0, options=None):
    """Infos, terminations and scenes of an episode, which goes on past terminations."""
    env.reset(seed=seed, options=options)
    return [env.step(action)[2:5:2] for action in actions]


def first(flags):
    return next((k for k, flag in enumerate(flags) if flag), None)


def test_a_contact_with_the_arm_at_rest_ends_nothing_by_default():
    steps = np.zeros((300, 6))
    seen = run(ArmEnv("home", human=still()), steps)
    touched = first(info["contact"] for _, info in seen)
    assert touched is not None
    assert all(info["contact_speed"] == 0.0 for _, info in seen)
    assert not any(ended for ended, _ in seen)
    seen = run(ArmEnv("home", human=still(), terminate_on=("contact",)), steps)
    assert first(ended for ended, _ in seen) == touched
    assert all(ended == info["contact"] for ended, info in seen)


@pytest.mark.parametrize("terminate_on", [None, ("moving_contact",)])
def test_a_contact_of_the_moving_arm_ends_the_episode(terminate_on):
    options = {} if terminate_on is None else {"terminate_on": terminate_on}
    env = ArmEnv("home", human=still(), **options)
    seen = run(env, WIGGLE)
    moving = [info["contact_speed"] > 1e-3 for _, info in seen]
    assert any(moving)
    assert [ended for ended, _ in seen] == moving
    assert all(info["contact"] for ended, info in seen if ended)
    calm = run(ArmEnv("home", human=still(), terminate_on=()), WIGGLE)
    assert any(info["contact_speed"] > 1e-3 for _, info in calm)
    assert not any(ended for ended, _ in calm)


def test_the_touching_point_has_the_speed_that_info_reports():
    env = ArmEnv("home", human=still(), terminate_on=())
    env.reset(seed=0)
    checked = 0
    for action in WIGGLE:
        *_, info = env.step(action)
        if not info["contact"] or checked == 10:
            continue
        robot, people, fastest = env.scene.robot, env.scene.human, 0.0
        up = np.array([0.0, 0.0, TABLE])
        for _, link, start, end, radius in ref.LR_MATE_CAPSULES:
            a0, a1 = (ref.point(CHAIN, robot.position, link, x) + up for x in (start, end))
            for j in range(6):
                axis, s, r = ref.segment_distance(a0, a1, people.start[j], people.end[j])
                if axis > radius + people.radius[j]:
                    continue
                on_axis = a0 + s * (a1 - a0)
                towards = people.start[j] + r * (people.end[j] - people.start[j]) - on_axis
                surface = on_axis + radius * towards / np.linalg.norm(towards) - up
                pose = ref.link_poses(CHAIN, robot.position)[link]
                local = pose[:3, :3].T @ (surface - pose[:3, 3])
                speed = np.linalg.norm(ref.point_velocity(CHAIN, robot.position, robot.velocity, link, local))
                fastest = max(fastest, speed)
        assert info["contact_speed"] == pytest.approx(fastest, abs=1e-9)
        assert fastest > 0.0
        checked += 1
    assert checked == 10


def test_a_limit_violation_is_flagged_and_ends_only_if_asked():
    full = np.ones((200, 6))
    seen = run(ArmEnv("home", human="none"), full)
    violated = first(info["limit_violation"] for _, info in seen)
    assert violated is not None
    assert not any(ended for ended, _ in seen)
    # J1's acceleration limit, 641 deg/s², is passed first at 3798 deg/s³ of jerk: after 22 steps
    assert violated == 21
    ended = run(ArmEnv("home", human="none", terminate_on=("limit_violation",)), full)
    assert first(flag for flag, _ in ended) == violated


def test_truncation_after_1000_steps():
    env = gym.make("jssa_gym/Home-v0", human="none")
    env.reset(seed=0)
    for k in range(1, 1001):
        _, _, terminated, truncated, _ = env.step(np.zeros(6))
        assert not terminated
        assert truncated == (k == 1000)
    assert env.unwrapped.scene.time == pytest.approx(8.0)


# ---- Reach --------------------------------------------------------------------------------------------


def tip_of(position):
    return ref.point(CHAIN, position, 5, (0.16, 0.0, 0.0)) + np.array([0.0, 0.0, TABLE])


def test_reach_succeeds_after_holding_the_target_for_a_tenth_of_a_second():
    goal = tip_of(HOME) + np.array([0.0, 0.0, 0.015])
    seen = run(ArmEnv("reach", human="none"), np.zeros((20, 6)), options={"goal": goal})
    # 0.1 s are 12.5 steps
    assert first(info["success"] for _, info in seen) == 12
    assert [ended for ended, _ in seen] == [info["success"] for _, info in seen]
    assert seen[12][1]["reward/success"] == 10.0
    assert seen[11][1]["reward/success"] == 0.0
    seen = run(ArmEnv("reach", human="none", terminate_on=()), np.zeros((20, 6)), options={"goal": goal})
    assert any(info["success"] for _, info in seen)
    assert not any(ended for ended, _ in seen)


@pytest.mark.parametrize(("offset", "expected"), [(0.0199, True), (0.0201, False)])
def test_reach_succeeds_within_two_centimetres(offset, expected):
    goal = tip_of(HOME) + np.array([0.0, offset, 0.0])
    seen = run(ArmEnv("reach", human="none"), np.zeros((30, 6)), options={"goal": goal})
    assert any(info["success"] for _, info in seen) is expected


@pytest.mark.parametrize(("speed", "expected"), [(0.045, True), (0.055, False)])
def test_reach_succeeds_only_when_the_tip_is_slow(speed, expected):
    # joint 6 turns about the tip's own axis; joint 1 moves the tip on a circle
    env = ArmEnv("reach", human="none")
    radius = np.hypot(*tip_of(HOME)[:2])
    env.reset(seed=0, options={"goal": tip_of(HOME)})
    env.state[1, 0] = speed / radius
    seen = []
    for _ in range(40):
        *_, info = env.step(np.zeros(6))
        seen.append((info["success"], np.linalg.norm(tip_of(env.scene.robot.position) - env.goal)))
    inside = sum(gap <= 0.02 for _, gap in seen)
    assert inside > 13
    assert any(success for success, _ in seen) is expected


def test_leaving_the_target_starts_the_clock_again():
    env = ArmEnv("reach", human="none")
    env.reset(seed=0, options={"goal": tip_of(HOME)})
    for k in range(40):
        if k == 8:
            env.state[1, 0] = 1.0
        if k == 9:
            env.state[1, 0] = 0.0
            env.state[0] = HOME
        *_, info = env.step(np.zeros(6))
        assert info["success"] == (k >= 9 + 12)


def test_home_succeeds_at_home_and_never_ends():
    seen = run(ArmEnv("home", human="none"), np.zeros((100, 6)))
    assert not any(ended for ended, _ in seen)
    # held for 0.1 s: 12.5 steps, so 13
    assert [info["success"] for _, info in seen] == [False] * 12 + [True] * 88
    away = run(ArmEnv("home", human="none"), np.full((100, 6), 0.5))
    assert not away[-1][1]["success"]


@pytest.mark.parametrize("count", [30, pytest.param(1000, marks=pytest.mark.slow)])
def test_reach_targets_are_reachable_and_clear(count):
    env = ArmEnv("reach", human="none")
    goals = []
    for seed in range(count):
        env.reset(seed=seed)
        goals.append(env.goal)
        # within the arm's reach: shoulder at (0.05, 0, 0.33), links of 0.44 and 0.61 m
        assert np.linalg.norm(env.goal - [0.0, 0.0, TABLE + 0.33]) <= 0.05 + 0.44 + np.hypot(0.035, 0.42) + 0.16
        assert env.goal[2] > TABLE + 0.05
        assert np.hypot(*env.goal[:2]) > 0.3
    assert np.ptp(goals, axis=0).min() > 0.3
    rng, chosen = np.random.default_rng(1), goals[:5]
    for goal in chosen:
        assert closest_posture(goal, env.robot, rng) < 1e-3


def closest_posture(goal, robot, rng):
    """Distance of a target from the nearest tip found by damped least squares within the joints' ranges."""
    low, high = robot.limits.position.T
    best = np.inf
    for _ in range(15):
        q = np.clip(HOME + rng.uniform(-0.35, 0.35, 6) * (high - low), low, high)
        for _ in range(60):
            gap = goal - tip_of(q)
            jacobian = ref.jacobian(CHAIN, q, 5, (0.16, 0.0, 0.0))
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-4 * np.eye(3), gap)
            q = np.clip(q + np.clip(step, -0.3, 0.3), low, high)
            best = min(best, float(np.linalg.norm(goal - tip_of(q))))
            if best < 1e-3:
                return best
    return best


# ---- reset --------------------------------------------------------------------------------------------


def test_reset_options_replace_what_would_be_drawn():
    env = ArmEnv("reach", human="approach_retreat")
    position = HOME + 0.1
    _, info = env.reset(
        seed=1, options={"joint_position": position, "goal": [0.5, 0.1, 1.2], "human_start": (1.1, 0.3)}
    )
    np.testing.assert_array_equal(env.scene.robot.position, position)
    np.testing.assert_array_equal(env.goal, [0.5, 0.1, 1.2])
    np.testing.assert_allclose(env.scene.human.start[0], [1.1, 0.3, 1.5], atol=1e-12)
    assert set(info) == set(STEP_INFO) | set(rewards(env.task))
    position[0] = 3.0
    assert env.scene.robot.position[0] == pytest.approx(0.1)


def test_home_takes_another_goal():
    env = ArmEnv("home", human="none")
    env.reset(options={"goal": HOME + 0.2})
    *_, info = env.step(np.zeros(6))
    assert info["reward/posture"] == pytest.approx(-0.2)


def test_options_may_be_absent_or_none():
    env = ArmEnv("reach")
    one = env.reset(seed=4)[0]
    two = env.reset(seed=4, options={})[0]
    three = env.reset(seed=4, options={"goal": None, "joint_position": None, "human_start": None})[0]
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(one, three)


INVALID_OPTIONS = [
    {"speed": 1.0},
    {"joint_position": np.zeros(5)},
    {"joint_position": np.full(6, np.nan)},
    {"joint_position": np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0])},
    {"joint_position": "home"},
    {"joint_position": object()},
    {"goal": [0.1, 0.2]},
    {"goal": [0.1, 0.2, np.inf]},
    {"goal": "there"},
    {"goal": [[1.0, 2.0], [3.0]]},
    {"human_start": [1.0]},
    {"human_start": [np.nan, 1.0]},
    {"human_start": [0.0, 0.0]},
    {"human_start": [0.4, 0.4]},
    {"human_start": [5.0, 5.0]},
    {"human_start": "there"},
    {"human_start": {}},
    {"goal": [0.5, 0.0, 1.0], "human_start": [0.1, 0.1]},
]


@pytest.mark.parametrize("options", INVALID_OPTIONS, ids=[str(k) for k in range(len(INVALID_OPTIONS))])
def test_an_invalid_option_is_refused_before_anything_changes(options):
    env, twin = (ArmEnv("reach", human="random", terminate_on=()) for _ in range(2))
    actions = random_actions(env, 40, seed=5)
    for one in (env, twin):
        one.reset(seed=9)
        for action in actions[:20]:
            one.step(action)
    before = copy.deepcopy(env.scene)
    with pytest.raises(ParameterError) as caught:
        env.reset(seed=1, options=options)
    assert isinstance(caught.value, ValueError)
    same_scene(env.scene, before)
    # and nothing hidden changed either: the episode goes on as its twin does
    for action in actions[20:]:
        for ours, theirs in zip(env.step(action), twin.step(action), strict=True):
            if isinstance(ours, dict):
                assert {k: bits(v) for k, v in ours.items()} == {k: bits(v) for k, v in theirs.items()}
            else:
                np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])


def test_unknown_options_are_told_the_valid_ones():
    with pytest.raises(ParameterError, match="joint_position, goal, human_start"):
        ArmEnv().reset(options={"x": 1})


@pytest.mark.sampled(2)
@pytest.mark.parametrize("human", ["random", "constant_velocity", "approach_retreat", ("random", "constant_velocity")])
@pytest.mark.parametrize("count", [25, pytest.param(1000, marks=pytest.mark.slow)])
def test_nobody_starts_within_reach_of_contact(human, count):
    for task in TASKS:
        env = ArmEnv(task, human=human)
        for seed in range(count):
            _, info = env.reset(seed=seed)
            assert info["distance"] >= 0.1
            assert not info["contact"]


# ---- info ---------------------------------------------------------------------------------------------


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", IDS)
def test_info_has_the_same_keys_and_types_in_every_step(name):
    env = gym.make(name, human=still(), terminate_on=())
    _, info = env.reset(seed=0)
    shield = SHIELD_INFO if "Shielded" in name else {}
    task = env.unwrapped.task
    expected = STEP_INFO | shield | TASK_INFO.get(task.name, {}) | rewards(task)
    assert {key: type(value) for key, value in info.items()} == expected
    for k, action in enumerate(random_actions(env, 250)):
        nan = "Shielded" in name and k % 50 == 49
        *_, info = env.step(np.full(6, np.nan) if nan else action)
        assert {key: type(value) for key, value in info.items()} == expected
        assert info["jerk"].shape == (6,)
        assert info["jerk"].dtype == np.float64


# ---- aliasing -----------------------------------------------------------------------------------------


def arrays_of(value):
    """All arrays inside a scene, with their paths."""
    if isinstance(value, np.ndarray):
        yield "", value
    elif isinstance(value, tuple) and hasattr(value, "_fields"):
        for name, field in value._asdict().items():
            for path, array in arrays_of(field):
                yield f"{name}.{path}", array


def same_scene(one: Scene, other: Scene):
    assert one.time == other.time
    pairs = list(zip(arrays_of(one), arrays_of(other), strict=True))
    assert len(pairs) > 10
    for (path, ours), (_, theirs) in pairs:
        np.testing.assert_array_equal(ours, theirs, err_msg=path)


@pytest.mark.parametrize("shielded", [False, True])
@pytest.mark.parametrize("dynamics", ["kinematic", "servo"])
def test_what_was_returned_stays_as_it_was(shielded, dynamics):
    env = gym.make("jssa_gym/Reach-v0", dynamics=dynamics, human=["random", "approach_retreat"], terminate_on=())
    if shielded:
        env = jssa_gym.JSSAShield(env, static_rows=True)
    base = env.unwrapped
    kept = []
    observation, info = env.reset(seed=0)
    for k, action in enumerate(random_actions(env, 60)):
        if k in (0, 3, 20):
            seen = (observation, info, base.scene, base.goal, base.robot_capsules)
            kept.append((seen, copy.deepcopy(seen)))
        given = action.copy()
        observation, _, _, _, info = env.step(action)
        np.testing.assert_array_equal(action, given)
    env.reset(seed=1)
    for action in random_actions(env, 5, seed=8):
        env.step(action)
    for seen, copied in kept:
        np.testing.assert_array_equal(seen[0], copied[0])
        assert {k: bits(v) for k, v in seen[1].items()} == {k: bits(v) for k, v in copied[1].items()}
        same_scene(seen[2], copied[2])
        np.testing.assert_array_equal(seen[3], copied[3])
        for (_, ours), (_, theirs) in zip(arrays_of(seen[4]), arrays_of(copied[4]), strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_writing_into_a_scene_moves_nothing():
    env, twin = ArmEnv("home", terminate_on=()), ArmEnv("home", terminate_on=())
    for one in (env, twin):
        one.reset(seed=0)
    for action in random_actions(env, 10):
        scene = env.scene
        for array in (scene.robot.position, scene.robot.velocity, scene.robot.acceleration, scene.age):
            array[:] = 7.0
        scene.valid[:] = False
        np.testing.assert_array_equal(env.step(action)[0], twin.step(action)[0])
        np.testing.assert_array_equal(env.scene.robot.position, twin.scene.robot.position)
        assert env.scene.valid.all()


def test_writing_into_the_goal_changes_nothing():
    env = ArmEnv("reach")
    env.reset(seed=0)
    before = env.goal
    env.goal[:] = 7.0
    np.testing.assert_array_equal(env.goal, before)


# ---- constructor --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"task": "fly"}, ParameterError, ("fly", "home", "reach")),
        ({"task": []}, ParameterError, ("home", "reach")),
        ({"human": "ghost"}, ParameterError, ("ghost", "none", "constant_velocity", "approach_retreat", "random")),
        ({"human": ["random", "ghost"]}, ParameterError, ("ghost", "approach_retreat")),
        ({"human": []}, ParameterError, ("at least one",)),
        ({"human": 3}, ParameterError, ("approach_retreat",)),
        ({"scene": "moon"}, ParameterError, ("moon", "table", "floor")),
        ({"scene": []}, ParameterError, ("table", "floor")),
        ({"robot": "r2d2"}, ParameterError, ("r2d2", "lr_mate_200id_7l")),
        ({"robot": 3}, ParameterError, ("lr_mate_200id_7l",)),
        ({"robot": "/nowhere/arm.xml"}, RobotModelError, ("arm.xml",)),
        ({"dynamics": "magic"}, ParameterError, ("magic", "kinematic", "servo")),
        ({"render_mode": "ansi"}, ParameterError, ("ansi", "rgb_array", "human")),
        ({"terminate_on": ("boredom",)}, ParameterError, ("success", "contact", "moving_contact", "limit_violation")),
        ({"terminate_on": "success"}, ParameterError, ("tuple", "moving_contact")),
        ({"terminate_on": None}, ParameterError, ("tuple", "moving_contact")),
        ({"d_min": -0.1}, ParameterError, ("d_min", "-0.1")),
        ({"d_min": np.nan}, ParameterError, ("d_min",)),
        ({"d_min": "far"}, ParameterError, ("d_min", "far")),
        ({"width": 0}, ParameterError, ("width",)),
        ({"height": -5}, ParameterError, ("height",)),
    ],
    ids=str,
)
def test_a_bad_argument_is_named_with_the_valid_ones(arguments, error, words):
    with pytest.raises(error) as caught:
        ArmEnv(**arguments)
    assert isinstance(caught.value, JSSAGymError)
    for word in words:
        assert word in str(caught.value)


def test_a_window_needs_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    if not sys.platform.startswith("linux"):
        pytest.skip("other systems always have a display")
    with pytest.raises(DisplayError, match="rgb_array"):
        ArmEnv(render_mode="human")


def test_rendering_without_a_mode_warns():
    env = ArmEnv()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


def test_other_limits_of_the_robot_are_used():
    env = ArmEnv(robot=lr_mate_200id_7l("stream"), human="none")
    env.reset()
    *_, info = env.step(np.ones(6))
    np.testing.assert_allclose(np.degrees(info["jerk"]), [3211.0, 2690.0, 5125.0, 14868.0, 16632.0, 6377.0])


def test_on_the_floor_the_arm_stands_lower():
    table, floor = ArmEnv(scene="table", human="none"), ArmEnv(scene="floor", human="none")
    for env in (table, floor):
        env.reset()
    drop = table.robot_capsules.start - floor.robot_capsules.start
    np.testing.assert_allclose(drop, np.tile([0.0, 0.0, TABLE], (5, 1)), atol=1e-12)
    assert table.scene.planes.offset.tolist() == [TABLE]
    assert floor.scene.planes.offset.tolist() == [0.0]
    np.testing.assert_allclose(table.reset(seed=0)[0], floor.reset(seed=0)[0], atol=1e-6)


# ---- people -------------------------------------------------------------------------------------------


def test_several_people_have_ids_and_leave_the_observation_as_long_as_it_was():
    one, three = ArmEnv("reach", human="random"), ArmEnv("reach", human=["random", "constant_velocity", still(1.2)])
    assert one.observation_space.shape == three.observation_space.shape
    three.reset(seed=0)
    people = three.scene.human
    assert people.person.tolist() == [0] * 6 + [1] * 6 + [2] * 6
    assert people.names == (*ref_names(),) * 3
    assert three.scene.valid.shape == three.scene.age.shape == (18,)
    observation, *_ = three.step(np.zeros(6))
    assert observation.shape == one.observation_space.shape


def ref_names():
    return [name for name, *_ in ref.HUMAN_CAPSULES]


class Shadow(HumanMotion):
    """A ball that floats over the tip of the arm: it sees the robot."""

    speed_bound = 10.0

    def reset(self, rng, start=None, person=0):
        self.seen = []
        return self._ball(np.array([1.5, 0.0, 1.5]), person)

    def step(self, dt, robot):
        self.seen.append(copy.deepcopy(robot))
        return self._ball(robot.end[-1] + [0.0, 0.0, 0.5], 0)

    @staticmethod
    def _ball(at, person):
        zero = np.zeros((1, 3))
        return CapsuleSet(at[None], at[None], zero, zero, np.array([0.1]), ("ball",), np.array([person]))


def test_a_reacting_motion_sees_the_arm_as_it_was_at_the_beginning_of_the_step():
    env = ArmEnv("home", human=Shadow(), terminate_on=())
    human = env.human  # a copy of its own
    env.reset(seed=0)
    assert slices_of(env, parts=1)  # as many as the ball has
    tips = [tip_of(HOME)]
    for action in random_actions(env, 30):
        *_, info = env.step(action)
        tips.append(tip_of(env.scene.robot.position))
        assert info["distance"] < 0.5
    assert len(human.seen) == 30
    np.testing.assert_allclose([seen.end[-1] for seen in human.seen], tips[:-1], atol=1e-9)
    assert human.seen[-1].names == ("base_column", "upper_arm", "elbow", "forearm", "wrist_tool")
    assert np.abs(human.seen[-1].end_velocity[-1]).max() > 0.0


def test_a_motion_without_anybody_is_nobody():
    env = ArmEnv(human="none")
    env.reset(seed=0)
    assert env.scene.human.names == nobody().names == ()


# ---- other robots -------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", list(TASKS))
def test_a_users_arm_runs_from_its_file(toy_mjcf, task):
    env = ArmEnv(task, robot=toy_mjcf, scene="table", human="random", terminate_on=())
    options = {"goal": [0.5, 0.3, TABLE + 0.1]} if task == "reach" else None
    observation, _ = env.reset(seed=0, options=options)
    assert env.action_space.shape == (3,)
    assert observation.shape == (3 * 3 + 12 + 6 + sum(f.size for f in env.task.features(env.robot)),)
    np.testing.assert_allclose(env.robot_capsules.start[0], [0.0, 0.0, TABLE + 0.1], atol=1e-12)
    state = [np.array(x) for x in (env.scene.robot.position, env.scene.robot.velocity, env.scene.robot.acceleration)]
    for action in random_actions(env, 20):
        state = ref.triple_integrator(*state, action * 80.0, DT)
        observation, *_ = env.step(action)
        assert observation in env.observation_space
    np.testing.assert_allclose(env.scene.robot.position, state[0], atol=1e-12)
    shielded = jssa_gym.JSSAShield(ArmEnv(task, robot=str(toy_mjcf), human="random"))
    shielded.reset(seed=0, options=options)
    shielded.step(np.zeros(3))


# ---- servo --------------------------------------------------------------------------------------------


def servo_run(target, steps=500):
    env = gym.make("jssa_gym/Home-v0", dynamics="servo", human="none", terminate_on=())
    env.reset(seed=0)
    policy = jssa_gym.HoldPolicy(env, target)
    errors = []
    for _ in range(steps):
        *_, info = env.step(policy(None))
        errors.append(info["tracking_error"])
    return np.array(errors), env.unwrapped.scene.robot.position


def test_the_servoed_arm_tracks_its_command():
    target = HOME + np.array([0.5, 0.3, -0.3, 0.6, 0.5, 1.0])
    errors, position = servo_run(target)
    np.testing.assert_allclose(position, target, atol=1e-3)
    # measured: 1.3 mrad at most
    assert np.abs(errors).max() < 3e-3
    # it is a simulation, not a copy of the command
    assert np.abs(errors).max() > 1e-5
    assert np.abs(errors[-1]).max() < 1e-4
    again, _ = servo_run(target)
    np.testing.assert_array_equal(errors, again)


def test_info_of_the_servoed_arm_is_about_the_simulated_one():
    env = ArmEnv("home", dynamics="servo", human=still(), terminate_on=())
    _, info = env.reset(seed=0)
    assert {k: type(v) for k, v in info.items()} == STEP_INFO | rewards(env.task) | {"tracking_error": np.ndarray}
    np.testing.assert_array_equal(info["tracking_error"], np.zeros(6))
    for action in random_actions(env, 60, size=0.5):
        *_, info = env.step(action)
    commanded = env.scene.robot.position
    actual = commanded + info["tracking_error"]
    up = np.array([0.0, 0.0, TABLE])

    def smallest(q):
        people = env.scene.human
        return min(
            ref.capsule_distance(
                *(ref.point(CHAIN, q, link, x) + up for x in (start, end)),
                radius,
                people.start[j],
                people.end[j],
                people.radius[j],
            )
            for _, link, start, end, radius in ref.LR_MATE_CAPSULES
            for j in range(6)
        )

    assert info["distance"] == pytest.approx(smallest(actual), abs=1e-9)
    assert abs(info["distance"] - smallest(commanded)) > 1e-7


def test_servo_needs_an_actuator_for_every_joint(toy_mjcf):
    with pytest.raises(RobotModelError, match=r"A.*B.*C"):
        ArmEnv(robot=toy_mjcf, dynamics="servo")
    text = toy_mjcf.read_text()
    some = '<actuator><position joint="A" kp="100"/><motor joint="B"/></actuator></mujoco>'
    toy_mjcf.write_text(text.replace("</mujoco>", some))
    with pytest.raises(RobotModelError, match=r"missing: \['B', 'C'\]"):
        ArmEnv(robot=toy_mjcf, dynamics="servo")


# ---- pictures -----------------------------------------------------------------------------------------


def share(picture, colour):
    """Share of the pixels of one hue: red, green, blue or yellow."""
    red, green, blue = (picture[..., i].astype(int) for i in range(3))
    test = {
        "yellow": (red > 120) & (green > 80) & (blue < green / 2),
        "blue": (blue > red + 40) & (blue > green + 15),
        "green": (green > red + 40) & (green > blue + 25),
        "red": (red > 130) & (green < red / 2.5) & (blue < red / 2.5),
    }
    return float(test[colour].mean())


@pytest.mark.long
@pytest.mark.gl
def test_a_picture_shows_arm_and_person():
    env = gym.make("jssa_gym/Home-v0", render_mode="rgb_array", width=320, height=240)
    env.reset(seed=0, options={"human_start": (0.9, 0.0)})
    picture = env.render()
    assert picture.shape == (240, 320, 3)
    assert picture.dtype == np.uint8
    assert picture.std() > 10.0
    assert share(picture, "yellow") > 0.01
    assert share(picture, "blue") > 0.01
    for _ in range(60):
        env.step(np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert np.abs(env.render().astype(int) - picture).max() > 50
    env.close()

    alone = gym.make("jssa_gym/Home-v0", human="none", render_mode="rgb_array", width=320, height=240)
    alone.reset(seed=0)
    empty = alone.render()
    assert share(empty, "yellow") > 0.01
    assert share(empty, "blue") < 0.003
    alone.step(np.zeros(6))
    alone.close()
    # the environment goes on after close, and draws again when asked to
    alone.step(np.zeros(6))
    assert alone.unwrapped.render().std() > 10.0
    alone.close()


@pytest.mark.long
@pytest.mark.gl
def test_an_environment_that_nobody_closes_ends_quietly():
    """Renderers that the interpreter's end would find open are closed before the OpenGL backend is."""
    script = (
        "import gymnasium as gym, jssa_gym\n"
        "kept = [gym.make('jssa_gym/Home-v0', human='none', render_mode='rgb_array') for _ in range(3)]\n"
        "for env in kept:\n"
        "    env.reset(seed=0)\n"
        "    env.render()\n"
        "kept[0].close()\n"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "Traceback" not in run.stderr


@pytest.mark.gl
def test_a_picture_of_reach_marks_the_target():
    env = ArmEnv("reach", human="none", render_mode="rgb_array", width=320, height=240)
    env.reset(seed=0, options={"goal": [0.7, -0.3, 1.5]})
    with_goal = env.render()
    home = ArmEnv("home", human="none", render_mode="rgb_array", width=320, height=240)
    home.reset(seed=0)
    assert share(with_goal, "green") > 0.0002
    assert share(home.render(), "green") < 0.00005
    env.close()
    home.close()


def test_infos_survive_a_round_through_repr():
    # what goes into a log has to be plain: no numpy scalars
    env = gym.make("jssa_gym/HomeShielded-v0")
    env.reset(seed=0)
    *_, info = env.step(np.zeros(6, np.float32))
    plain = {k: v for k, v in info.items() if k != "jerk" and v == v and abs(hash(v)) >= 0}
    assert ast.literal_eval(repr({k: v for k, v in plain.items() if not isinstance(v, float) or np.isfinite(v)}))
