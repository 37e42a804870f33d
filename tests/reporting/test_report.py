"""Reports: nothing from outside, what is told is what is computed, and hostile names stay text."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import inspect
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import casadi
import numpy as np
import pytest
import scipy
from matplotlib.image import imread
from scipy.spatial.transform import Rotation

import noslip as ns
from learned import under
from measures import slip
from noslip.boundary import Boundary
from noslip.cli import adapt, main
from noslip.cli.learn import Learning
from noslip.constraints.catalog import CATALOG, parse_constraint
from noslip.errors import InputError, MissingDependencyError
from noslip.reporting import report, to_html, to_pdf, write_report
from noslip.reporting.commands import commands, declaration

jinja2 = pytest.importorskip("jinja2", reason="the extra report is not installed")

VOID = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """What a page holds: its elements, its tables, and its text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text: dict[str, list[str]] = {}
        self.tables: dict[str, list[list[tuple[str, float | None]]]] = {}
        self.feed(html)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag in VOID:
            return
        self.open.append(tag)
        if tag in ("h1", "h2", "p", "pre", "title", "style"):
            self.text.setdefault(tag, []).append("")
        elif tag == "tr":
            self.tables.setdefault(self.text["h2"][-1], []).append([])
        elif tag in ("td", "th"):
            self.row.append(("", None))
        elif tag == "data":
            self.row[-1] = ("", float(str(dict(attrs)["value"])))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        for tag in self.open:
            if tag in self.text:
                self.text[tag][-1] += data
        if self.open and self.open[-1] in ("td", "th", "data"):
            text, value = self.row[-1]
            self.row[-1] = (text + data, value)

    @property
    def row(self) -> list[tuple[str, float | None]]:
        return list(self.tables.values())[-1][-1]

    def cell(self, table: str, row: str, column: str | int) -> tuple[str, float | None]:
        heads = [text for text, _ in self.tables[table][0]]
        at = heads.index(column) if isinstance(column, str) else column
        (found,) = [cells for cells in self.tables[table] if cells[0][0] == row]
        return found[at]


def cut(aside: float = 0.0) -> ns.PoseTrajectory:
    """10 cm in 2 s, the blade 20 degrees off its path."""
    t = np.linspace(0.0, 2.0, 241)
    path = np.column_stack([0.05 * t, 0.02 * np.sin(np.pi * t) + aside * t * (2 - t), 0 * t])
    yaw = np.arctan(0.4 * np.pi * np.cos(np.pi * t)) + np.radians(20)
    return ns.PoseTrajectory(t, path, Rotation.from_euler("z", yaw))


LIMIT = ns.SpeedLimit(speed=0.2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two recordings and what was learned from them."""
    made = tmp_path_factory.mktemp("report")
    for index, aside in enumerate((0.0, 0.01)):
        cut(aside).to_csv(made / f"cut {index}.csv")
    recordings = ns.load_demonstrations(str(made / "*.csv"))
    ns.learn(recordings, [ns.Blade(), LIMIT], basis_functions=20).save(made / "cut.json")
    return made


@pytest.fixture(scope="module")
def recordings(folder):
    return ns.load_demonstrations(str(folder / "*.csv"))


@pytest.fixture(scope="module")
def told(folder, recordings):
    return report(folder / "cut.json", recordings)


@pytest.fixture(scope="module")
def html(told):
    return to_html(told)


@pytest.fixture(scope="module")
def page(html):
    return Page(html)


@pytest.fixture(scope="module")
def alone(folder):
    """Learned from one recording, under a rule of hostile name."""

    @ns.position_constraint(name="<script>alert('$rule$')</script>")
    def flat(motion):
        return motion.position[2]

    path = folder / "alone" / "flat.json"
    ns.learn(cut(), [flat], basis_functions=20).save(path)
    return path


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the pictures out, where tables and words are what is tested."""
    monkeypatch.setattr("noslip.reporting.content.pictures", lambda *_: [])


# ---------------------------------------------------------------- nothing from outside


def test_nothing_refers_to_the_outside(page):
    assert not {tag for tag, _ in page.elements} & {"script", "link", "iframe", "object", "base"}
    for tag, attributes in page.elements:
        for name in ("src", "href", "srcset", "data", "action", "background", "poster"):
            if name in attributes:
                assert (tag, name) == ("img", "src")
                assert str(attributes[name]).startswith("data:image/")
        assert not any(name.startswith("on") for name in attributes)
        assert "style" not in attributes
    (style,) = page.text["style"]
    assert "url(" not in style and "@import" not in style


def test_every_figure_is_inside_and_told_in_words(page, told):
    images = [attributes for tag, attributes in page.elements if tag == "img"]
    assert len(images) == len(told.pictures) == 8
    for image, picture in zip(images, told.pictures, strict=True):
        kind, _, content = str(image["src"]).partition(";base64,")
        assert kind == "data:image/svg+xml"
        drawing = ElementTree.fromstring(base64.b64decode(content, validate=True))
        assert drawing.tag.endswith("svg")
        for element in drawing.iter():
            for name, value in element.attrib.items():
                if name.endswith("href"):
                    assert value.startswith(("#", "data:image/png;base64,"))
        assert str(image["alt"]) == picture.figure.get_suptitle().replace("\n", " ")
        assert str(image["width"]) == str(round(96 * picture.figure.get_figwidth()))


def test_a_large_figure_is_a_png(told, monkeypatch):
    monkeypatch.setattr("noslip.reporting.document.LARGEST_SVG", 1000)
    page = Page(to_html(replace(told, pictures=told.pictures[1:2])))
    (image,) = [attributes for tag, attributes in page.elements if tag == "img"]
    kind, _, content = str(image["src"]).partition(";base64,")
    assert kind == "data:image/png"
    assert base64.b64decode(content).startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_same_primitive_gives_the_same_page(folder, recordings, html):
    assert to_html(report(folder / "cut.json", recordings)) == html


# ---------------------------------------------------------------- what is told


def slips(motion):
    """Speed along the body's y axis in the middle of each step."""
    return np.abs(slip(motion))


def top_speed(motion):
    ways = np.linalg.norm(np.diff(motion.positions, axis=0), axis=1)
    return (ways / np.diff(motion.times)).max()


def test_files_are_told_by_their_hash(page, folder):
    names = ["cut.json", "cut 0.csv", "cut 1.csv"]
    assert len(page.tables["Files"]) == 1 + len(names)
    for name in names:
        content = (folder / name).read_bytes()
        assert page.cell("Files", str(folder / name), "bytes")[1] == len(content)
        told = page.cell("Files", str(folder / name), "SHA-256")[0]
        assert told == hashlib.sha256(content).hexdigest()


def test_recordings_are_told_by_their_samples_and_how_far_the_motion_is_off(
    page, folder, recordings
):
    motion = ns.load_primitive(folder / "cut.json").rollout()
    share = motion.times / motion.times[-1]
    for recording in recordings:
        row = ("Recordings, as prepared", Path(recording.name).name)
        assert page.cell(*row, "samples") == ("241", 241)
        assert page.cell(*row, "duration") == ("2 s", 2.0)
        path = np.linalg.norm(np.diff(recording.positions, axis=0), axis=1).sum()
        assert page.cell(*row, "path")[1] == pytest.approx(path)
        there = np.column_stack(
            [np.interp(share, recording.times / 2.0, axis) for axis in recording.positions.T]
        )
        off = np.sqrt(np.mean(np.sum((motion.positions - there) ** 2, axis=1)))
        assert page.cell(*row, "motion off")[1] == pytest.approx(off, rel=1e-2)


def test_figures_of_merit_are_those_of_the_motions(page, folder, recordings):
    dmp = ns.load_primitive(folder / "cut.json")
    worst = max(recordings, key=lambda motion: slips(motion).max())
    motions = {"demonstration": worst, "regular": dmp.regular.rollout(), "optimized": dmp.rollout()}
    for name, motion in motions.items():

        def cell(row, name=name):
            return page.cell("Figures of merit", row, name)[1]

        assert cell("residual, peak") == pytest.approx(slips(motion).max(), abs=1e-15)
        assert cell("residual, rms") == pytest.approx(
            np.sqrt(np.mean(slips(motion) ** 2)), abs=1e-15
        )
        assert cell("peak speed") == pytest.approx(top_speed(motion))
        turned = (motion.rotations[1:] * motion.rotations[:-1].inv()).magnitude()
        assert cell("peak angular speed") == pytest.approx((turned / np.diff(motion.times)).max())
        off = np.linalg.norm(motion.positions[-1] - dmp.goal_position)
        assert cell("end: distance from the learned goal") == pytest.approx(off, abs=1e-12)
    pushed = np.linalg.norm(dmp.rollout().constraint_forces[:, :3], axis=1).max()
    text, value = page.cell("Figures of merit", "peak constraint acceleration, linear", "optimized")
    assert value == pytest.approx(pushed) and text.endswith(" m/s²")
    assert (
        page.cell("Figures of merit", "peak constraint acceleration, linear", "regular")[0] == "–"
    )
    assert slips(motions["optimized"]).max() < 1e-12 < 0.01 < slips(worst).max()


def test_constraints_are_told_as_declared_with_residual_and_margin(page, folder, recordings):
    motion = ns.load_primitive(folder / "cut.json").rollout()
    blade, limit = ("Constraints", "blade"), ("Constraints", "speed-limit(speed=0.2)")
    before = max(slips(recording).max() for recording in recordings)
    assert page.cell(*blade, "worst recording")[1] == pytest.approx(before)
    assert page.cell(*blade, "learned")[1] == pytest.approx(slips(motion).max(), abs=1e-15)
    assert page.cell(*blade, "verdict")[0] == "holds"
    margin = 0.2 - max(top_speed(recording) for recording in recordings)
    assert page.cell(*limit, "worst recording")[1] == pytest.approx(margin)
    assert page.cell(*limit, "learned")[0].startswith("margin ")
    assert page.cell(*limit, "kind")[0] == "velocity limit"


def test_the_title_is_the_finding_and_the_verdict_that_of_check(page, told, recordings):
    (title,) = page.text["h1"]
    assert title == told.title
    assert re.search(r"^Demonstration slips .*; learned motion does not slip, ends ", title)
    worst = max(recordings, key=lambda recording: slips(recording).max())
    peak = float(re.findall(r"up to (\S+) mm/s", title)[0])
    assert peak == pytest.approx(1e3 * slips(worst).max(), rel=5e-3)
    # One number for one thing: the way slipped is what check and the table say.
    way = ns.check(worst, ns.Blade()).slip_distance
    assert float(re.findall(r"slips (\S+) mm", title)[0]) == pytest.approx(1e3 * way, rel=5e-3)
    assert page.cell("Figures of merit", "way slipped", "demonstration")[1] == pytest.approx(way)
    assert page.cell("Figures of merit", "way slipped", "optimized")[1] < 1e-12
    assert any("noslip check of the learned motion: holds" in text for text in page.text["p"])
    assert not told.warnings


def test_the_finding_comes_first_and_hashes_last(page, html):
    order = page.text["h2"]
    assert order[0] == "Figures" and order[1] == "Constraints"
    assert order[-3:] == ["Make it again", "Settings and versions", "Files"]
    assert html.index("<h1>") < html.index("<figure>") < html.index("<table")


def test_settings_and_versions_are_told(page):
    found = {row[0][0]: row[1][0] for row in page.tables["Settings and versions"]}
    assert found["basis functions"] == "20"
    assert found["attractor α, β"] == "25, 6.25"
    versions = (ns.__version__, np.__version__, scipy.__version__, casadi.__version__)
    assert tuple(found[name] for name in ("noslip", "numpy", "scipy", "casadi")) == versions
    assert found["Python"] == ".".join(map(str, sys.version_info[:3]))


def test_a_violated_constraint_is_told(folder, recordings, undrawn):
    path = folder / "slow" / "slow.json"
    dmp = ns.load_primitive(folder / "cut.json")
    slow = ns.SpeedLimit(speed=0.05, priority=1)
    advance = ns.velocity_constraint(name="advance")(lambda m: m.linear_velocity[0] - 0.06)
    under(dmp, (slow, advance)).save(path)
    told = report(path, recordings)
    assert not told.holds and told.verdict == "violated: speed-limit"
    page = Page(to_html(told))
    row = ("Constraints", "speed-limit(speed=0.05, priority=1)")
    text, margin = page.cell(*row, "learned")
    assert margin is not None and margin < 0 and "-" in text
    assert page.cell(*row, "verdict")[0] == "violated"
    assert page.cell(*row, "kind")[0] == "velocity soft limit, priority 1"
    assert ("p", {"class": "verdict violated"}) in page.elements


# ---------------------------------------------------------------- what is given


def test_without_recordings_the_ordinary_primitive_stands_for_them(folder):
    told = report(folder / "cut.json")
    page = Page(to_html(told))
    assert told.title.startswith("Regular slips ")
    assert "learned from 2 recordings" in told.lead and "not at hand" in told.lead
    assert "Recordings, as prepared" not in page.tables
    heads = [text for text, _ in page.tables["Figures of merit"][0]]
    assert heads == ["", "regular", "optimized"]
    assert len(told.pictures) == 6


def test_a_primitive_without_constraints_has_a_report_too(folder):
    path = folder / "free" / "free.json"
    ns.learn(cut(), basis_functions=20).save(path)
    told = report(path, [cut()])
    page = Page(to_html(told))
    assert told.title.endswith("learned without constraints")
    assert told.verdict == "" and not told.warnings
    assert "Constraints" not in page.tables
    assert not any("check" in line for line in told.commands)


def test_recordings_that_are_not_what_was_learned_from_are_told(folder, recordings, alone, undrawn):
    moved = replace(recordings[1], positions=recordings[1].positions + [0.01, 0, 0])
    (starts, ends) = report(folder / "cut.json", [recordings[0], moved]).warnings
    assert "starts 5 mm from" in starts and "ends 5 mm from" in ends
    (count,) = report(folder / "cut.json", recordings[:1]).warnings
    assert "learned from 2 recordings, given 1" in count
    (other, *_) = report(alone, recordings[:1]).warnings
    assert "given" in other and "cut 0.csv" in other


def test_hostile_names_stay_text(folder, alone):
    name = "<img src=x onerror=alert(1)>&\"'${{ 7*7 }}.csv"
    recording = cut().to_csv(folder / "hostile" / name)
    told = report(alone, ns.load_demonstrations(recording))
    html = to_html(told)
    page = Page(html)
    assert "<script" not in html and "<img src=x" not in html
    tags = {tag for tag, _ in page.elements}
    assert "script" not in tags
    assert all(a["src"].startswith("data:") for tag, a in page.elements if tag == "img")
    assert page.cell("Recordings, as prepared", name, "samples")[1] == 241
    rule = "<position constraint \"<script>alert('$rule$')</script>\">"
    assert page.cell("Constraints", rule, "verdict")[0] == "holds"


@pytest.mark.skipif(sys.platform != "linux", reason="other file names are text")
def test_bytes_of_a_name_that_are_no_text_are_escaped(folder, undrawn):
    name = os.fsdecode(b"cut \xff\n.csv")
    recording = cut().to_csv(folder / "bytes" / name)
    told = report(folder / "cut.json", ns.load_demonstrations(recording))
    shown = str(folder / "bytes" / r"cut \udcff\n.csv")
    page = Page(to_html(told).encode().decode())
    assert page.cell("Files", shown, "bytes")[1] == recording.stat().st_size


# ---------------------------------------------------------------- made again


def test_declarations_are_understood_again():
    constraints = [
        ns.Blade(),
        ns.Blade(lateral="z", edge="-x", reference_point=(0.0, 0.01, 0.0)),
        ns.Needle(),
        ns.SpeedLimit(speed=0.3, priority=2),
        ns.constraints.Box(lower=(-1, -1, 0), upper=(1, 1, 1)),
        ns.constraints.Box(upper=(np.inf, np.inf, 0.1)),
        ns.KeepOutSphere(center=(0.1, 0, 0), radius=0.02),
        ns.constraints.SurfaceContact(surface="z - 0.1*x**2"),
        ns.constraints.TurningRadius(radius=0.2),
    ]
    for constraint in constraints:
        assert parse_constraint(declaration(constraint)) == constraint
    assert declaration(ns.Blade()) == "blade"
    assert {type(c) for c in constraints} <= set(CATALOG.values())


def carried_out(lines, monkeypatch):
    for line in lines:
        if line.startswith("#"):
            continue
        monkeypatch.setattr(sys, "argv", shlex.split(line))
        with pytest.raises(SystemExit) as stop:
            main()
        assert not stop.value.code, line


def assert_same_to_the_bit(again, first):
    assert dataclasses.replace(again, history=first.history) == first
    assert again.rollout() == first.rollout()
    assert [origin.verb for origin in again.history] == [origin.verb for origin in first.history]


EVERY_OPTION = {
    "basis_functions": 30,
    "alpha": 20.0,
    "beta": 5.0,
    "alpha_s": 1.5,
    "ridge": 1e-5,
    "start": "position",
    "end": "rotation",
    "position_weight": 2e4,
    "position_smoothing": 2e-6,
    "rotation_smoothing": 1e-5,
    "metric": "shared",
    "metric_length": 0.02,
    "stabilization": 10.0,
    "barrier_rate": 50.0,
    "project_start": "velocity",
}


@pytest.mark.parametrize(
    "settings",
    [
        {},
        EVERY_OPTION,
        {"hold_position": True},
        {"metric": "position"},
        {"metric": [1.0, 1.0, 1.0, 2.0, np.inf, 4.0]},
    ],
)
def test_the_commands_make_the_same_primitive_again(settings, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    cut().to_csv("my cut.csv")
    (demonstration,) = ns.load_demonstrations("my cut.csv")
    first = ns.learn(demonstration, [ns.Blade(), LIMIT], **settings)
    learned, rolled, checked, _ = commands(first, "again.json", ["my cut.csv"])
    carried_out([learned, rolled, checked], monkeypatch)
    assert_same_to_the_bit(ns.load_primitive("again.json"), first)
    capsys.readouterr()


ADAPTED = [
    {"goal_position": [0.31, -0.02, 0.01], "goal_rotation": Rotation.from_rotvec([0.1, 0.2, -0.3])},
    {
        "start_position": [0.0, -0.01, 0.0],
        "start_rotation": Rotation.from_rotvec([0.03, -0.01, 0.2]),
        "start_velocity": [0.2, 0.0, -0.01],
        "goal_velocity": 0,
        "duration": 1.3,
        "samples": 301,
        "position_weight": 20.0,
        "position_smoothing": 2e-2,
        "rotation_smoothing": 2e-4,
    },
    {"goal_position": np.array([0.28, 0.02, 0.0]), "scaling": "difference", "end": "position"},
    {
        "via": [
            (0.3, np.array([0.1, 0.01, 0.0])),
            (0.5, None, Rotation.from_rotvec([0.02, 0.05, 0.1])),
            Boundary(0.7, [0.2, 0.01, 0.0], Rotation.from_rotvec([0.0, 0.05, 0.2])),
        ]
    },
]


@pytest.mark.parametrize(
    "asked", [ADAPTED[:1], ADAPTED[1:2], ADAPTED[2:3], ADAPTED[3:], ADAPTED[:3]]
)
def test_the_commands_adapt_it_again(asked, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    cut().to_csv("cut.csv")
    (demonstration,) = ns.load_demonstrations("cut.csv")
    first = ns.learn(demonstration, [ns.Blade()], basis_functions=30)
    for options in asked:
        first = first.adapt(**options)
    carried_out(commands(first, "again.json", ["cut.csv"])[: len(asked) + 1], monkeypatch)
    assert_same_to_the_bit(ns.load_primitive("again.json"), first)
    capsys.readouterr()


def test_what_was_replanned_is_said_to_be_python_alone():
    dmp = ns.learn(cut(), [ns.Blade()], basis_functions=30)
    state = dmp.initial_state()
    for _ in range(20):
        state = dmp.step(state, 0.01)
    learned, comment, *_ = commands(dmp.replan(state), "again.json", ["cut.csv"])
    assert learned.startswith("noslip learn")
    assert comment == "# then re-planned in Python from its state at 0.2 s"


@pytest.mark.parametrize(
    ("group", "function"), [(Learning, ns.learn), (None, ns.ConstrainedDMP.adapt)]
)
def test_each_option_of_python_is_one_of_the_command(group, function):
    known = inspect.signature(function).parameters
    names = {name for name, p in known.items() if p.kind is p.KEYWORD_ONLY and name != "progress"}
    if group is None:
        offered = set(inspect.signature(adapt.run).parameters)
        # A point as a whole is told there by its parts, or as values.
        own = {"primitive", "out", "goals", "figure", "as_json", "goal_values", "start_values"}
        assert names - offered == {"goal"}
        assert offered - names == own
    else:
        defaults = {f.name: f.default for f in dataclasses.fields(group)}
        # The robot is told where the joints are read; a distribution is for Python.
        assert names - set(defaults) == {"robot", "distribution", "context"}
        assert set(defaults) <= names
        # "auto" of an end leaves the choice to what is called.
        assert defaults.pop("start") == defaults.pop("end") == "auto"
        assert all(known[name].default == default for name, default in defaults.items())


def test_own_constraints_and_preparation_are_in_the_commands(folder, alone):
    dmp = ns.load_primitive(alone)
    learned, *_, last = commands(dmp, "flat.json", ["a.csv"], ["--rate=120", "--relative"])
    assert "--constraint YOUR_RULES.py:NAME" in learned
    assert "a.csv --rate=120 --relative" in learned and "--rate=120 --relative" in last


# ---------------------------------------------------------------- files


@pytest.mark.slow
def test_pdf_has_numbered_pages(told, tmp_path):
    pytest.importorskip("weasyprint", reason="the extra report is not installed")
    (path,) = write_report(told, [tmp_path / "report.pdf"])
    content = path.read_bytes()
    assert content.startswith(b"%PDF-") and content.rstrip().endswith(b"%%EOF")
    if not (shutil.which("pdftoppm") and shutil.which("pdftotext")):
        pytest.skip("pdftoppm and pdftotext (poppler) are absent")
    subprocess.run(["pdftoppm", "-r", "20", "-png", path, tmp_path / "page"], check=True)
    pages = sorted(tmp_path.glob("page-*.png"))
    text = subprocess.run(["pdftotext", "-layout", path, "-"], check=True, capture_output=True)
    sheets = text.stdout.decode().split("\f")[:-1]
    assert 4 <= len(sheets) == len(pages) <= 9
    for number, sheet in enumerate(sheets, start=1):
        assert re.search(rf"cut\.json\s+{number} ?/ ?{len(sheets)}\s*$", sheet)
    assert all(np.ptp(imread(page)) > 0.5 for page in pages)


def test_html_and_pdf_are_written_by_their_suffix_and_others_refused(told, tmp_path):
    pytest.importorskip("weasyprint", reason="the extra report is not installed")
    small = replace(told, pictures=())
    html, pdf = write_report(small, [tmp_path / "a" / "r.html", tmp_path / "a" / "r.pdf"])
    assert html.read_text() == to_html(small)
    assert pdf.read_bytes()[:5] == to_pdf(small)[:5] == b"%PDF-"
    with pytest.raises(InputError, match=r"r\.docx: a report ends in \.html or \.pdf"):
        write_report(small, [tmp_path / "b" / "r.html", tmp_path / "b" / "r.docx"])
    assert not (tmp_path / "b").exists()


@pytest.mark.parametrize(("package", "suffix"), [("jinja2", "html"), ("weasyprint", "pdf")])
def test_without_the_extra_the_error_says_what_to_install(
    told, tmp_path, monkeypatch, package, suffix
):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'noslip\[report\]'"):
        write_report(replace(told, pictures=()), [tmp_path / f"r.{suffix}"])
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_phone_scrolls_down_only(html, tmp_path):
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("no chromium on this machine")
    path = tmp_path / "report.html"
    path.write_text(html)
    with playwright.sync_playwright() as play:
        browser = play.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 390, "height": 800})
        said, asked = [], []
        page.on("console", lambda message: said.append(message.text))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(path.as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        # Tables fit: each row is a card.  Figures may be scrolled sideways by themselves.
        fits = "[...document.querySelectorAll('table')].every(t => t.scrollWidth <= 360)"
        assert page.evaluate(fits)
        drawn = "[...document.images].every(i => i.complete && i.naturalWidth > 0)"
        assert page.evaluate(drawn)
        browser.close()
    assert not said
    assert [url for url in asked if not url.startswith("data:")] == [path.as_uri()]
