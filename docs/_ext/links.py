"""Every build checks its own links: each file and anchor that a page names must be there.

Addresses elsewhere are checked for their form only, so that a build needs no network.
"""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)
_NAMING = {"a": "href", "img": "src", "link": "href", "script": "src", "source": "src"}


class Page(HTMLParser):
    """Anchors of a page, and what it links to."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect."""
        for name, value in attrs:
            if value and (name == "id" or (tag == "a" and name == "name")):
                self.anchors.add(value)
            if value and name == _NAMING.get(tag):
                self.links.add(value)


def broken_links(folder: Path) -> list[str]:
    """Return a line for each link in a folder's pages that leads nowhere."""
    pages = {path: Page(path) for path in sorted(folder.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        for link in sorted(page.links):
            if why := _broken(link, path, pages):
                found.append(f"{path.relative_to(folder)}: {link}: {why}")
    return found


def _broken(link: str, path: Path, pages: dict[Path, Page]) -> str:
    address = urlsplit(link)
    if address.scheme in {"data", "mailto"}:
        return ""
    if address.scheme or address.netloc:
        well_formed = address.scheme in {"http", "https"} and "." in address.netloc
        return "" if well_formed and " " not in link else "not an address"
    target = (path.parent / unquote(address.path)).resolve() if address.path else path
    if not target.is_file():
        return "no such file"
    anchor = unquote(address.fragment)
    if anchor and target in pages and anchor not in pages[target].anchors:
        return "no such anchor"
    return ""


def check(app: Sphinx, failure: Exception | None) -> None:
    """Warn of each broken link."""
    if failure is None and app.builder.format == "html":
        for line in broken_links(Path(app.outdir).resolve()):
            logger.warning("broken link: %s", line)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("build-finished", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
