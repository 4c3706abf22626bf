"""The search for people and policies that break a shield, ``benchmarks/attack.py``."""

import runpy

import numpy as np
import pytest
from places import ROOT

from jssa_gym.exceptions import ParameterError

BENCH = runpy.run_path(str(ROOT / "benchmarks" / "attack.py"))
Attack, play, search = BENCH["Attack"], BENCH["play"], BENCH["search"]


def attack(seed: int = 0):
    rng = np.random.default_rng(seed)
    return Attack(rng.uniform(-1, 1, (4, 3)), rng.uniform(-1, 1, (4, 6)), rng.uniform(-1, 1, 2))


def test_an_episode_under_an_attack_is_the_same_every_time():
    one, two = (play(attack(), "full", steps=120) for _ in range(2))
    assert (one.score, one.contact_speed, one.contact) == (two.score, two.contact_speed, two.contact)
    assert play(attack(1), "full", steps=120).score != one.score


def test_the_attack_s_person_begins_where_it_says():
    start = attack().root()
    assert 1.0 <= np.hypot(*start) <= 2.2


@pytest.mark.long
def test_without_the_verified_stop_the_search_finds_a_moving_contact_and_ends():
    found = search("no_verification", generations=6, population=20, steps=400, seed=0)
    assert found[0].breaks
    assert found[0].contact_speed > 1e-3
    assert len(found) <= 120


@pytest.mark.long
def test_the_full_shield_keeps_its_promise_and_the_search_climbs():
    seen = []
    found = search(
        "full", generations=3, population=8, steps=250, seed=1, progress=lambda k, best: seen.append(best.score)
    )
    assert len(found) == 24
    assert not any(outcome.breaks for outcome in found)
    assert len(seen) == 3
    assert found[0].contact_speed == max(outcome.contact_speed for outcome in found)


@pytest.mark.parametrize(
    "wrong", [{"who": "everybody"}, {"population": 0}, {"generations": -1}, {"segments": 1.5}, {"shield": "paper"}]
)
def test_bad_arguments_are_refused(wrong):
    with pytest.raises(ParameterError):
        search(**({"shield": "full", "population": 1, "generations": 1} | wrong))
