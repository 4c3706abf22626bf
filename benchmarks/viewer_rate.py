"""How often `jssa-gym view` sends its scene, and how punctual its control steps are, with one shield and with two.

A visitor who only reads is there, and with --browser a headless Chromium too, which tells its own rate. It measures the
clock: run it on an idle machine. What a step and a scene cost is told in processor time, which others do not change.

    python benchmarks/viewer_rate.py [--seconds 20] [--browser]
"""

import argparse
import contextlib
import itertools
import os
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

from jssa_gym.evaluation.identity import made_with
from jssa_gym.viewer.choices import Choices, ShieldChoice
from jssa_gym.viewer.gate import Door
from jssa_gym.viewer.page import Page
from jssa_gym.viewer.scene import SHOWN
from jssa_gym.viewer.server import listen
from jssa_gym.viewer.session import Session
from jssa_gym.viewer.shelf import Shelf

CHROMIUM = "/usr/bin/chromium"
FLAGS = ("--no-sandbox", "--disable-quic", "--no-first-run", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
COUNT = """() => new Promise(done => {
    let frames = 0; const begin = performance.now();
    const count = () => { frames++; const past = performance.now() - begin;
        past < 5000 ? requestAnimationFrame(count) : done(1000 * frames / past); };
    requestAnimationFrame(count); })"""
"""What a page's own rate is, over five seconds."""


@contextlib.contextmanager
def reader(page: Page) -> Iterator[Any]:
    """Somebody who takes in all that is sent, and draws nothing; yields the count of messages and bytes."""
    import viser

    told = {"messages": 0, "bytes": 0}
    over = threading.Event()
    with connect(
        f"ws://127.0.0.1:{page.server.port}/",
        origin=f"http://127.0.0.1:{page.server.port}",
        subprotocols=[f"viser-v{viser.__version__}"],
        max_size=None,
    ) as connection:

        def read() -> None:
            with contextlib.suppress(Exception):
                while not over.is_set():
                    told["bytes"] += len(connection.recv())
                    told["messages"] += 1

        threading.Thread(target=read, daemon=True).start()
        yield told
        over.set()


@contextlib.contextmanager
def browser(page: Page) -> Iterator[Any]:
    """Chromium with the page open; yields its tab, and how long it took."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        tab = opened.new_page(viewport={"width": 700, "height": 440})
        begin = time.perf_counter()
        tab.goto(page.server.address)
        tab.wait_for_function("/distance [+-]/.test(document.body.innerText)", timeout=120e3)
        yield tab, time.perf_counter() - begin
        opened.close()


def cost(session: Session, page: Page) -> tuple[float, float, float]:
    """Processor time of a control step of all arms, of a snapshot and of sending a scene [s]."""

    def send() -> None:
        page.picture.show(session.snapshot()._replace(number=-next(_numbers)), set(SHOWN))

    parts = []
    for work, count in (
        (session.step, 500),
        (session.snapshot, 200),
        (send, 200),
    ):
        work()
        begin = time.thread_time()
        for _ in range(count):
            work()
        parts.append((time.thread_time() - begin) / count)
    return parts[0], parts[1], parts[2] - parts[1]


_numbers = itertools.count(1)


def measure(shields: tuple[str, ...], seconds: float, with_browser: bool) -> None:
    """Say how a page does."""
    choices = Choices(shields=tuple(ShieldChoice(name) for name in shields), policy="wander", task="home")
    session = Session(choices)
    for _ in range(50):
        session.step()  # compiles
    with tempfile.TemporaryDirectory() as folder:
        page = Page(session, Door(), listen("127.0.0.1", 0), Shelf(Path(folder), lambda traces, robot: ((), 25)))
        with contextlib.ExitStack() as visiting:
            visiting.callback(page.close)
            traffic = visiting.enter_context(reader(page))
            step, snapshot, scene = cost(session, page)
            page.start()
            opened, own = float("nan"), float("nan")
            if with_browser:
                tab, opened = visiting.enter_context(browser(page))
                time.sleep(20.0)  # software compiles its shaders first
                own = tab.evaluate(COUNT)
            time.sleep(2.0)
            before = page.sent, page.runner.snapshot.number, traffic["bytes"], time.process_time()
            begin = time.perf_counter()
            time.sleep(seconds)
            past = time.perf_counter() - begin
            after = page.sent, page.runner.snapshot.number, traffic["bytes"], time.process_time()
            scenes, steps, sent, used = ((b - a) / past for a, b in zip(before, after, strict=True))
            late = page.runner.punctuality()
    told = {
        "scenes sent a second": f"{scenes:.1f}",
        "frames of the browser a second": f"{own:.1f}",
        "page open after": f"{opened:.2f} s",
        "control steps a second": f"{steps:.1f}",
        "steps late, median": f"{1e3 * late.late_median:.2f} ms",
        "steps late, p99": f"{1e3 * late.late_p99:.2f} ms",
        "steps late, most": f"{1e3 * late.late_most:.2f} ms",
        "processor time of a step": f"{1e3 * step:.2f} ms",
        "processor time of a snapshot": f"{1e3 * snapshot:.2f} ms",
        "processor time of a scene": f"{1e3 * scene:.2f} ms",
        "processor time of all": f"{used:.0%} of a core",
        "sent to a visitor": f"{sent / 1e3:.0f} kB/s",
        "load of the machine": f"{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores",
    }
    print(" and ".join(shields))
    for what, value in told.items():
        print(f"    {what:32} {value}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the live page.")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--browser", action="store_true")
    given = parser.parse_args()
    print(f"{made_with()}\n", flush=True)
    for shields in (("shielded",), ("shielded", "yield")):
        measure(shields, given.seconds, given.browser)


if __name__ == "__main__":
    main()
