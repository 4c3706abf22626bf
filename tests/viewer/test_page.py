"""What the page is sent, without a browser."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from pages import eventually

pytest.importorskip("viser", reason="the extra 'viewer' is not installed")

from jssa_gym.exceptions import StorageError
from jssa_gym.shields.registry import UNSHIELDED
from jssa_gym.viewer.choices import Choices, ShieldChoice


def quiet(caplog):
    """Whether nothing went wrong in any thread."""
    return [record.getMessage() for record in caplog.records if record.levelname in ("ERROR", "CRITICAL")] == []


def there(page, node):
    return page.server.viser.scene.get_handle_by_name(node) is not None


def settled(page):
    """Wait until all is done that was asked for."""
    asked = page.runner.submit(lambda session: None)
    eventually(lambda: page.runner.snapshot.answered >= asked)


@pytest.mark.long
def test_the_scene_follows_what_is_played(open_page, caplog):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    eventually(lambda: page.sent > 5)
    assert there(page, "/arm0/people/middle")
    assert not there(page, "/arm1")
    page.runner.submit(
        lambda session: session.choose(Choices(shields=(ShieldChoice("yield"), ShieldChoice(UNSHIELDED))))
    )
    eventually(lambda: there(page, "/arm1/people/middle"))
    both = {f"/arm{k}/people/{part}" for k in (0, 1) for part in ("middle", "ends")}
    eventually(lambda: set(page.speech.nodes) == both)
    page.runner.submit(lambda session: session.choose(Choices(robot="ur5e", human="none")))
    eventually(lambda: page.picture._looked[0] == "ur5e")
    eventually(lambda: not there(page, "/arm1"))
    assert not any(there(page, f"/arm0/people/{part}") for part in ("middle", "ends"))
    eventually(lambda: page.speech.nodes == {})  # nobody to drag
    sent = page.sent
    eventually(lambda: page.sent > sent + 5)
    assert quiet(caplog)


def test_overlays_appear_while_it_is_paused_too(open_page, caplog):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    page.runner.submit(lambda session: setattr(session, "paused", True))
    eventually(lambda: page.runner.snapshot.paused and page.sent)
    page.panel.set_layer("stop", True)
    page.panel.set_layer("reach", True)
    scene = page.server.viser.scene
    eventually(lambda: there(page, "/arm0/stop/middle"))
    eventually(lambda: scene.get_handle_by_name("/arm0/reach/middle").visible)
    page.panel.set_layer("people", False)
    eventually(lambda: not scene.get_handle_by_name("/arm0/people/middle").visible)
    assert quiet(caplog)


@pytest.mark.long
def test_a_film_ends_by_itself_once(open_page, monkeypatch, caplog):
    made = []
    monkeypatch.setattr("jssa_gym.viewer.page.LONGEST", 0.2)

    def film(traces, robot):
        made.append([len(trace.time) for trace in traces])
        return iter(()), 25

    page = open_page(Choices(shields=(ShieldChoice("yield"), ShieldChoice("work"))), film=film)
    page.toggle_film()
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
        page.toggle_film()
        eventually(lambda: page.runner.snapshot.recording)
        page.toggle_film()
        settled(page)
        eventually(lambda: made)
    assert "still writing" in page.news
    assert page.runner.snapshot.recording  # nothing of it is lost
    page.save()
    settled(page)
    slow.set()
    eventually(lambda: page.news == "no film after all")
    page.toggle_film()
    eventually(lambda: page.runner.snapshot.recording is None)
    eventually(lambda: made == [1, 1])
    assert page.shelf.episodes() == ()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("pointer", [(1e4, 0.0, 5e-324), (1.6, 0.0, np.nan), (np.inf, 0.0, 0.5)])
def test_a_pointer_that_is_nowhere_leaves_the_person_somewhere(open_page, pointer):
    page = open_page(Choices(task="home", policy="hold", shields=(ShieldChoice("yield"),)))
    eventually(lambda: page.speech.nodes)
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
            page.picture.follow(event, part, np.zeros(3))
    number = page.runner.snapshot.number
    eventually(lambda: page.runner.snapshot.number > number + 25)
    assert np.isfinite(page.runner.snapshot.people.start).all()
    assert np.isfinite(page.runner.snapshot.people.end).all()


def test_a_level_ray_meets_the_floor_nowhere(open_page, monkeypatch):
    page = open_page(Choices(task="home", policy="hold", shields=(ShieldChoice("yield"),)))
    eventually(lambda: page.speech.nodes)
    places, camera = [], SimpleNamespace(position=(0.0, -3.0, 0.0))
    asked = SimpleNamespace(drag=lambda part, place: places.append(place))
    monkeypatch.setattr(page.runner, "submit", lambda command: command(asked))
    for phase, pointer in (("start", (1.6, 0.0, 1.0)), ("update", (1.0, 0.0, 1e-10))):
        client = SimpleNamespace(camera=camera)
        event = SimpleNamespace(
            phase=phase, client_id=7, start_position=(1.6, 0.0, 1.0), end_position=pointer, client=client
        )
        page.picture.follow(event, "core_body", np.zeros(3))
    assert np.abs(places[-1]).max() < 6.0


def test_what_the_page_says_cannot_be_markup(open_page):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    page.news = "<script>alert(1)</script> [a](javascript:x) **b** `c`"
    eventually(lambda: "script" in page.told.content)
    for mark in ("<", ">", "[", "]", "*b", "`"):
        assert page.told.content.count(mark) == page.told.content.count("\\" + mark) or mark == "*b"
    assert "\\<script\\>" in page.told.content
