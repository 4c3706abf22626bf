"""Shields by name: one word, one meaning, whoever reads it; and the options of the JSSA shield."""

import dataclasses
import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import jssa_gym
from jssa_gym.evaluation import put_filter
from jssa_gym.evaluation.campaign import Grid
from jssa_gym.evaluation.contenders import CONTENDERS, contender, contender_names
from jssa_gym.evaluation.study import Study
from jssa_gym.exceptions import ParameterError
from jssa_gym.registration import ENTRIES
from jssa_gym.shields import (
    FILTERS,
    STOP,
    CBFParams,
    JSSAFilter,
    JSSAOptions,
    JSSAShield,
    NoFilter,
    Shield,
    make_filter,
    read_name,
)
from jssa_gym.shields.registry import UNSHIELDED
from jssa_gym.viewer.choices import ShieldChoice

ASSUMED = jssa_gym.FailsafeParams(human_speed=1.2, contact_speed={"right_arm": 0.1})

VALID = r"unknown filter .*valid: jssa, .*, each also with.*, work, yield and shielded"


def arm(task: str = "home") -> gym.Env:
    return gym.make(ENTRIES[task].env_id())


def settings(shield: gym.Env) -> tuple:
    """All that a shield's filter was told."""
    while not isinstance(shield, Shield):  # a shielded id has its shield inside of what Gymnasium puts around it
        shield = shield.env
    told = shield.filter
    form = ()
    if isinstance(told, JSSAFilter):
        form = (told.rows, told.gradient, told.static_rows, told.recovery, type(told.projector), told.proposal)
    return type(told), told.params, told.viability, told.failsafe, form


# ---- one word, one meaning ---------------------------------------------------------------------------


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", [name + end for end in ("", STOP) for name in FILTERS])
def test_a_name_means_the_same_to_everybody(name):
    bare, stop = read_name(name)
    assert (bare + STOP == name, bare == name) == (stop, not stop)
    robot, dt = arm().unwrapped.robot, arm().unwrapped.dt
    told = settings(Shield(arm(), make_filter(name, robot, dt)))
    assert settings(Shield(arm(), name)) == settings(Shield(arm(), bare, stop=stop)) == told
    assert settings(put_filter(arm(), name)) == told
    guarded = stop or bare == "stop"
    assert told[2:4] == (guarded, jssa_gym.FailsafeParams() if guarded else None)
    assert settings(contender(name).wrap(arm(), jssa_gym.FailsafeParams())) == told
    noisy = contender(name).wrap(arm(), ASSUMED).filter.failsafe
    assert noisy == (ASSUMED if guarded else None)
    assert contender(name).promises == guarded
    Study(("home",), (name,), ("none",), ("hold",))
    Grid((name,), ("none",), ("hold",))


@pytest.mark.parametrize(
    ("word", "name", "shield"),
    [
        ("full", "jssa+stop", JSSAShield),
        ("published", "jssa_published", JSSAShield.as_published),
        ("jssa", "jssa", lambda env: JSSAShield(env, viability=False, failsafe=False)),
        ("near", "jssa_near+stop", lambda env: JSSAShield(env, lambda1=0.4, lambda2=0.1)),
    ],
)
def test_the_words_of_campaigns_and_the_classes_are_filters_too(word, name, shield):
    told = settings(Shield(arm(), name))
    assert settings(shield(arm())) == told
    if word in CONTENDERS:
        assert settings(CONTENDERS[word].wrap(arm(), jssa_gym.FailsafeParams())) == told


def test_none_is_a_filter_everywhere_and_no_shield_is_unshielded():
    env = arm()
    assert contender(UNSHIELDED).wrap(env, ASSUMED) is ShieldChoice(UNSHIELDED).around(env) is env
    for shield in (Shield(env, "none"), contender("none").wrap(env, ASSUMED), ShieldChoice("none").around(env)):
        assert isinstance(shield.filter, NoFilter)


@pytest.mark.parametrize("task", ENTRIES)
def test_the_shield_of_a_task_by_name(task):
    told = settings(gym.make(ENTRIES[task].env_id(shielded=True)))
    assert settings(Shield(arm(task), "shielded")) == settings(put_filter(arm(task), "shielded")) == told
    assert settings(JSSAShield(arm(task), **ENTRIES[task].shield)) == told


@pytest.mark.parametrize("name", ["magic", "magic+stop", "jssa+stop+stop", "+stop", "", "full", None, 3])
def test_another_name_is_refused_everywhere(name):
    calls = [read_name, lambda name: make_filter(name, robot, 0.008), lambda name: Study(filters=(name,), **rest)]
    robot, rest = arm().unwrapped.robot, {"tasks": ("home",), "humans": ("none",), "policies": ("hold",)}
    if isinstance(name, str):
        calls += [lambda name: Shield(arm(), name), lambda name: put_filter(arm(), name)]
    for call in calls:
        with pytest.raises(ParameterError, match=VALID):
            call(name)
    if name != "full":
        with pytest.raises(ParameterError, match=re.escape(", ".join(contender_names()))):
            Grid((name,), ("none",), ("hold",))


def test_a_task_s_shield_needs_a_task_and_is_complete():
    with pytest.raises(ParameterError, match="Shield\\(env, 'shielded'\\)"):
        make_filter("shielded", arm().unwrapped.robot, 0.008)
    for change in ({"stop": True}, {"lambda1": 3.0}):
        with pytest.raises(ParameterError, match="complete"):
            Shield(arm(), "shielded", **change)
    env = arm()
    env.unwrapped.task = None
    with pytest.raises(ParameterError, match="no task with a shielded id"):
        Shield(env, "shielded")
    with pytest.raises(ParameterError, match="unknown filter 'shielded'"):
        Grid(("shielded",), ("none",), ("hold",))


# ---- a filter by name, with changes ------------------------------------------------------------------


def test_keywords_are_parameters_of_the_filter():
    kind, params, viability, failsafe, _ = settings(Shield(arm(), "cbf", stop=True, k1=2.0, rows="closest"))
    assert (kind, params) == (FILTERS["cbf"], CBFParams(k1=2.0, rows="closest"))
    assert (viability, failsafe) == (True, jssa_gym.FailsafeParams())
    near = Shield(arm(), "jssa_near", d_min=0.1).filter.params
    assert near == jssa_gym.IndexParams(d_min=0.1, lambda1=0.4, lambda2=0.1)  # the rest stays the name's own
    for stop in (ASSUMED, dataclasses.asdict(ASSUMED)):
        for name in ("ssa", "ssa+stop"):
            assert settings(Shield(arm(), name, stop=stop))[2:4] == (True, ASSUMED)


@pytest.mark.parametrize(
    ("name", "keywords", "said"),
    [
        ("cbf", {"k4": 1.0}, "unknown parameter 'k4' of cbf; valid: d_min, k1, k2, k3, rows$"),
        ("cbf+stop", {"viability": True}, "unknown parameter 'viability'"),
        ("none", {"k1": 1.0}, "unknown parameter 'k1' of none; valid: none$"),
        ("cbf", {"k1": -1.0}, "k1 has to be a positive number"),
        ("cbf", {"stop": 1}, "stop has to be True, False, FailsafeParams or a mapping"),
        ("cbf", {"stop": {"speed": 1.0}}, "unknown assumption 'speed'"),
        (None, {"stop": True}, "stop: only for a filter by name"),
        (None, {"k1": 1.0}, "k1: only for a filter by name"),
    ],
)
def test_other_keywords_are_refused(name, keywords, said):
    env = arm()
    filter = name or make_filter("cbf", env.unwrapped.robot, env.unwrapped.dt)
    with pytest.raises(ParameterError, match=said):
        Shield(env, filter, **keywords)


@pytest.mark.parametrize(
    ("name", "keywords"),
    [
        ("ssa", {}),
        ("jssa_near+stop", {"d_min": np.float32(0.0625)}),
        ("cbf", {"stop": ASSUMED, "k1": 2, "rows": "closest"}),
        ("cbf", {"stop": {"human_speed": 1.2}}),
        ("pfm", {"stop": True}),
        ("shielded", {}),
    ],
)
def test_a_shield_by_name_passes_through_json(name, keywords):
    env = Shield(arm("handover" if name == "shielded" else "home"), name, **keywords)
    twin = EnvSpec.from_json(env.spec.to_json()).make()
    assert settings(twin) == settings(env)
    assert type(twin) is type(env) is Shield


# ---- options -----------------------------------------------------------------------------------------

OPTIONS = {
    "gradient": "printed",
    "projector": "osqp",
    "weight": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
    "static_rows": True,
    "sliding": True,
}


@pytest.mark.parametrize("name", OPTIONS)
def test_an_option_and_the_old_keyword_are_the_same(name):
    value = OPTIONS[name]
    shields = [
        JSSAShield(arm(), options=JSSAOptions(**{name: value})),
        JSSAShield(arm(), options={name: value}),
        JSSAShield(arm(), **{name: value}),
    ]
    shields += [EnvSpec.from_json(shield.spec.to_json()).make() for shield in shields]
    told = settings(shields[0])
    weight = shields[0].filter.projector.weight
    assert told != settings(JSSAShield(arm())) or weight[1, 1] == 2.0
    for shield in shields:
        assert settings(shield) == told
        np.testing.assert_array_equal(shield.filter.projector.weight, weight)
    for options in (JSSAOptions(), JSSAOptions(**{name: value}), {name: value}, {}):
        with pytest.raises(ParameterError, match=f"{name} is one of the options: give it in options or alone"):
            JSSAShield(arm(), options=options, **{name: value})


def test_options_are_all_there_are():
    assert set(OPTIONS) == {field.name for field in dataclasses.fields(JSSAOptions)}
    with pytest.raises(ParameterError, match="unknown option 'rows'; valid: gradient, projector, weight"):
        JSSAShield(arm(), options={"rows": "closest"})
    with pytest.raises(ParameterError, match="options have to be JSSAOptions or a mapping of its fields, got 'osqp'"):
        JSSAShield(arm(), options="osqp")
    one, other = (JSSAOptions(weight=kind([[1.0, 0.0], [0.0, 2.0]])) for kind in (np.array, list))
    assert one == other
    assert hash(one) == hash(other)


# ---- said once ---------------------------------------------------------------------------------------


def test_lambdas_are_written_in_one_place():
    number = re.compile(r"""lambda[12]\b"?\s*(?::\s*float\s*)?[=:]\s*[0-9]""")
    root = Path(jssa_gym.__file__).parent
    found = {path.relative_to(root).as_posix() for path in root.rglob("*.py") if number.search(path.read_text())}
    # the index's own; the handover's; the larger ones of Fig. 7
    assert found == {"safety/index.py", "registration.py", "cli/reproduce.py"}
