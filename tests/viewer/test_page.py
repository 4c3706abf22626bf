"""What the page is sent, without a browser."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from pages import eventually

pytest.importorskip("viser", reason="the extra 'viewer' is not installed")

from jssa_gym.exceptions import StorageError
from jssa_gym.viewer.choices import BARE, Choices, ShieldChoice


def quiet(caplog):
    """Whether nothing went wrong in any thread."""
    return [record.getMessage() for record in caplog.records if record.levelname in ("ERROR", "CRITICAL")] == []


def nodes(page):
    return set(page.server.viser.scene._handle_from_node_name)


@pytest.mark.long
def test_the_scene_follows_what_is_played(open_page, caplog):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    eventually(lambda: page.sent > 5)
    assert "/arm0/people/middle" in nodes(page)
    assert "/arm1" not in nodes(page)
    page.runner.submit(lambda session: session.choose(Choices(shields=(ShieldChoice("yield"), ShieldChoice(BARE)))))
    eventually(lambda: "/arm1/people/middle" in nodes(page))
    both = {f"/arm{k}/people/{part}" for k in (0, 1) for part in ("middle", "ends")}
    eventually(lambda: set(page._speech.nodes) == both)
    page.runner.submit(lambda session: session.choose(Choices(robot="ur5e", human="none")))
    eventually(lambda: page.picture._looked[0] == "ur5e")
    eventually(lambda: "/arm1" not in nodes(page))
    assert not any(name.startswith("/arm0/people") for name in nodes(page))
    eventually(lambda: page._speech.nodes == {})  # nobody to drag
    sent = page.sent
    eventually(lambda: page.sent > sent + 5)
    assert quiet(caplog)


def test_overlays_appear_while_it_is_paused_too(open_page, caplog):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    page.runner.submit(lambda session: setattr(session, "paused", True))
    eventually(lambda: page.runner.snapshot.paused and page.sent)
    page.panel._layer("stop", True)
    page.panel._layer("reach", True)
    scene = page.server.viser.scene
    eventually(lambda: "/arm0/stop/middle" in nodes(page))
    eventually(lambda: scene.get_handle_by_name("/arm0/reach/middle").visible)
    page.panel._layer("people", False)
    eventually(lambda: not scene.get_handle_by_name("/arm0/people/middle").visible)
    assert quiet(caplog)


def test_a_film_ends_by_itself_once(open_page, monkeypatch, caplog):
    made = []
    monkeypatch.setattr("jssa_gym.viewer.page.LONGEST", 0.2)

    def film(traces, robot):
        made.append([len(trace.time) for trace in traces])
        return iter(()), 25

    page = open_page(Choices(shields=(ShieldChoice("yield"), ShieldChoice("work"))), film=film)
    page._toggle_film()
    eventually(lambda: made)
    eventually(lambda: page.runner.snapshot.recording is None)
    sent = page.sent
    eventually(lambda: page.sent > sent + 10)
    assert len(made) == 1
    one, other = made[0]
    assert one == other >= 24


def test_a_film_that_ends_while_something_is_written_goes_on(open_page):
    slow, made = threading.Event(), []

    def film(traces, robot):
        made.append(len(traces))
        assert slow.wait(60.0)
        raise StorageError("no film after all")

    page = open_page(Choices(shields=(ShieldChoice("yield"),)), film=film)
    for _ in range(2):
        page._toggle_film()
        eventually(lambda: page.runner.snapshot.recording)
        page._toggle_film()
        eventually(lambda: page.runner.snapshot.answered >= page._rolled)
        eventually(lambda: made)
    assert "still writing" in page._news
    assert page.runner.snapshot.recording  # nothing of it is lost
    page._save()
    eventually(lambda: page.runner.snapshot.answered >= page.runner._asked)
    slow.set()
    eventually(lambda: page._news == "no film after all")
    page._toggle_film()
    eventually(lambda: page.runner.snapshot.recording is None)
    eventually(lambda: made == [1, 1])
    assert page._shelf.episodes() == ()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("pointer", [(1e4, 0.0, 5e-324), (1.6, 0.0, np.nan), (np.inf, 0.0, 0.5)])
def test_a_pointer_that_is_nowhere_leaves_the_person_somewhere(open_page, pointer):
    page = open_page(Choices(task="home", policy="hold", shields=(ShieldChoice("yield"),)))
    eventually(lambda: page._speech.nodes)
    camera = SimpleNamespace(position=(0.0, -3.0, 0.0))
    for phase in ("start", "update", "update"):
        event = SimpleNamespace(
            phase=phase,
            client_id=7,
            start_position=(1.6, 0.0, 1.0),
            end_position=pointer,
            client=SimpleNamespace(camera=camera),
        )
        for part in ("core_body", "right_arm"):
            page.picture._follow(event, part, np.zeros(3))
    number = page.runner.snapshot.number
    eventually(lambda: page.runner.snapshot.number > number + 25)
    assert np.isfinite(page.runner.snapshot.people.start).all()
    assert np.isfinite(page.runner.snapshot.people.end).all()


def test_a_level_ray_meets_the_floor_nowhere(open_page, monkeypatch):
    page = open_page(Choices(task="home", policy="hold", shields=(ShieldChoice("yield"),)))
    eventually(lambda: page._speech.nodes)
    places, camera = [], SimpleNamespace(position=(0.0, -3.0, 0.0))
    monkeypatch.setattr(page.picture, "_drag", lambda part, place: places.append(place))
    for phase, pointer in (("start", (1.6, 0.0, 1.0)), ("update", (1.0, 0.0, 1e-10))):
        client = SimpleNamespace(camera=camera)
        event = SimpleNamespace(
            phase=phase, client_id=7, start_position=(1.6, 0.0, 1.0), end_position=pointer, client=client
        )
        page.picture._follow(event, "core_body", np.zeros(3))
    assert np.abs(places[-1]).max() < 6.0


def test_what_the_page_says_cannot_be_markup(open_page):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    page._news = "<script>alert(1)</script> [a](javascript:x) **b** `c`"
    eventually(lambda: "script" in page._told.content)
    for mark in ("<", ">", "[", "]", "*b", "`"):
        assert page._told.content.count(mark) == page._told.content.count("\\" + mark) or mark == "*b"
    assert "\\<script\\>" in page._told.content
