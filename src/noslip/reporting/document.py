"""A report as one file: HTML that refers to nothing outside it, or PDF."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path

from matplotlib.figure import Figure

from noslip._extras import need
from noslip._files import write_beside
from noslip.errors import InputError, MissingDependencyError
from noslip.figures.style import rendered
from noslip.reporting.values import Report, Value

SUFFIXES = (".html", ".pdf")
"""Of what a report can be."""
LARGEST_SVG = 600_000
"""Bytes of a figure as SVG from which it becomes a PNG: a browser is slow with more."""


def write_report(report: Report, paths: Iterable[str | Path]) -> list[Path]:
    """Write a report to files, each as what its suffix says, .html or .pdf.

    Raises
    ------
    InputError
        If a suffix is another one, or a file cannot be written.
    MissingDependencyError
        If jinja2 or, for PDF, weasyprint is not installed.
    """
    targets = [checked_path(path) for path in paths]
    html = to_html(report)
    contents = [html.encode() if t.suffix == ".html" else _pdf(html) for t in targets]
    return [write_beside(t, content) for t, content in zip(targets, contents, strict=True)]


def checked_path(path: str | Path) -> Path:
    """Return a path that a report can be written to."""
    target = Path(path)
    if target.suffix not in SUFFIXES:
        raise InputError(f"{target}: a report ends in {' or '.join(SUFFIXES)}")
    return target


def to_html(report: Report) -> str:
    """Return a report as one HTML page, its figures inside: SVG, or PNG where that is large."""
    jinja2 = need("a report", "jinja2", "report")
    Markup = need("a report", "markupsafe", "report").Markup
    page = files(__package__).joinpath("report.html.jinja").read_text("utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.tests["value"] = lambda cell: isinstance(cell, Value)
    environment.filters["data_label"] = lambda text: (
        Markup(' data-label="{}"').format(text) if text else ""
    )
    environment.filters["numeric_columns"] = lambda table: [
        any(isinstance(cell, Value) for cell in column) for column in zip(*table.rows, strict=True)
    ]
    pictures = [
        {
            "caption": picture.caption,
            "alt": picture.figure.get_suptitle().replace("\n", " ").replace(r"\$", "$"),
            "uri": _data_uri(picture.figure),
            "width": round(96 * picture.figure.get_figwidth()),
            "height": round(96 * picture.figure.get_figheight()),
        }
        for picture in report.pictures
    ]
    return str(environment.from_string(page).render(report=report, pictures=pictures))


def to_pdf(report: Report) -> bytes:
    """Return a report as PDF: A4 pages with numbers."""
    return _pdf(to_html(report))


def _pdf(html: str) -> bytes:
    try:
        weasyprint = need("a report as PDF", "weasyprint", "report")
    except OSError as error:
        raise MissingDependencyError(
            f"weasyprint does not find Pango ({error}); install it (Debian: libpango-1.0-0 "
            "libpangoft2-1.0-0), or write .html and print that"
        ) from error
    return bytes(weasyprint.HTML(string=html).write_pdf())


def _data_uri(figure: Figure) -> str:
    # An image of its own, for the identifiers and styles in SVG of several figures would mix.
    kind, content = "svg+xml", rendered(figure, ".svg")
    if len(content) > LARGEST_SVG:
        kind, content = "png", rendered(figure, ".png")
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
