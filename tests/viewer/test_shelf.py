"""Films and episodes in a folder."""

import threading
import time

import numpy as np

from jssa_gym.robots import DEFAULT, make_robot
from jssa_gym.viewer.shelf import Shelf


def test_films_that_are_written_at_once_have_names_of_their_own(tmp_path, monkeypatch):
    def slowly(path, frames, rate):
        time.sleep(0.05)
        path.write_bytes(bytes(sum(1 for _ in frames)))

    monkeypatch.setattr("jssa_gym.plots.write_film", slowly)
    shelf = Shelf(tmp_path / "kept", lambda traces, robot: (iter([np.zeros((2, 2, 3), np.uint8)]), 25))
    robot, written = make_robot(DEFAULT), []
    threads = [threading.Thread(target=lambda: written.extend(shelf.keep_film((), robot))) for _ in range(4)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert sorted(path.name for path in written) == [f"film-00{k}.mp4" for k in (1, 2, 3, 4)]
