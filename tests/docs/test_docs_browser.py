"""The built pages in a browser with the network off: formulas, search, the gallery's pictures."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from browser import ARGUMENTS, CHROMIUM, NEEDS_CHROMIUM
from waiting import PATIENCE, until

pytest.importorskip("myst_nb", reason="needs the extra docs")
pytest.importorskip("sphinx_gallery", reason="needs the extra docs")
pytest.importorskip("playwright", reason="browser tests need playwright (extra: dev)")

from playwright.sync_api import sync_playwright
from test_site import ROOT, build

pytestmark = NEEDS_CHROMIUM

READABLE = 600
"""Least width of a picture in the gallery (px): its text is then as large as the page's notes."""
TALLEST = 40_000
"""Of a page of the reference (px): the longest folder's, with room to grow."""


class Quiet(SimpleHTTPRequestHandler):
    """Serves a folder without telling of it."""

    def log_message(self, *_: object) -> None:
        pass


class Site:
    """The pages in one tab, to which nothing but them is let through."""

    def __init__(self, tab, address: str, folder: Path) -> None:
        self.tab, self.address, self.folder = tab, address, folder
        self.errors: list[str] = []
        self.outside: list[str] = []
        tab.set_default_timeout(1e3 * PATIENCE)
        tab.on("pageerror", lambda error: self.errors.append(str(error)))
        tab.route("**/*", self._let)

    def _let(self, route) -> None:
        if route.request.url.startswith((self.address, "data:", "blob:")):
            route.continue_()
        else:
            self.outside.append(route.request.url)
            route.abort()

    def open(self, page: str) -> None:
        self.tab.goto(f"{self.address}/{page}")


@pytest.fixture(scope="module")
def site(once: Callable[[str, Callable[[Path], None]], Path]) -> Iterator[Site]:
    folder = once("site", build) / "built"
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=folder))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        site = Site(browser.new_page(), f"http://127.0.0.1:{server.server_port}", folder)
        yield site
        browser.close()
    server.shutdown()
    server.server_close()


@pytest.fixture(autouse=True)
def nothing_else_is_asked_for(site: Site) -> Iterator[None]:
    yield
    assert (site.outside, site.errors) == ([], [])


@pytest.mark.parametrize(
    "page", ["concepts/primitives.html", "concepts/projections.html", "paper.html"]
)
def test_formulas_are_drawn(site, page):
    site.open(page)
    formulas = site.tab.locator(".math").count()
    assert formulas > 10
    drawn = site.tab.locator("mjx-container svg, math")
    until(lambda: drawn.count() >= formulas, "every formula to be drawn")
    assert site.tab.locator(".math mjx-container svg").count() == formulas
    assert site.tab.locator("mjx-merror, merror, [data-mml-node=merror]").count() == 0
    sizes = drawn.evaluate_all(
        "found => found.map(f => f.getBoundingClientRect()).map(r => [r.width, r.height])"
    )
    assert all(width > 2 and height > 2 for width, height in sizes)


def test_the_search_finds_pages_and_shows_where(site):
    site.open("search.html?q=keep-out")
    found = site.tab.locator("ul.search li a[href]")
    site.tab.get_by_text("Search finished").wait_for()
    leads = [found.nth(k).get_attribute("href").partition("#")[0] for k in range(found.count())]
    assert any("keep_out" in page for page in leads)
    for page in leads:
        assert (site.folder / page.partition("?")[0]).is_file(), page
    site.open("search.html?q=needle")
    site.tab.wait_for_selector("#search-results li a")
    titles = site.tab.locator("#search-results li a").all_inner_texts()
    assert any("needle" in title.lower() for title in titles)


def test_the_pictures_of_the_gallery_are_there_and_said_in_words(site):
    site.open("gallery.html")
    chapters = site.tab.locator("article h2").all_inner_texts()
    users = ["Cutting", "Needles", "Wheels", "Arms", "Any policy"]
    assert [chapter.rstrip("#¶") for chapter in chapters][: len(users)] == users
    pictures = site.tab.locator("article img")
    assert pictures.count() == len(list((ROOT / "examples").glob("*.py"))) > 10
    for k in range(pictures.count()):
        # Those further down are loaded when they come into view.
        pictures.nth(k).scroll_into_view_if_needed()
        until(lambda k=k: pictures.nth(k).evaluate("i => i.complete && i.naturalWidth > 0"), "it")
        shown = pictures.nth(k).bounding_box()["width"]
        # A thumbnail in which nothing can be read is none.
        assert pictures.nth(k).evaluate("i => i.naturalWidth") >= shown >= READABLE
        assert len(pictures.nth(k).get_attribute("alt").split()) > 4
    site.tab.set_viewport_size({"width": 390, "height": 844})
    assert site.tab.evaluate("document.documentElement.scrollWidth") <= 390
    site.tab.set_viewport_size({"width": 1280, "height": 720})


def test_the_reference_is_a_page_a_folder(site):
    assert len(list((site.folder / "reference").glob("*.html"))) > 15
    site.open("reference/constraints.html")
    assert site.tab.evaluate("document.documentElement.scrollHeight") < TALLEST
