import importlib.metadata
import re

from docutils import nodes

project = "liouville"
author = copyright = "The liouville developers"
release = importlib.metadata.version("liouville")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",  # copies MathJax into the built pages: they need no network
    "sphinx_gallery.gen_gallery",
    "sphinxcontrib.bibtex",
]
myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "gallery/*.ipynb", "gallery/*.py"]

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say shapes and units, which types cannot
napoleon_google_docstring = False
napoleon_use_ivar = True

bibtex_bibfiles = ["references.bib"]
bibtex_reference_style = "label"

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"demo\.py$",  # the demo is a program: it prints a table and saves a figure
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,  # their page fetches scripts from the network
    "min_reported_time": 1e9,
    "reset_modules": ("matplotlib",),
}

html_theme = "furo"
html_title = "liouville"
html_static_path = ["_static"]
html_css_files = ["custom.css"]


def keep_numbers_whole(app, doctree):
    """Mark short cells of numbers, which style sheets keep on one line: 3.9e-02 has a hyphen."""
    for cell in doctree.findall(nodes.entry):
        text = cell.astext()
        if len(text) < 16 and re.match(r"[-+\d]", text):
            cell["classes"].append("number")


def setup(app):
    """Connect the above."""
    app.connect("doctree-read", keep_numbers_whole)
