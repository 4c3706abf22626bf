"""A live page as a visitor sees it, and waiting for what it does."""

import math
import re
import time

import numpy as np

SIZE = {"width": 700, "height": 440}
"""Software draws it: the smaller, the faster."""

PATIENCE = 60.0
"""Of what a busy machine may take [s]."""

TOLD = "/distance [+-]/.test(document.body.innerText)"
"""That a page shows what is."""


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


class Tab:
    """A page as a visitor sees it."""

    def __init__(self, browser, page):
        self.page = page
        self.tab = browser.new_page(viewport=SIZE, accept_downloads=True)
        self.tab.set_default_timeout(2e3 * PATIENCE)
        self.failures = []
        self.tab.on("pageerror", lambda error: self.failures.append(str(error)))
        begin = time.perf_counter()
        self.tab.goto(page.server.address)
        self.tab.wait_for_function(TOLD, timeout=2e3 * PATIENCE)
        self.opened = time.perf_counter() - begin

    @property
    def text(self):
        return self.tab.inner_text("body")

    def distances(self):
        """What the page says of each arm [m]."""
        return [float(one) for one in re.findall(r"distance\s+([+-]\d+\.\d+) m", self.text)]

    @property
    def camera(self):
        return next(reversed(self.page.server.viser.get_clients().values())).camera

    def ready(self):
        """Wait until the picture is laid out, and its camera where it belongs."""

        def there():
            if not self.page.server.viser.get_clients():
                return False
            box, camera = self.tab.locator("canvas").first.bounding_box(), self.camera
            wanted = self.page.server.viser.initial_camera.position
            alike = abs(camera.image_width / camera.image_height - box["width"] / box["height"]) < 0.02
            return alike and np.allclose(camera.position, wanted, atol=0.02)

        eventually(there, what="the camera's place")

    def pixel(self, point):
        """Where a point (3,) [m] of the scene is in the window, by the camera that the page told."""
        camera = self.camera
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
        across, along = focal * right / ahead, focal * down / ahead
        return box["x"] + box["width"] / 2.0 + across, box["y"] + box["height"] / 2.0 + along

    def drag(self, start, end, steps=12):
        """Press at a point of the scene [m], go to another one, and keep the button pressed."""
        self.ready()
        (x, y), (u, v) = self.pixel(start), self.pixel(end)
        mouse = self.tab.mouse
        mouse.move(x, y)
        time.sleep(0.3)
        mouse.down()
        for k in range(1, steps + 1):
            mouse.move(x + (u - x) * k / steps, y + (v - y) * k / steps)
            time.sleep(0.08)

    # ---- switches: viser puts a label before each --------------------------------------------------------

    def _field(self, label):
        """What stands beside a label."""
        text = self.tab.get_by_text(label, exact=True).first
        return seen(text.locator("xpath=ancestor::*[.//input or .//button][1]"))

    def pick(self, label, value):
        """Choose in a dropdown."""
        self._field(label).locator("input").first.click(force=True)
        seen(self.tab.get_by_role("option", name=value, exact=True)).click(force=True)

    def tick(self, label):
        """Turn a checkbox."""
        self._field(label).locator("input[type=checkbox]").first.click(force=True)

    def ticked(self, label):
        return self._field(label).locator("input[type=checkbox]").first.is_checked()

    def press(self, label):
        """Press a button."""
        seen(self.tab.get_by_role("button", name=label, exact=True)).click(force=True)

    def set(self, label, value):
        """Write a slider's number."""
        number = self._field(label).locator("input:not([type=hidden])").last
        number.fill(value, force=True)
        number.press("Enter")


def seen(found):
    """An element, scrolled to; playwright's own way waits until nothing moves, which a live page does."""
    found.evaluate("element => element.scrollIntoView({block: 'center'})")
    return found
