"""Sphinx configuration."""

import sys
from importlib.resources import files
from pathlib import Path

from noslip import __version__

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from gallery import left_out

project = "noslip"
author = "the noslip authors"
copyright = "2026, the noslip authors"
release = version = __version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_gallery.gen_gallery",
    "matplotlib.sphinxext.plot_directive",
    "gallery",
    "links",
]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb", ".rst": "restructuredtext"}
# The gallery has chapters of its own, in gallery.md.
exclude_patterns = ["_build", "_ext", "plots", "_generated/gallery/index.rst"]

myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
myst_dmath_double_inline = True

# Formulas render without a network: MathJax lies beside the pages.  This file of it draws letters
# as SVG and needs no other; the rest of the package, 22 MB, stays where it is.
html_static_path = [str(files("sphinx-mathjax-offline") / "static" / "mathjax" / "tex-svg.js")]
mathjax_path = "tex-svg.js"

# Notebooks are kept without outputs, and so are executed by each build that reads them.
nb_execution_mode = "auto"
nb_execution_in_temp = True
nb_execution_timeout = 120
nb_execution_raise_on_error = True

# The figures of the concepts: each is drawn by a script beside its page.
plot_formats = [("png", 144)]
plot_html_show_formats = False
plot_html_show_source_link = True

# The examples run by their own command; what they write is their picture (_ext/gallery.py).
sphinx_gallery_conf = {
    "examples_dirs": ["../examples"],
    "gallery_dirs": ["_generated/gallery"],
    "filename_pattern": r"\.py$",
    "ignore_pattern": left_out,
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("gallery.written_picture",),
    "reset_argv": "gallery.arguments",
    "reset_modules": (),
    "capture_repr": (),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "notebook_extensions": set(),
    "show_signature": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
}

html_theme = "furo"
html_title = "noslip"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_ivar = True
# Attributes that docstrings list are looked up everywhere: several classes have a duration.
suppress_warnings = ["ref.python"]
