"""A page in this process, and a browser to look at it: Debian's Chromium, driven by playwright."""

import shutil
from contextlib import ExitStack

import pytest
from pages import Tab, no_film

CHROMIUM = shutil.which("chromium") or "/usr/bin/chromium"
ARGUMENTS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)


@pytest.fixture
def open_page(tmp_path):
    """Makes a live page of some choices; closed at the end."""
    pytest.importorskip("viser", reason="the extra 'viewer' is not installed")
    from jssa_gym.viewer.gate import Door
    from jssa_gym.viewer.page import Page
    from jssa_gym.viewer.server import listen
    from jssa_gym.viewer.session import Session
    from jssa_gym.viewer.shelf import Shelf

    with ExitStack() as closing:

        def make(choices, film=no_film, door=None):
            page = Page(
                Session(choices), door or Door(), listen((door or Door()).host, 0), Shelf(tmp_path / "kept", film)
            )
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
