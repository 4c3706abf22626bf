"""The certificate of an index: Eq. (7) sampled and searched, the condition that suffices, the map of parameters."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jssa_gym
from jssa_gym.certificate import lambda_map
from jssa_gym.certificate.boundary import KEPT, Boundary, Domain
from jssa_gym.certificate.census import Census, Counts, largest_part, mark
from jssa_gym.certificate.certify import certify, moved_capsules
from jssa_gym.certificate.chunks import StateChunk, generator, run
from jssa_gym.certificate.counterexample import load_counterexample, play_on, save_counterexample
from jssa_gym.certificate.lambda_map import sweep
from jssa_gym.certificate.search import worsen
from jssa_gym.evaluation import judge
from jssa_gym.evaluation.trace import load_trace, read_meta, save_trace
from jssa_gym.exceptions import MissingExtraError, ParameterError, TraceError
from jssa_gym.kernels.chain import forward, place
from jssa_gym.kernels.index import advance, assess
from jssa_gym.kernels.records import AGENT, FRAME, PAIR, PLANE, SEGMENT, records
from jssa_gym.kernels.viability import jerk_box
from jssa_gym.robots import lr_mate_200id_7l
from jssa_gym.safety.condition import fastest_approach, needed_jerk, propose, suffices
from jssa_gym.safety.index import IndexParams

ROBOT = lr_mate_200id_7l()
DT = 0.008
PAPER = IndexParams(lambda1=3.0, lambda2=1.0)
SLOW = Domain(
    tip_speed=0.05, human_speed=0.5, distance=(0.2, 0.5), speed_share=0.05, acceleration_share=0.05, authority=5.0
)
REST = replace(SLOW, speed_share=0.0, acceleration_share=0.0, authority=40.0, viable=False)
FAST = Domain(tip_speed=2.0, human_speed=2.0, speed_share=1.0, acceleration_share=1.0)


def boundary(index=PAPER, capsule="wrist_tool", domain=None):
    return Boundary(ROBOT, index, capsule, domain or Domain(), DT)


def sampled(index, capsule, domain=None, states=4000, seed=0):
    """The certificate of one capsule, without a search."""
    return certify(ROBOT, index, domain=domain, capsules=(capsule,), states=states, seed=seed, search=False).links[0]


def index_after(found, jerk, tau=DT, index=PAPER):
    """The index of a boundary state after a step, from the kernels of the shield."""
    row, n = ROBOT.capsule_names.index(found.capsule), ROBOT.n
    agents = records(1, AGENT)
    agents["start"] = agents["end"] = found.centre
    agents["start_velocity"] = agents["end_velocity"] = found.velocity
    agents["radius"] = found.radius
    advance(agents, tau)
    after, frames, segments = np.zeros((3, n)), records(n, FRAME), records(1, SEGMENT)
    scratch = after, frames, segments, records((1, 1), PAIR)
    capsules = ROBOT.capsules[row : row + 1]
    return assess(ROBOT.links, capsules, found.joints, jerk, agents, records(0, PLANE), tau, index.kernel(), *scratch)[
        0
    ]


def box(joints):
    limits = ROBOT.limits
    bounds = limits.bounds()
    lower, upper = np.zeros(ROBOT.n), np.zeros(ROBOT.n)
    assert jerk_box(joints, bounds, DT, lower, upper)
    return lower, upper


# ---- what is sampled


def test_states_lie_on_the_boundary_and_in_the_domain():
    domain = Domain(tip_speed=0.3, human_speed=0.4, distance=(0.1, 0.3), authority=10.0)
    for capsule in moved_capsules(ROBOT):
        link = boundary(capsule=capsule, domain=domain)
        looks, draws = link.sample(60, np.random.default_rng(1))
        assert len(looks.ahead) == 60 <= draws
        assert np.all((looks.distance >= 0.1) & (looks.distance <= 0.3))
        assert np.all((looks.tip_speed <= 0.3) & (looks.authority >= 10.0))
        low, high = ROBOT.limits.position.T
        for k in range(60):
            found = link.state(looks, k)
            assert index_after(found, np.zeros(6), 0.0) == pytest.approx(0.0, abs=1e-9)
            assert np.linalg.norm(found.velocity) <= 0.4 + 1e-12
            assert np.all((low <= found.joints[0]) & (found.joints[0] <= high))
            assert np.all(np.abs(found.joints[2]) <= 0.5 * ROBOT.limits.acceleration)


def test_the_rate_of_the_distance_is_that_of_the_motion():
    link = boundary()
    looks, _ = link.sample(50, np.random.default_rng(2))
    for k in range(50):
        found, h = link.state(looks, k), 1e-6
        frames, segments = records(6, FRAME), records(1, SEGMENT)
        gaps = []
        for t in (-h, h):
            joints = found.joints.copy()
            joints[0] += t * joints[1]
            forward(ROBOT.links, joints, frames)
            place(frames, ROBOT.capsules[4:5], segments)
            a, b, p = segments[0]["start"], segments[0]["end"], found.centre + t * found.velocity
            s = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            gaps.append(np.linalg.norm(p - a - s * (b - a)) - segments[0]["radius"] - found.radius)
        assert np.mean(gaps) == pytest.approx(found.distance, abs=1e-8)
        assert (gaps[1] - gaps[0]) / (2 * h) == pytest.approx(found.rate, abs=1e-5)


@pytest.mark.parametrize("capsule", ["upper_arm", "wrist_tool"])
def test_no_corner_of_the_box_is_better_than_the_best_jerk(capsule):
    link = boundary(capsule=capsule)
    looks, _ = link.sample(3000, np.random.default_rng(3))
    hardest = np.argsort(-looks.ahead)[:40]
    assert looks.infeasible[hardest].any()
    for k in hardest:
        found = link.state(looks, k)
        corners = itertools.product(*zip(*box(found.joints), strict=True))
        best = min(index_after(found, np.array(corner)) for corner in corners)
        # the index is curved by less than that in the jerk, so that one of its corners is the best jerk
        assert found.ahead == pytest.approx(best, abs=5e-5 + 1e-3 * abs(best))


def test_a_batch_is_bitwise_its_single_states():
    link = boundary(capsule="forearm")
    genes = link.draw(np.random.default_rng(4), 300)
    together = link.look(genes)
    alone = [link.look(genes[k : k + 1]) for k in range(300)]
    assert 50 < len(together.ahead) == sum(len(one.ahead) for one in alone)
    for field, batch in zip(together._fields, together, strict=True):
        assert batch.tobytes() == np.concatenate([getattr(one, field) for one in alone]).tobytes(), field


@pytest.mark.long
def test_the_counts_do_not_depend_on_threads_or_on_who_ends_first():
    chunks = [StateChunk(boundary(capsule=name), k, 1500, 7) for name in ("elbow", "wrist_tool") for k in range(3)]
    serial = {chunk.key: census.as_json() for chunk, census in run(chunks, 1)}
    threaded = {chunk.key: census.as_json() for chunk, census in run(chunks[::-1], 3)}
    assert serial == threaded
    assert len({json.dumps(plain) for plain in serial.values()}) == 6
    one = certify(ROBOT, PAPER, capsules=("elbow",), states=1500, seed=7, search=False)
    other = certify(ROBOT, PAPER, capsules=("elbow",), states=1500, seed=7, search=False, jobs=2)
    assert one.as_json() == other.as_json()
    assert one.links[0].infeasible.k == serial["elbow", 0, 1500]["infeasible"]


def test_censuses_add_up():
    link = boundary(capsule="elbow")
    looks, draws = link.sample(3000, np.random.default_rng(5))
    halves = [looks.pick(np.arange(1500)), looks.pick(np.arange(1500, 3000))]
    whole, total = Census.of(link, looks, draws), Census.total(Census.of(link, half, draws // 2) for half in halves)
    assert whole.as_json() == {**total.as_json(), "draws": draws}
    assert Census.read(json.loads(json.dumps(whole.as_json()))).as_json() == whole.as_json()
    outside = looks.rate < fastest_approach(PAPER, looks.distance)
    assert whole.outside == outside.sum() > 0
    assert whole.infeasible_inside == (looks.infeasible & ~outside).sum() < whole.infeasible
    assert whole.counts.states.sum() == 3000
    assert whole.counts.infeasible.sum() == whole.infeasible > 0
    assert -looks.ahead.max() == -whole.worst[0, 0]
    level = whole.jerk_quantile(0.5)
    assert level <= np.quantile(looks.jerk, 0.5) <= level + 0.5 + 1e-9


# ---- what comes out


def test_the_papers_parameters_fail_at_the_shoulder_and_for_fast_people():
    shoulder = sampled(PAPER, "upper_arm")
    assert shoulder.infeasible.low > 0.01
    assert shoulder.margin < 0.0
    inside, outside = sampled(PAPER, "wrist_tool", SLOW), sampled(PAPER, "wrist_tool", FAST)
    assert inside.infeasible.k == 0
    assert outside.infeasible.low > inside.infeasible.high


def test_an_arm_with_much_authority_at_rest_is_kept_even_after_a_search():
    found = certify(ROBOT, PAPER, domain=REST, capsules=("wrist_tool",), states=500)
    link = found.links[0]
    assert found.holds
    assert link.holds
    assert link.margin > 0.0
    assert link.worst.ahead > link.worst_drawn
    assert link.part is not None
    assert link.part.states == 500
    assert found.as_json()["holds"]


def test_a_part_that_withstood_its_search_holds_no_state_that_was_found_before():
    # nothing infeasible is drawn, the search in the whole domain finds it
    link = certify(ROBOT, PAPER, domain=SLOW, capsules=("wrist_tool",), states=1000).links[0]
    assert link.infeasible.k == 0
    assert not link.holds
    worst, part = link.worst, link.part
    assert link.sampled_part.states == 1000
    assert part is None or part.states < 1000
    if part is not None:
        near, far = part.distance
        slow, weak = worst.tip_speed < part.tip_speed, worst.authority < part.authority
        assert weak or not (slow and near <= worst.distance < far)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(4))
def test_a_certificate_does_not_hold_where_the_search_in_a_part_found_a_counter_example(seed):
    # at rest, but for joints near their limits
    domain = replace(REST, viable=True)
    link = certify(ROBOT, PAPER, domain=domain, capsules=("wrist_tool",), states=500, seed=seed).links[0]
    assert link.holds == (link.worst.ahead <= KEPT)
    assert link.infeasible.k == 0 < link.searched
    assert not link.holds
    lower, upper = box(link.worst.joints)
    assert (
        min(index_after(link.worst, np.array(jerk)) for jerk in itertools.product(*zip(lower, upper, strict=True)))
        > KEPT
    )


def test_what_a_search_finds_on_the_edge_of_its_part_ends_the_part():
    link = boundary()
    one = link.sample(1, np.random.default_rng(0))[0]
    states = np.ones((8, 8, 7), np.int64)
    infeasible = states.copy()
    infeasible[:3, 2:5, 3:] = 0
    counts = Counts(states, infeasible)
    part = largest_part(counts, link.domain)
    near, far = part.distance
    assert (part.states, part.tip_speed, part.authority) == (36, 0.375, 10.0)
    middle = {"tip_speed": 0.1, "distance": (near + far) / 2.0, "authority": 30.0}
    for changed in (
        {"tip_speed": part.tip_speed},
        {"distance": near - 1e-16},
        {"distance": far},
        {"authority": part.authority},
    ):
        there = one._replace(**{name: np.array([value]) for name, value in {**middle, **changed}.items()})
        assert largest_part(mark(counts, link.domain, there, part), link.domain) != part
        marked = mark(counts, link.domain, there, part).infeasible
        assert marked.sum() == infeasible.sum() + 1


def test_shares_add_up():
    link = sampled(PAPER, "elbow", states=1000)
    for shares in link.by:
        assert sum(share.states for share in shares) == 1000
        assert sum(share.infeasible for share in shares) == link.infeasible.k > 0
    assert [share.low for share in link.by.authority] == [0.0, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0]
    assert len(link.by.tip_speed) == len(link.by.distance) == 8
    plain = certify(ROBOT, PAPER, capsules=("elbow",), states=1000, search=False).as_json()["links"][0]
    assert plain["by"]["tip_speed"][0].keys() == {"low", "states", "infeasible"}
    assert plain["sampled_part"]["states"] == link.sampled_part.states


def test_a_planted_infeasible_pair_is_found():
    # hardly any weight on the acceleration: a step changes the index by next to nothing
    assert sampled(IndexParams(lambda1=3.0, lambda2=1e-3), "wrist_tool").infeasible.value > 0.2


def test_a_state_that_is_infeasible_by_construction_counts_as_such():
    # stretched, at rest, a person coming along the arm: no joint moves the tool along itself
    link = boundary(domain=Domain(distance=(0.5, 0.6), speed_share=0.0, acceleration_share=0.0))
    low, high = ROBOT.limits.position.T
    posture = np.array([0.3, 0.4, -np.arctan2(0.035, 0.42), 0.0, np.arctan2(0.035, 0.42), 0.0])
    # straight from elbow to tip only in the arm's plane: search for the rest of the singularity from there
    joints = np.zeros((3, 6))
    joints[0] = (posture - (low + high) / 2.0) / ((high - low) / 2.0)
    frames, segments = records(6, FRAME), records(1, SEGMENT)
    state = np.array([posture, np.zeros(6), np.zeros(6)])
    forward(ROBOT.links, state, frames)
    place(frames, ROBOT.capsules[4:5], segments)
    axis = segments[0]["end"] - segments[0]["start"]
    axis /= np.linalg.norm(axis)
    looks = link.look(np.r_[joints.ravel(), 1.0, 0.5, 0.5, 0.5, 0.0, axis, np.zeros(3)][None])
    lever = np.cross(frames[1]["axis"], segments[0]["end"] - frames[1]["origin"]) @ axis
    assert len(looks.ahead) == 1
    # the person comes on at D² / lambda1, and what J2 gives is all there is
    assert looks.authority[0] == pytest.approx(abs(lever) * ROBOT.limits.jerk[1], rel=0.05)
    drift = 2.0 * looks.distance[0] * -looks.rate[0] + 3.0**2 / 1.0 * looks.rate[0] + 3.0 * looks.distance[0] ** 2
    # the same state with so little jerk that it can just not, and just, do that much
    for share, infeasible in ((0.8, True), (1.25, False)):
        weak = replace(ROBOT, limits=replace(ROBOT.limits, jerk=share * drift / looks.authority[0] * ROBOT.limits.jerk))
        again = Boundary(weak, PAPER, "wrist_tool", replace(link.domain, viable=False), DT).look(looks.genes)
        assert again.authority[0] == pytest.approx(share * drift)
        assert again.infeasible[0] == infeasible


def test_a_search_finds_what_was_not_drawn():
    domain = replace(SLOW, tip_speed=0.5, speed_share=0.3, acceleration_share=0.2, authority=20.0)
    link = boundary(capsule="elbow", domain=domain)
    looks, _ = link.sample(2000, np.random.default_rng(6))
    worst = worsen(link, looks.genes[np.argsort(-looks.ahead)[:4]], np.random.default_rng(7))
    assert worst.ahead[0] > looks.ahead.max()
    found = link.state(worst, 0)
    assert np.all(np.diff(worst.ahead) <= 0.0)
    assert found.authority >= 20.0
    assert found.tip_speed <= 0.5
    assert index_after(found, np.zeros(6), 0.0) == pytest.approx(0.0, abs=1e-9)


def test_the_largest_part_holds_no_infeasible_state_and_none_is_larger():
    link = boundary(capsule="elbow")
    looks, draws = link.sample(20_000, np.random.default_rng(8))
    census = Census.of(link, looks, draws)
    part = largest_part(census.counts, link.domain)
    near, far = part.distance
    inside = (looks.tip_speed < part.tip_speed) & (looks.distance >= near) & (looks.distance < far)
    inside &= looks.authority >= part.authority
    assert inside.sum() == pytest.approx(part.states, abs=2)  # rounding at edges
    assert not looks.infeasible[inside].any()
    # 0 of n with a bound for every part that could have been chosen
    assert part.bound == pytest.approx(1.0 - (0.05 / (8 * 36 * 7)) ** (1.0 / part.states))
    assert part.bound > 3.0 / part.states
    assert looks.infeasible.any()
    full = census.counts._replace(infeasible=np.ones_like(census.counts.infeasible))
    assert largest_part(full, link.domain) is None


def test_where_there_is_the_jerk_of_the_condition_hardly_any_state_is_infeasible():
    link = sampled(PAPER, "elbow", states=20_000)
    assert link.enough.n > 5000
    assert link.enough.value < 0.1 * link.infeasible.value
    assert sampled(IndexParams(lambda1=0.5, lambda2=0.5), "elbow", states=50).enough is None  # poorly damped


# ---- counter-examples


@pytest.fixture(scope="module")
def shoulder():
    found = certify(ROBOT, PAPER, capsules=("upper_arm",), states=2000, search=False)
    assert not found.holds
    return found.links[0].worst


def test_the_shield_cannot_keep_the_worst_state_and_mujoco_sees_the_same(tmp_path, shoulder):
    trace = save_counterexample(tmp_path / "worst.npz", ROBOT, PAPER, shoulder, dt=DT, viable=True)
    assert trace.phi[0] == pytest.approx(shoulder.ahead, abs=1e-4)
    assert trace.phi[0] > KEPT
    assert trace.status[0] == jssa_gym.Status.RELAXED
    lower, upper = box(shoulder.joints)
    assert np.all((lower <= trace.jerk[0]) & (trace.jerk[0] <= upper))
    # the person walks on from where the state has them, and distances are MuJoCo's as well
    walked = shoulder.centre + trace.time[:, None] * shoulder.velocity
    np.testing.assert_allclose(trace.human_start[:, 0], walked, atol=1e-12)
    assert np.linalg.norm(walked[-1] - shoulder.centre) > 0.01
    assert judge(trace, ROBOT).agrees
    again, index, found, viable = load_counterexample(tmp_path / "worst.npz")
    assert (index, viable, found.capsule) == (PAPER, True, "upper_arm")
    repeated = play_on(ROBOT, index, found, dt=again.dt, viable=viable)
    assert repeated.jerk.tobytes() == trace.jerk.tobytes() == again.jerk.tobytes()


def test_the_shield_has_the_jerk_that_the_state_was_judged_by():
    # at rest it is the joints' limits that take away the jerk that would keep it
    domain = replace(REST, viable=True)
    found = certify(ROBOT, PAPER, domain=domain, capsules=("wrist_tool",), states=500).links[0].worst
    assert play_on(ROBOT, PAPER, found, ticks=1).phi[0] == pytest.approx(found.ahead, abs=1e-3)
    assert play_on(ROBOT, PAPER, found, ticks=1).phi[0] > KEPT
    assert play_on(ROBOT, PAPER, found, ticks=1, viable=False).phi[0] <= KEPT


def test_a_feasible_state_is_kept_by_the_shield():
    link = boundary(domain=SLOW)
    looks, _ = link.sample(5, np.random.default_rng(9))
    for k in range(5):
        trace = play_on(ROBOT, PAPER, link.state(looks, k), dt=DT, ticks=1)
        assert trace.phi[0] <= KEPT


def test_another_trace_is_no_counter_example(tmp_path, shoulder):
    save_trace(play_on(ROBOT, PAPER, shoulder, ticks=2), tmp_path / "other.npz", {"seed": 1})
    with pytest.raises(TraceError, match="boundary state"):
        load_counterexample(tmp_path / "other.npz")


# ---- files and input


def test_a_state_of_another_robot_is_an_error(shoulder, toy_robot):
    with pytest.raises(ParameterError, match="capsule"):
        play_on(toy_robot, PAPER, shoulder)
    with pytest.raises(ParameterError, match="joints"):
        play_on(ROBOT, PAPER, replace(shoulder, joints=shoulder.joints[:, :3]))


def test_an_interrupted_certificate_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr("jssa_gym.certificate.certify._CHUNK", 500)
    asked = {"domain": SLOW, "capsules": ("wrist_tool",), "seed": 2, "search": False}
    whole = certify(ROBOT, PAPER, states=600, **asked).as_json()
    seen = []

    def stop(count):
        seen.append(count)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        certify(ROBOT, PAPER, states=600, folder=tmp_path, progress=stop, **asked)
    file = tmp_path / "chunks.jsonl"
    assert len(file.read_text().splitlines()) == 2
    with file.open("a") as half:
        half.write('[["wrist_tool", 1, 100], {"sta')
    counted = []
    again = certify(ROBOT, PAPER, states=600, folder=tmp_path, progress=counted.append, **asked)
    assert again.as_json() == whole
    assert counted == [500, 100]
    # what was cut off has gone, and everything is there
    assert [json.loads(line)[0] for line in file.read_text().splitlines()[1:]] == [
        ["wrist_tool", 0, 500],
        ["wrist_tool", 1, 100],
    ]
    with pytest.raises(ParameterError, match=r"another certificate.*index"):
        certify(ROBOT, IndexParams(), states=1000, folder=tmp_path, **asked)
    # another arm of the same name has other counts
    longer = ROBOT.capsules.copy()
    longer["radius"] += 0.001
    with pytest.raises(ParameterError, match=r"another certificate.*model"):
        certify(replace(ROBOT, capsules=longer), PAPER, states=600, folder=tmp_path, **asked)
    file.write_text(file.read_text() + "{}\n")
    with pytest.raises(ParameterError, match="no count"):
        certify(ROBOT, PAPER, states=600, folder=tmp_path, **asked)
    first = file.read_text().splitlines()[0]
    for mine in ("mine\n", "mine", "{}\nhalf"):
        file.write_text(mine)
        with pytest.raises(ParameterError, match=r"no file of counts|another certificate"):
            certify(ROBOT, PAPER, states=600, folder=tmp_path, **asked)
        assert file.read_text() == mine
    # a crash may have cut the first line off as well
    file.write_text(first[:40])
    assert certify(ROBOT, PAPER, states=600, folder=tmp_path, **asked).as_json() == whole


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"capsules": ("nose",)}, "capsule"),
        ({"states": 0}, "states"),
        ({"states": True}, "states"),
        ({"jobs": 0}, "jobs"),
        ({"seed": -1}, "seed"),
        ({"dt": 0.0}, "dt"),
        ({"robot": "nobody"}, "robot"),
        ({"domain": Domain(distance=(8.0, 9.0))}, "hardly any state"),
    ],
    ids=str,
)
def test_bad_input_is_an_error(options, word):
    with pytest.raises(ParameterError, match=word):
        certify(**{"robot": ROBOT, "states": 100, "search": False, **options})


@pytest.mark.parametrize(
    "values", [{"tip_speed": 0.0}, {"distance": (0.5, 0.1)}, {"authority": -1.0}, {"viable": 1}, {"speed_share": 2.0}]
)
def test_a_domain_out_of_range_is_an_error(values):
    with pytest.raises(ParameterError, match=next(iter(values))):
        Domain(**values)


def test_other_arms_have_certificates_too(toy_robot):
    found = jssa_gym.certify(toy_robot, states=300, seed=3, search=False)
    assert [link.capsule for link in found.links] == ["second", "third"]
    assert found.robot == "toy"


# ---- the condition and the certificate set


def ends_in_time(index, distance, rate):
    """Whether the slowest motion with phi = 0 keeps the margin, by simulating it."""

    def passed(_, y):
        return y[0] - index.d_min + 1e-9

    passed.terminal, passed.direction = True, -1
    run = solve_ivp(
        lambda _, y: [y[1], (index.d_min**2 - y[0] ** 2 - index.lambda1 * y[1]) / index.lambda2],
        (0.0, 400.0),
        [distance, rate],
        rtol=1e-10,
        atol=1e-12,
        events=passed,
    )
    return run.status != 1


@pytest.mark.sampled(3)
@pytest.mark.parametrize("pair", [(3.0, 1.0), (2.0, 0.25), (6.0, 8.0)])
@pytest.mark.parametrize("distance", [0.1, 0.5, 1.0])
def test_the_certificate_set_ends_where_approaches_end_too_late(pair, distance):
    index = IndexParams(lambda1=pair[0], lambda2=pair[1])
    edge = float(fastest_approach(index, distance))
    assert ends_in_time(index, distance, 0.99 * edge)
    assert not ends_in_time(index, distance, 1.01 * edge)


def test_the_certificate_set_ends_where_even_rest_comes_in_too_fast():
    index = IndexParams(lambda1=0.5, lambda2=0.5)
    near, far, inside = fastest_approach(index, [0.1, 1.0, 0.04])
    assert ends_in_time(index, 0.1, 0.99 * near)
    assert far == inside == np.inf
    assert not ends_in_time(index, 1.0, 0.0)
    assert fastest_approach(index, 0.05) == 0.0


def test_the_condition_holds_where_it_should():
    # written out for lambda = (6, 8), d = 0.5 m, v = 1 m/s: 64 j >= 36 + 6 (0.25 - 0.0025)
    index, least = IndexParams(lambda1=6.0, lambda2=8.0), (36.0 + 6.0 * 0.2475) / 64.0
    assert needed_jerk(index, approach=1.0, distance=0.5) == pytest.approx(least)
    assert suffices(index, jerk=least * 1.001, approach=1.0, distance=0.5)
    assert not suffices(index, jerk=least * 0.999, approach=1.0, distance=0.5)
    # its other half: lambda1² >= 2 lambda2 d
    assert not suffices(index, jerk=1e9, approach=1.0, distance=2.3)


@pytest.mark.parametrize("damping", [2.0, 5.0, 8.0])
def test_the_proposal_is_the_smallest_that_suffices(damping):
    asked = {"jerk": 10.0, "approach": 1.0, "distance": 0.5}
    index = propose(**asked, damping=damping)
    assert suffices(index, **asked)
    smaller = IndexParams(lambda1=index.lambda1 * 0.999, lambda2=index.lambda2 * 0.999**2)
    assert not suffices(smaller, **asked)


# ---- the map


def test_the_map_names_the_pair_that_loses_least():
    swept = sweep(ROBOT, grid=3, states=60, capsules=("wrist_tool",), domain=Domain(distance=(0.05, 1.0)))
    assert all(cell.lambda1**2 >= 8.0 * cell.lambda2 * 0.05 for cell in swept.cells)
    assert all(cell.trigger <= 1.0 for cell in swept.allowed)
    assert len(swept.allowed) < len(swept.cells)
    assert swept.best.cost == min(cell.cost for cell in swept.allowed)
    # finer grids drew more, but boundedly many
    assert {cell.lost["wrist_tool"].n for cell in swept.cells} == {60, 240, 960}
    assert len(swept.cells) <= 9 + 2 * 25
    for cell in swept.cells:
        assert cell.lost["wrist_tool"].k >= cell.infeasible["wrist_tool"].k
        assert 0.5 <= cell.lambda1 <= 8.0
        assert 0.05 <= cell.lambda2 <= 8.0
    assert any(cell.lost["wrist_tool"].k > cell.infeasible["wrist_tool"].k for cell in swept.cells)
    assert swept.best.lost["wrist_tool"].n > 60
    with pytest.raises(ParameterError, match="trigger"):
        sweep(ROBOT, grid=2, states=20, lambda1=(4.0, 8.0), capsules=("wrist_tool",))
    with pytest.raises(ParameterError, match="lambda2"):
        sweep(ROBOT, lambda2=(0.0, 1.0))
    with pytest.raises(ParameterError, match="grid"):
        sweep(ROBOT, grid=1)


@pytest.mark.parametrize("share", [0.5, 0.25])
def test_a_finer_grid_holds_the_best_pair_itself(share):
    axis = np.geomspace(0.5, 8.0, 5)
    inside = lambda_map.around(axis, axis[2], share)
    assert inside[2] == axis[2]  # to the bit, or the first, luckier, draw would be kept beside it
    np.testing.assert_allclose(inside[1:] / inside[:-1], 2.0**share)
    for edge in (axis[0], axis[-1]):
        near = lambda_map.around(axis, edge, share)
        assert len(near) == 3
        assert edge in near
        assert np.all((axis[0] <= near) & (near <= axis[-1]))


@pytest.mark.parametrize("arguments", [("--sweep",), ("--sweep", "--json")], ids=str)
def test_the_map_says_at_once_what_to_install(tmp_path, capsys, monkeypatch, arguments):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(MissingExtraError, match=r"jssa-gym\[plots\]"):
        command(capsys, *arguments, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_generators_have_nothing_in_common():
    first = [generator(0, *key).random() for key in ((0, 1, 0), (0, 1, 1), (0, 2, 0), (1, 1))]
    assert len(set(first)) == 4


@pytest.mark.slow
def test_a_million_states_of_the_paper():
    found = certify(ROBOT, PAPER, states=1_000_000, jobs=2)
    shares = {link.capsule: link.infeasible for link in found.links}
    assert 0.02 < shares["upper_arm"].low < shares["upper_arm"].high < 0.04
    assert not found.holds
    assert not found.suffices


# ---- the command


def command(capsys, *arguments):
    """``jssa-gym certify`` in this process: exit code and what it printed."""
    import tyro

    from jssa_gym.cli.certify import Certify

    try:
        tyro.cli(Certify, args=list(map(str, arguments))).run()
        code = 0
    except SystemExit as end:
        code = end.code
    return code, capsys.readouterr().out


REST_OPTIONS = (
    *("--tip-speed", 0.05, "--human-speed", 0.5, "--distance", 0.2, 0.5),
    *("--speed-share", 0, "--acceleration-share", 0, "--authority", 40, "--no-viable"),
    *("--capsules", "wrist_tool"),
)


def test_the_command_fails_where_there_are_counter_examples_and_replays_them(tmp_path, capsys):
    asked = ("--lambda1", 3, "--lambda2", 1, "--states", 1000, "--no-search", "--out", tmp_path / "out")
    code, printed = command(capsys, *asked, "--capsules", "upper_arm", "--json")
    assert code == 1
    saved = json.loads((tmp_path / "out" / "certificate.json").read_text())
    assert json.loads(printed) == saved
    assert not saved["holds"]
    assert saved["links"][0]["margin"] < 0.0
    link = saved["links"][0]
    assert 0 < link["infeasible_inside"] <= link["infeasible"]["k"]
    _, printed = command(capsys, *asked, "--capsules", "upper_arm")
    inside = f"{link['infeasible_inside']:,} / {1000 - link['outside']['k']:,}"
    assert f"inside the set 𝒞 of such approaches {inside}" in " ".join(printed.split())
    assert "the set does not hold" in printed
    assert "that a search in it found" not in printed
    recording = tmp_path / "out" / "counterexample-upper_arm.npz"
    code, printed = command(capsys, "--replay", recording, "--json")
    played = json.loads(printed)
    assert code == 0
    assert played["infeasible"] and played["same"] and played["mujoco_agrees"]  # noqa: PT018
    assert played["ticks"][0]["phi"] > KEPT
    trace = load_trace(recording)
    save_trace(replace(trace, phi=trace.phi + 1e-6), tmp_path / "other.npz", read_meta(recording))
    code, printed = command(capsys, "--replay", tmp_path / "other.npz", "--json")
    assert code == 1
    assert not json.loads(printed)["same"]
    code, printed = command(capsys, "--replay", recording)
    assert code == 0
    assert "no jerk keeps all rows" in printed


def test_the_command_passes_where_there_are_none(tmp_path, capsys):
    code, printed = command(capsys, "--lambda1", 3, "--lambda2", 1, "--states", 300, "--out", tmp_path, *REST_OPTIONS)
    assert code == 0
    assert "no counter-example was found" in printed
    assert "none that was drawn leaves it" in printed
    assert "search in it found" in printed
    assert sorted(path.name for path in tmp_path.iterdir()) == ["certificate.json", "chunks.jsonl"]


@pytest.mark.long
def test_the_command_draws_the_map(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    code, printed = command(
        *(capsys, "--sweep", "--trigger", 1.5, "--grid", 2, "--states", 20),
        *("--capsules", "wrist_tool", "--out", tmp_path, "--json"),
    )
    assert code == 0
    swept = json.loads(printed)
    assert swept == json.loads((tmp_path / "map.json").read_text())
    assert swept["trigger"] == 1.5
    assert swept["best"]["trigger"] <= 1.5 < max(cell["trigger"] for cell in swept["cells"])
    assert swept["best"]["lost"]["wrist_tool"]["n"] in {80, 320}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.json", "map.png"]
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("arguments", [("--states", 0), ("--lambda1", "nan"), ("--sweep", "--grid", 1)], ids=str)
def test_the_command_refuses_bad_input_and_writes_nothing(tmp_path, capsys, arguments):
    with pytest.raises(ParameterError):
        command(capsys, *arguments, "--out", tmp_path / "out")
    assert not list(tmp_path.glob("out/*"))
