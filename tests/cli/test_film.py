"""Films: what is said in them, which moments they show, and what a picture is made of."""

import dataclasses

import numpy as np
import pytest

from jssa_gym import JSSAShield, plots
from jssa_gym.cli import film as films
from jssa_gym.cli.demo import Demo, paper_scene
from jssa_gym.cli.film import caption, film, pictures, rows
from jssa_gym.cli.replay import Replay
from jssa_gym.envs import ArmEnv
from jssa_gym.evaluation import rollout, save_trace
from jssa_gym.palette import CONTACT, rgb
from jssa_gym.policies import HoldPolicy
from jssa_gym.types import Status


def play(wrap, name, steps=420):
    env = wrap(ArmEnv("home", human=paper_scene(0.8), terminate_on=()))
    return rollout(env, HoldPolicy(env), seed=0, steps=steps, name=name)


@pytest.fixture(scope="module")
def alone():
    return play(lambda env: env, "no shield")


@pytest.fixture(scope="module")
def shielded():
    return play(JSSAShield, "ours")


def changed(trace, k, **values):
    arrays = {name: getattr(trace, name).copy() for name in values}
    for name, value in values.items():
        arrays[name] = arrays[name].astype(object) if isinstance(value, str) else arrays[name]
        arrays[name][k] = value
        if isinstance(value, str):
            arrays[name] = arrays[name].astype(str)
    return dataclasses.replace(trace, **arrays)


def test_captions_tell_clock_distance_status_and_reason(alone, shielded):
    said = caption(alone, 10)
    assert (said.name, said.status, said.reason) == ("no shield", "policy alone", "")
    assert said.numbers.split() == ["0.09", "s", "distance", f"{alone.distance[10]:.3f}", "m"]
    for status, words in (
        (Status.NOMINAL, "as asked"),
        (Status.PROJECTED, "corrected"),
        (Status.RELAXED, "least violation"),
        (Status.FAILSAFE, "verified stop"),
        (Status.FAULT, "fault: brakes"),
    ):
        said = caption(changed(shielded, 50, status=int(status), reason="because"), 50)
        assert (said.status, said.reason) == (words, "because")
    assert len({caption(changed(shielded, 50, status=int(one)), 50).colour for one in Status}) == len(Status)


def test_a_contact_is_told_with_its_depth_and_speed(alone):
    k = int(np.flatnonzero(alone.contact)[3])
    said = caption(changed(alone, k, contact_speed=0.734, distance=-0.0123), k)
    assert (said.status, said.colour) == ("contact", CONTACT)
    assert "0.012 m deep, arm at 0.73 m/s" in said.numbers


def test_nobody_and_a_goal_are_told(alone):
    assert "nobody there" in caption(changed(alone, 5, distance=np.inf), 5).numbers
    reached = dataclasses.replace(changed(alone, 5, success=True), holds=False)
    assert caption(reached, 5).reason == "goal reached"


def test_the_beginning_of_a_contact_is_shown_and_held(alone, shielded):
    begin = int(np.flatnonzero(alone.contact)[0])
    shown = rows([alone, shielded])
    assert shown.count(begin) == 1 + films.HOLD // films.EVERY
    assert shown == sorted(shown)
    assert set(range(0, 420, films.EVERY)) <= set(shown)
    assert pictures([alone]) == len(shown)
    assert len(rows([shielded])) == 84
    # one that comes and goes is held once
    flickers = changed(alone, slice(0, 100), contact=np.resize([True, True, False], 100))
    flickers = changed(flickers, slice(100, 420), contact=False)
    assert pictures([flickers]) == 84 + films.HOLD // films.EVERY


def test_a_short_contact_between_two_pictures_is_not_missed(shielded):
    assert 33 in rows([changed(shielded, 33, contact=True)])


@pytest.mark.gl
@pytest.mark.long
def test_columns_have_a_divider_and_a_contact_a_red_frame(alone, shielded, robot):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    begin = int(np.flatnonzero(alone.contact)[0])
    one, other = (dataclasses.replace(trace, **cut(trace, begin - 5, begin + 5)) for trace in (alone, shielded))
    frames = list(film([one, other], robot))
    assert len(frames) == pictures([one, other]) == 2 + films.HOLD // films.EVERY
    first, last = frames[0], frames[-1]
    width, height = films.WIDTH, films.HEIGHT
    assert first.shape == (34 + height + 46 + 14 + 46, 2 * width + films.DIVIDER, 3)
    assert np.all(first[:, width : width + films.DIVIDER] == films.RULE)
    edge = 34 + 2
    assert tuple(last[edge, 100]) == rgb(CONTACT)
    assert tuple(last[edge, width + films.DIVIDER + 100]) != rgb(CONTACT)
    assert tuple(first[edge, 100]) != rgb(CONTACT)
    # held: nothing moves meanwhile
    for frame in frames[2:]:
        np.testing.assert_array_equal(frame, frames[1])
    # inside of the frame there is a mark
    inside = last[34 + 10 : 34 + height - 10, 10 : width - 10].astype(int)
    assert ((inside[..., 0] > 140) & (inside[..., 1] < 110)).sum() > 100


def cut(trace, first, last):
    count = len(trace.time)
    names = [field.name for field in dataclasses.fields(trace)]
    values = {name: getattr(trace, name) for name in names}
    return {
        name: value[first:last]
        for name, value in values.items()
        if isinstance(value, np.ndarray) and value.ndim and len(value) == count
    }


@pytest.mark.gl
@pytest.mark.long
@pytest.mark.parametrize("command", [Demo, Replay])
def test_capsules_are_filmed_on_request(command, monkeypatch, tmp_path):
    pytest.importorskip("av", reason="PyAV is not installed")
    asked = []

    def noted(traces, robot, *, capsules=False, **options):
        asked.append(capsules)
        return film(traces, robot, capsules=capsules, **options)

    monkeypatch.setattr(films, "film", noted)
    if command is Demo:
        Demo(out=tmp_path, seconds=0.1, capsules=True).run()
    else:
        env = ArmEnv("reach", human="none", terminate_on=())
        save_trace(rollout(env, HoldPolicy(env), seed=0, steps=12, name="x"), tmp_path / "x.npz")
        Replay(tmp_path / "x.npz", out=tmp_path, figure=False, capsules=True).run()
    assert asked == [True]


def test_headings_and_footers_show_what_is_said():
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    said = plots.Caption("a name", "corrected", "#E69F00", "1.00 s  distance 0.300 m", "a reason")
    heading, footer = plots.heading(said, 480), plots.footer(said, 480)
    assert heading.shape == (34, 480, 3)
    assert footer.shape == (46, 480, 3)
    assert np.any(np.all(heading == (0xE6, 0x9F, 0x00), axis=2))
    for field, draw in (
        ("name", plots.heading),
        ("status", plots.heading),
        ("numbers", plots.footer),
        ("reason", plots.footer),
    ):
        assert not np.array_equal(draw(said._replace(**{field: "other"}), 480), draw(said, 480))
    # what is too long is cut before the badge
    long = plots.heading(said._replace(name="m" * 200), 480)
    np.testing.assert_array_equal(long[:, 380:], heading[:, 380:])
