"""A page in this process, and a browser to look at it: Debian's Chromium, driven by playwright."""

import math
import re
import shutil
import time
from contextlib import ExitStack

import numpy as np
import pytest

CHROMIUM = shutil.which("chromium") or "/usr/bin/chromium"
ARGUMENTS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)
SIZE = {"width": 700, "height": 440}
"""Software draws it: the smaller, the faster."""

PATIENCE = 60.0
"""Of what a busy machine may take [s]."""


def eventually(check, patience=PATIENCE, what="it"):
    """What a check returns as soon as it is true."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        if value := check():
            return value
        time.sleep(0.05)
    raise AssertionError(f"{what} did not happen in {patience} s")


def no_film(traces, robot):
    return iter(()), 25


@pytest.fixture
def open_page(tmp_path):
    """Makes a live page of some choices; closed at the end."""
    pytest.importorskip("viser", reason="the extra 'viewer' is not installed")
    from jssa_gym.viewer.gate import Door
    from jssa_gym.viewer.page import Page
    from jssa_gym.viewer.session import Session
    from jssa_gym.viewer.shelf import Shelf

    with ExitStack() as closing:

        def make(choices, film=no_film, door=None):
            page = Page(Session(choices), door or Door(), 0, Shelf(tmp_path / "kept", film))
            closing.callback(page.close)
            page.start()
            return page

        yield make


@pytest.fixture(scope="session")
def browser():
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if shutil.which(CHROMIUM) is None:
        pytest.skip(f"there is no {CHROMIUM}")
    with api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        yield opened
        opened.close()


class Tab:
    """A page as a visitor sees it."""

    def __init__(self, browser, page):
        self.page = page
        self.tab = browser.new_page(viewport=SIZE, accept_downloads=True)
        begin = time.perf_counter()
        self.tab.goto(page.server.address)
        self.tab.wait_for_selector("text=distance", timeout=1e3 * PATIENCE)
        self.opened = time.perf_counter() - begin

    @property
    def text(self):
        return self.tab.inner_text("body")

    def distances(self):
        """What the page says of each arm [m]."""
        return [float(one) for one in re.findall(r"distance\s+([+-]\d+\.\d+) m", self.text)]

    def pixel(self, point):
        """Where a point (3,) [m] of the scene is in the window, by the camera that the page told."""
        camera = next(reversed(self.page.server.viser.get_clients().values())).camera
        w, x, y, z = camera.wxyz
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        right, down, ahead = turn.T @ (np.array(point) - camera.position)
        box = self.tab.locator("canvas").first.bounding_box()
        focal = box["height"] / 2.0 / math.tan(camera.fov / 2.0)
        assert ahead > 0.0
        return box["x"] + box["width"] / 2.0 + focal * right / ahead, box["y"] + box["height"] / 2.0 + focal * down / ahead

    def drag(self, start, end, steps=12):
        """Press at a point of the scene [m], go to another one, and keep the button pressed."""
        (x, y), (u, v) = self.pixel(start), self.pixel(end)
        mouse = self.tab.mouse
        mouse.move(x, y)
        time.sleep(0.3)
        mouse.down()
        for k in range(1, steps + 1):
            mouse.move(x + (u - x) * k / steps, y + (v - y) * k / steps)
            time.sleep(0.08)


@pytest.fixture
def visit(browser):
    """Opens a page in a tab; closed at the end."""
    tabs = []

    def make(page):
        tabs.append(Tab(browser, page))
        return tabs[-1]

    yield make
    for one in tabs:
        one.tab.close()
