"""The film at the top of the README: its person keeps to what people can do, and the file to what a page can load."""

import runpy

import numpy as np
import pytest
from places import DOCS

pytest.importorskip("PIL", reason="Pillow is not installed")

hero = runpy.run_path(str(DOCS / "images" / "hero.py"))


def test_the_drag_is_smooth_and_keeps_clear_of_the_base():
    path, dt = hero["path"](), hero["DT"]
    velocity = np.diff(path, axis=0) / dt
    assert np.linalg.norm(velocity, axis=1).max() <= hero["SPEED"] + 1e-9
    assert np.linalg.norm(np.diff(velocity, axis=0) / dt, axis=1).max() <= hero["ACCELERATION"] + 1e-6
    assert np.hypot(*path.T).min() > 0.6
    np.testing.assert_array_equal(path, hero["path"]())


def test_the_person_follows_the_drag_and_is_never_faster_than_assumed():
    person = hero["person"]()
    np.testing.assert_allclose(person.recording.root, hero["path"]())
    assert person.speed_bound < 1.6
    first = person.reset(np.random.default_rng(0))
    np.testing.assert_allclose(first.start, person.recording.start[0])


@pytest.mark.long
def test_the_film_is_small_and_twenty_seconds_long():
    from PIL import Image, ImageSequence

    file = DOCS / "images" / "hero.webp"
    assert file.stat().st_size <= 2 * 2**20
    with Image.open(file) as film:
        assert film.size[0] == 880
        seconds = 0.0
        for frame in ImageSequence.Iterator(film):
            frame.load()  # only then it says for how long it is shown
            seconds += frame.info["duration"] / 1000.0
    assert 18.0 < seconds < 22.0
