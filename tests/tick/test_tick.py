"""The compiled control step: thousands of arms in one call decide as each of them would alone."""

import ast
import gc
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest
from numba import config
from picklable import Distant

import jssa_gym
from jssa_gym.exceptions import ParameterError
from jssa_gym.humans import Body
from jssa_gym.kernels.motion import integrate
from jssa_gym.safety.failsafe import FailsafeParams
from jssa_gym.shields import FILTERS, JSSAFilter, NoFilter, make_filter
from jssa_gym.shields.batch import Batch
from jssa_gym.shields.reasons import reason_code
from jssa_gym.shields.words import reason_codes
from jssa_gym.types import CapsuleSet, Decision, JointState, Status

DT = 0.008
ARMS, TICKS = 16, 220

POST = CapsuleSet(
    np.array([[0.5, 0.6, 0.87]]), np.array([[0.5, 0.6, 1.6]]), np.zeros((1, 3)), np.zeros((1, 3)), np.array([0.05]),
    ("post",), np.zeros(1, np.int64),
)  # fmt: skip

KINDS = {
    "exact": JSSAFilter,
    "at once": lambda *args, **options: JSSAFilter(*args, recovery=0.0, **options),
    "closest": lambda *args, **options: JSSAFilter(*args, rows="closest", **options),
    "static rows": lambda *args, **options: JSSAFilter(*args, static_rows=True, **options),
    "weighted": lambda *args, **options: JSSAFilter(*args, weight=np.arange(1.0, 7.0), **options),
    "printed": lambda *args, **options: JSSAFilter(*args, gradient="printed", **options),
    "none": NoFilter,
    # "stop" is "none" with layers of its own, the rest is above
    **{name: FILTERS[name] for name in FILTERS if name not in ("none", "stop") and not name.startswith("jssa")},
}
LAYERS = {
    "bare": {},
    "guarded": {"viability": True, "failsafe": FailsafeParams()},
    "guarded, measured": {
        "failsafe": FailsafeParams(position_error=0.005, actuation_lag=0.02, state_tolerance=(1e-6, 1e-4, np.inf))
    },
}


def _nan(array):
    return np.full_like(array, np.nan)


def _robot(scene, **changes):
    return scene._replace(robot=scene.robot._replace(**changes))


FAULTS = {
    "fine": lambda scene, last: scene,
    "no scene": lambda scene, last: None,
    "joints are no number": lambda scene, last: _robot(scene, velocity=_nan(scene.robot.velocity)),
    "joints are elsewhere": lambda scene, last: _robot(scene, position=scene.robot.position + 0.01),
    "joints are frozen": lambda scene, last: scene._replace(robot=last.robot),
    "the scene is frozen": lambda scene, last: last,
    "the clock is none": lambda scene, last: scene._replace(time=np.nan),
    "the clock went back": lambda scene, last: scene._replace(time=scene.time - 0.5),
    "people are no number": lambda scene, last: scene._replace(human=scene.human._replace(end=_nan(scene.human.end))),
    "nobody is measured": lambda scene, last: scene._replace(valid=np.zeros_like(scene.valid)),
    "people are old": lambda scene, last: scene._replace(age=scene.age + 0.3),
    "people jump": lambda scene, last: scene._replace(human=scene.human._replace(start=scene.human.start + 1.0)),
    "the post is no number": lambda scene, last: scene._replace(static=POST._replace(start=_nan(POST.start))),
    "the post moves": lambda scene, last: scene._replace(static=POST._replace(start=POST.start + 0.1)),
}


class Episode:
    """An arm that does what it is told, who walks up to it, and what is wrong with what is shown of both."""

    def __init__(self, robot, make_scene, number):
        self.make_scene, self.rng = make_scene, np.random.default_rng(number)
        self.state = np.array([robot.home + self.rng.uniform(-0.2, 0.2, 6), np.zeros(6), np.zeros(6)])
        self.root, way = self.rng.uniform([0.7, -0.6], [1.4, 0.6]), self.rng.uniform(-0.2, 0.2, 2)
        self.walk = tuple(self.rng.uniform(0.2, 0.9) * (way - self.root) / np.linalg.norm(way - self.root))
        self.nominal, self.bound = np.zeros(6), np.array(robot.limits.jerk)
        self.shown = self.last = self.scene(0)

    def scene(self, k):
        place = tuple(self.root + DT * k * np.array(self.walk))
        human = Body.facing(0.3).at(place, self.walk)
        return self.make_scene(self.state, human, time=DT * k)._replace(static=POST)

    def look(self, k):
        """What is shown in this tick and what is wanted."""
        if k % 12 == 0:
            self.nominal = self.rng.choice([-1.0, 0.0, 1.0, 1.3], 6) * self.rng.uniform(0.1, 1.0) * self.bound
        fault = self.rng.choice(list(FAULTS)[1:]) if self.rng.random() < 0.04 else "fine"
        nominal = self.nominal if self.rng.random() < 0.99 else _nan(self.nominal)
        scene = self.scene(k)
        self.shown, self.last = FAULTS[fault](scene, self.last), scene
        return self.shown, nominal


class Together(Batch):
    """Many arms, whose scenes are filled in by hand."""

    def __init__(self, filter, scenes):
        self.fixed = filter.settings().guarded or filter.settings().static_rows
        super().__init__(filter, len(scenes), scenes[0].human.names, statics=int(self.fixed), planes=int(self.fixed))
        for e, scene in enumerate(scenes):
            self.show(e, scene)
        self.start()

    def show(self, e, scene):
        to, now = self.scene, self.scene.now[e]
        for part in ("timed", "joints", "people", "seen", "fixtures"):
            now[part] = scene is not None
        if scene is None:
            return
        now["time"], to.joints[e], to.ends[e] = scene.time, scene.robot, scene.human[:4]
        to.radius[e], to.person[e], to.age[e], to.valid[e] = scene.human.radius, 0, scene.age, scene.valid
        if self.fixed:
            to.static_ends[e], to.static_radius[e] = scene.static[:4], scene.static.radius
            to.normal[e], to.offset[e] = scene.planes.normal, scene.planes.offset


def same(one, other, what):
    """Bit for bit, field by field: what is no number is none in both."""
    for name in one.dtype.names or ():
        np.testing.assert_array_equal(one[name], other[name], err_msg=f"{what}: {name}")
    if not one.dtype.names:
        np.testing.assert_array_equal(one, other, err_msg=what)


def combinations():
    """Every filter with and without its layers; other assumptions are the layers' business, whatever is inside."""
    for kind in KINDS:
        for layers in LAYERS:
            first = kind in ("exact", "none")
            rare = layers == "guarded, measured" and not first
            marks = () if layers == "guarded" and first else pytest.mark.slow if rare else pytest.mark.long
            yield pytest.param(kind, layers, marks=marks)


@pytest.mark.long
@pytest.mark.parametrize(("kind", "layers"), list(combinations()))
def test_many_arms_decide_as_each_of_them_would_alone(robot, make_scene, kind, layers):
    episodes = [Episode(robot, make_scene, e) for e in range(ARMS)]
    alone = [KINDS[kind](robot, DT, **LAYERS[layers]) for _ in episodes]
    for filter, episode in zip(alone, episodes, strict=True):
        filter.reset(episode.shown)
    together = Together(alone[0], [episode.shown for episode in episodes])
    nominals, seen, codes = np.zeros((ARMS, 6)), set(), set()
    for k in range(TICKS):
        decisions = []
        for e, (filter, episode) in enumerate(zip(alone, episodes, strict=True)):
            scene, nominals[e] = episode.look(k)
            together.show(e, scene)
            decisions.append(filter.decide(scene, nominals[e]))
        together.decide(nominals)
        told, what = together.answer.told, f"in tick {k}"
        same(together.answer.jerk, np.array([decision.jerk for decision in decisions]), what)
        for name in ("status", "phi", "distance", "slack", "rows"):
            same(told[name], np.array([getattr(decision, name) for decision in decisions]), f"{what}: {name}")
        assert list(zip(told["row"], told["column"], strict=True)) == [decision.pair for decision in decisions]
        same(told, np.array([filter.records.answer.told[0] for filter in alone]), what)
        numbers = reason_codes(told, np.isfinite(nominals).all(axis=1), layers != "bare")
        assert numbers.tolist() == [reason_code(decision) for decision in decisions], what
        for name in ("arm", "state", "expected", "applied", "stored"):
            each = np.array([getattr(filter.records.memory, name)[0] for filter in alone])
            same(getattr(together.memory, name), each, f"{what}: {name}")
        seen |= {decision.status for decision in decisions}
        codes |= set(told["code"].tolist())
        for episode, decision in zip(episodes, decisions, strict=True):
            integrate(episode.state, decision.jerk, DT, episode.state)
    # a comparison of arms that never do anything shows nothing
    assert {Status.NOMINAL, Status.FAULT} <= seen
    assert (Status.FAILSAFE in seen) == (layers != "bare")
    assert (kind == "none") or seen & {Status.PROJECTED, Status.RELAXED}
    assert len(codes) > (5 if layers == "bare" else 12)


@pytest.mark.parametrize("name", FILTERS)
def test_a_batch_takes_whatever_has_a_name_and_refuses_who_proposes_in_python(name, robot):
    chosen = make_filter(name, robot, DT)
    assert Batch(chosen, 3, ("head",)).decide(np.zeros((3, 6))).jerk.shape == (3, 6)
    own = type("Own", (type(chosen),), {"respond": lambda *_: None})
    with pytest.raises(ParameterError, match="Own proposes in Python"):
        Batch(own(robot, DT), 3, ("head",))


@pytest.mark.long
@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="without compilation there are no pointers")
def test_a_pointer_keeps_alive_what_compiled_code_counts_no_references_to(robot):
    batch = Batch(NoFilter(robot, DT), 3, ("head",))
    pointer = batch.arms
    held = [weakref.ref(part) for part in (batch.memory.state, batch.scene.ends, batch.answer.jerk)]
    del batch
    gc.collect()
    assert all(part() is not None for part in held)
    del pointer
    gc.collect()
    assert all(part() is None for part in held)


def test_a_batch_refuses_a_projector_and_a_filter_that_are_not_compiled(robot):
    with pytest.raises(ParameterError, match="JSSAFilter proposes in Python"):
        Batch(JSSAFilter(robot, DT, projector="osqp"), 3, ("head",))
    with pytest.raises(ParameterError, match="Distant proposes in Python"):
        Batch(Distant(robot, DT), 3, ("head",))


EVERY_KIND = """
import numpy as np
from jssa_gym.robots import make_robot
from jssa_gym.shields import FILTERS, make_filter
from jssa_gym.shields.batch import Batch
from jssa_gym.tick import loop
from jssa_gym.tick.propose import KINDS
robot, nominal = make_robot("lr_mate_200id_7l"), np.zeros((1, 6))
filters = [make_filter(name, robot, 0.008) for name in FILTERS]
assert {type(filter.proposal) for filter in filters} == set(KINDS)
for filter in filters:
    assert Batch(filter, 1, ()).decide(nominal).told["status"] == 0
stats, kinds = loop.decide_all.stats, len(KINDS)
assert len(loop.decide_all.signatures) == kinds, loop.decide_all.signatures
print(sum(stats.cache_hits.values()) == kinds and not stats.cache_misses)
"""


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
@pytest.mark.long
def test_the_control_step_of_every_kind_of_filter_is_kept_on_disk_for_itself():
    first, second = (
        subprocess.run([sys.executable, "-c", EVERY_KIND], capture_output=True, text=True, check=True).stdout.strip()
        for _ in range(2)
    )
    assert first in ("True", "False")  # as much as other tests have left to compile
    assert second == "True"


@pytest.mark.parametrize(
    "nominal", [np.zeros(6), np.zeros((2, 6)), np.zeros((3, 6), np.float32), [[0.0] * 6] * 3, None]
)
def test_a_batch_wants_a_jerk_for_every_arm(nominal, robot):
    with pytest.raises(ParameterError, match=r"float64 array of shape \(3, 6\)"):
        Batch(NoFilter(robot, DT), 3, ()).decide(nominal)


def test_no_part_has_more_than_eight_arguments():
    folder, many, count = Path(jssa_gym.__file__).parent / "tick", [], 0
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                count += 1
                names = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                many += [f"{path.stem}.{node.name}"] * (len(names) > 8 or bool(node.args.vararg or node.args.kwarg))
    assert count > 40
    assert many == []


# ---- filters that name who proposes ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["jssa", "jssa_published", "none", "stop"])
def test_a_filter_that_names_who_proposes_is_not_asked(name, robot, make_scene, monkeypatch):
    chosen = make_filter(name, robot, DT)
    for kind in (JSSAFilter, NoFilter):
        monkeypatch.setattr(kind, "respond", lambda *_: pytest.fail("asked"))
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)])
    chosen.reset(scene)
    assert chosen.decide(scene, np.zeros(6)).status == Status.NOMINAL


@pytest.mark.parametrize("method", ["respond", "foresee"])
@pytest.mark.parametrize("kind", [JSSAFilter, NoFilter])
def test_a_subclass_is_asked_for_what_it_answers_itself(kind, method, robot, make_scene):
    """Though the class that it is made of is compiled; what it does not change is what that decides."""
    calls = []

    def answer(self, *args):
        calls.append(args)
        return getattr(super(type(self), self), method)(*args)

    own, base = (
        made(robot, DT, viability=True, failsafe=FailsafeParams())
        for made in (type("Own", (kind,), {method: answer}), kind)
    )
    near = Body.facing().at((0.75, 0.1), (-0.3, 0.0))
    state, statuses = np.array([robot.home, np.zeros(6), np.zeros(6)]), set()
    for filter in (own, base):
        filter.reset(make_scene(state, near))
    for k in range(60):
        scene = make_scene(state, near, time=DT * k)
        decision, expected = (filter.decide(scene, 0.3 * robot.limits.jerk) for filter in (own, base))
        for name in Decision._fields:
            np.testing.assert_array_equal(getattr(decision, name), getattr(expected, name), err_msg=name)
        statuses.add(decision.status)
        integrate(state, decision.jerk, DT, state)
    assert Status.FAILSAFE in statuses
    # nothing is foreseen by a filter that has no index
    assert bool(calls) == (method == "respond" or kind is JSSAFilter)


def test_a_scene_is_believed_as_it_was_when_it_was_decided(robot, make_scene):
    """What is read is taken down: neither answer nor memory is a view of what was shown, or of what is shown next."""
    chosen = make_filter("jssa", robot, DT, viability=True, failsafe=FailsafeParams())
    people = Body.facing().at((1.0, 0.0), (0.0, 0.0))
    scene = make_scene([robot.home, np.zeros(6), np.zeros(6)], people)
    chosen.reset(scene)
    first = chosen.decide(scene, 0.1 * robot.limits.jerk)
    kept = first.jerk.copy()
    for array in (*scene.robot, *scene.human[:5]):
        array[...] = np.nan
    state = np.array([robot.home, np.zeros(6), np.zeros(6)])
    integrate(state, kept, DT, state)
    second = chosen.decide(
        make_scene(state, Body.facing().at((1.0, 0.0), (0.0, 0.0)), time=DT)._replace(robot=JointState(*state)),
        -0.1 * robot.limits.jerk,
    )
    np.testing.assert_array_equal(first.jerk, kept)
    assert second.status == Status.NOMINAL, second.reason
