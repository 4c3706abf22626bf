"""The page in a real browser, as a visitor sees and uses it."""

import numpy as np
import pytest
from pages import eventually

from jssa_gym.cli.view import pictures
from jssa_gym.shields.registry import UNSHIELDED
from jssa_gym.viewer.choices import Choices, ShieldChoice

pytestmark = [pytest.mark.browser, pytest.mark.long]

CHEST = np.array([0.0, 0.0, 1.1])
"""From a person's root to where it is grabbed [m]."""


def root(page):
    people = page.runner.snapshot.people
    return people.start[people.names.index("core_body")] * [1.0, 1.0, 0.0]


@pytest.fixture(scope="module")
def quick():
    """Compile what a page needs before anybody looks at a clock."""
    from jssa_gym.viewer.session import Session

    session = Session(Choices(shields=(ShieldChoice("yield"), ShieldChoice(UNSHIELDED))))
    session.overlays = (True, True)
    session.step()
    session.snapshot()


def test_the_page_opens_and_says_what_is(open_page, visit, quick, record_property):
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    tab = visit(page)
    record_property("seconds_to_open", round(tab.opened, 2))
    print(f"the page showed the distance {tab.opened:.2f} s after it was asked for")
    text = tab.text
    for said in ("yield", "promise holds", "What is played", "Shields", "Curves", "nobody faster than 1.6 m/s"):
        assert said in text
    assert "you are watching" not in text.casefold()
    assert tab.failures == []
    before = page.runner.snapshot.number
    eventually(lambda: page.runner.snapshot.number > before + 25)


def test_a_person_who_is_dragged_into_the_arm_finds_it_aside_or_at_rest(open_page, visit, quick):
    page = open_page(Choices(task="home", policy="hold", shields=(ShieldChoice("yield"),)))
    tab = visit(page)
    start = root(page)
    eventually(lambda: page.speech.nodes)
    home = page.runner.snapshot.arms[0].position
    tab.drag(start + CHEST, start + CHEST - [1.05, 0.0, 0.0])
    eventually(lambda: root(page)[0] < start[0] - 0.8, what="the person to follow the mouse")
    (distance,) = tab.distances()
    seen = page.runner.snapshot.arms[0]
    assert distance > 0.0 or "arm at rest" in tab.text
    assert seen.moving_contacts == 0
    assert "while it moved" not in tab.text
    assert np.abs(seen.position - home).max() > 0.02  # it has given way
    assert page.server.refused == 0
    assert seen.promised
    tab.tab.mouse.up()
    place = root(page)
    eventually(lambda: np.allclose(root(page), place, atol=0.3))


def test_a_hand_is_dragged_by_itself(open_page, visit, quick):
    page = open_page(Choices(task="home", policy="hold", shields=(ShieldChoice("yield"),)))
    tab = visit(page)
    eventually(lambda: page.speech.nodes)
    people = page.runner.snapshot.people
    hand = people.names.index("left_arm")  # on the side of the camera
    middle = 0.4 * people.start[hand] + 0.6 * people.end[hand]
    tab.drag(middle, middle + np.array([-0.15, 0.0, 0.25]))
    eventually(lambda: page.runner.snapshot.people.end[hand, 2] > people.end[hand, 2] + 0.1, what="the hand to come")
    np.testing.assert_allclose(root(page), people.start[people.names.index("core_body")] * [1.0, 1.0, 0.0], atol=1e-9)
    tab.tab.mouse.up()


def test_switches_change_what_they_say_and_two_shields_differ(open_page, visit, quick):
    page = open_page(Choices(policy="random", task="home", shields=(ShieldChoice("yield"),)))
    tab = visit(page)
    tab.pick("shield", "jssa+stop")
    eventually(lambda: page.runner.snapshot.choices.shields[0].name == "jssa+stop")
    eventually(lambda: "jssa+stop" in tab.text)
    tab.pick("person", "walk_by")
    eventually(lambda: page.runner.snapshot.choices.human == "walk_by")
    tab.pick("person", "dragged")
    eventually(lambda: page.runner.snapshot.choices.human == "dragged")
    tab.tick("pause")
    eventually(lambda: page.runner.snapshot.paused)
    eventually(lambda: "paused" in tab.text)
    number = page.runner.snapshot.number
    tab.press("one step")
    eventually(lambda: page.runner.snapshot.number == number + 1)
    tab.tick("pause")
    tab.pick("second shield", UNSHIELDED)
    tab.tick("two side by side")
    eventually(lambda: len(page.runner.snapshot.arms) == 2)
    eventually(lambda: len(tab.distances()) == 2)
    eventually(lambda: "no verified stop" in tab.text)
    # once it stands there: not clamped, it would be faster than assumed, and that is said instead
    page.runner.submit(lambda session: session.drag("core_body", (0.75, 0.0)))
    eventually(lambda: abs(root(page)[0] - 0.75) < 1e-3)
    one, other = page.runner.snapshot.arms
    assert not np.allclose(one.position, other.position, atol=0.05)
    assert one.moving_contacts == 0
    eventually(lambda: len(set(tab.distances())) == 2, what="two distances")
    tab.tick("speed clamped")
    eventually(lambda: "promise off: the person may be faster than assumed" in tab.text)
    tab.set("λ₁ [m·s]", "1.5")
    eventually(lambda: page.runner.snapshot.arms[0].numbers["lambda1"] == 1.5)


def test_films_and_episodes_are_recorded_handed_over_and_scrubbed(open_page, visit, quick, tmp_path):
    page = open_page(Choices(task="home", policy="hold", shields=(ShieldChoice("yield"),)), film=pictures)
    tab = visit(page)
    tab.press("record a film")
    eventually(lambda: (page.runner.snapshot.recording or 0.0) > 0.4)
    eventually(lambda: "recording" in tab.text)
    with tab.tab.expect_download(timeout=240e3) as download:
        tab.press("end the film")
    download.value.save_as(tmp_path / "film.mp4")
    assert download.value.suggested_filename == "film-001.mp4"
    assert frames_of(tmp_path / "film.mp4") >= 10
    with tab.tab.expect_download(timeout=240e3) as download:
        tab.press("save the episode")
    assert download.value.suggested_filename == "episode-yield-001.npz"
    eventually(lambda: "episode-yield-001.npz" in page.episode.options)
    tab.pick("episode", "episode-yield-001.npz")
    eventually(lambda: "saved episode" in tab.text)
    assert page.playback.length > 0.4
    tab.set("time [s]", "0.2")
    eventually(lambda: "0.2 s (saved episode)" in tab.text)
    tab.pick("episode", "live")
    eventually(lambda: page.playback is None)
    number = page.runner.snapshot.number
    eventually(lambda: page.runner.snapshot.number > number)


def test_two_tabs_show_the_same_and_the_second_watches(open_page, visit, quick, monkeypatch):
    monkeypatch.setattr("jssa_gym.viewer.gate.RELIEVED", 1e9)  # a busy machine may take longer than a driver
    page = open_page(Choices(shields=(ShieldChoice("yield"),)))
    driver, watcher = visit(page), visit(page)
    watcher.tick("pause")
    eventually(lambda: "You are watching" in watcher.text)
    assert not page.runner.snapshot.paused
    eventually(lambda: not watcher.ticked("pause"), what="the watcher's switch back")
    driver.tick("pause")
    eventually(lambda: page.runner.snapshot.paused)
    eventually(lambda: watcher.ticked("pause"))
    eventually(lambda: driver.distances() == watcher.distances())
    driver.tab.close()
    eventually(lambda: page.server.wheel.visitors == [1])
    watcher.tick("pause")
    eventually(lambda: not page.runner.snapshot.paused)


def frames_of(path):
    import av

    with av.open(path) as film:
        return sum(1 for _ in film.decode(video=0))
