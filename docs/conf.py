import base64
import csv
import importlib.metadata
import json
import logging
import os
import re
import runpy
import zipfile
from pathlib import Path

from docutils import nodes
from sphinx.errors import ExtensionError
from sphinx_gallery.directives import imgsgnode

import liouville as lv
from liouville import plot, problems

project = "liouville"
logging.getLogger("skfem").setLevel("WARNING")  # it tells of every assembly
os.environ.setdefault("JAX_PLATFORMS", "cpu")  # it tells of devices that are not there
author = copyright = "The liouville developers"
release = importlib.metadata.version("liouville")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",  # copies MathJax into the built pages: they need no network
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "sphinxcontrib.bibtex",
]
myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "gallery/*.ipynb", "gallery/*.py"]

nitpicky = True  # a link that leads nowhere is an error
# Types in docstrings are words: "optional", "array_like".
nitpick_ignore_regex = [("py:class", r"(?!liouville\b).*")]

linkcheck_ignore = [
    "https://(github.com/)?liouville-integrators"
]  # tests/test_pages.py looks
linkcheck_retries = 3

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
    "image_srcset": ["2x"],
    "show_signature": False,
    "write_computation_times": False,  # their page fetches scripts from the network
    "min_reported_time": 1e9,
    "reset_modules": ("matplotlib",),
}

html_theme = "furo"
html_title = f"liouville {release}"
html_theme_options = {
    "source_repository": "https://github.com/liouville-integrators/liouville/",
    "source_branch": "main",
    "source_directory": "docs/",
}
html_static_path = ["_static"]
html_css_files = ["custom.css"]


def show_tables(app, docname, source):
    """Show a line that is a link to a CSV file as a table; a forge shows the link."""
    folder = Path(app.env.doc2path(docname)).parent

    def shown_as_table(link):
        app.env.note_dependency(folder / link[1])
        with (folder / link[1]).open(encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file)
        is_number = re.compile(r"[-+\d]|$").match
        rule = [
            "---:" if all(map(is_number, x)) else ":---" for x in zip(*rows, strict=True)
        ]
        cells = [[x.replace("|", r"\|") or "\N{EN DASH}" for x in row] for row in rows]
        return "\n".join(f"| {' | '.join(row)} |" for row in (header, rule, *cells))

    source[0] = re.sub(r"^\[.*\]\((\S+\.csv)\)$", shown_as_table, source[0], flags=re.M)


def keep_numbers_whole(app, doctree):
    """Mark short cells of numbers, which style sheets keep on one line: 3.9e-02 has a hyphen."""
    for cell in doctree.findall(nodes.entry):
        text = cell.astext()
        if len(text) < 16 and re.match(r"[-+\d]", text):
            cell["classes"].append("number")


def outputs(page, source):
    """Return the outputs of each code cell of a gallery page, as a notebook writes them."""
    cells = []
    for node in page.findall():
        if isinstance(node, nodes.literal_block) and node.get("language") == "Python":
            cells.append([])
        elif (
            isinstance(node, nodes.literal_block)
            and "sphx-glr-script-out" in node["classes"]
        ):
            text = f"{node.astext()}\n"
            cells[-1].append({"output_type": "stream", "name": "stdout", "text": text})
        elif isinstance(node, imgsgnode):
            picture = base64.b64encode(
                (source / node["uri"].lstrip("/")).read_bytes()
            ).decode()
            cells[-1].append(shown("display_data", {"image/png": picture}))
        elif isinstance(node, nodes.raw) and "output_result" in node.astext():
            html = {"text/html": node.astext().removesuffix("<br />\n<br />")}
            cells[-1].append(shown("execute_result", html, execution_count=len(cells)))
    return cells


def shown(kind, data, **more):
    """Return an output of a notebook that has data."""
    return {"output_type": kind, "data": data, "metadata": {}, **more}


def fill_notebooks(app, env):
    """Give the notebooks of the gallery the outputs that their pages have: nothing runs twice."""
    source = Path(app.srcdir)
    for path in sorted((source / "gallery").glob("*.ipynb")):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        found = outputs(env.get_doctree(f"gallery/{path.stem}"), source)
        if len(found) != len(code) or not any(found):
            raise ExtensionError(
                f"{path.name}: {len(code)} cells, {len(found)} of them on its page"
            )
        for count, (cell, shown_there) in enumerate(zip(code, found, strict=True), 1):
            cell.update(outputs=shown_there, execution_count=count)
        path.write_text(json.dumps(notebook, indent=1) + "\n", encoding="utf-8")
        with zipfile.ZipFile(path.with_suffix(".zip"), "w", zipfile.ZIP_DEFLATED) as both:
            for file in (path, path.with_suffix(".py")):
                both.write(file, file.name)


def write_view(app, error):
    """Write the pages that other pages have in frames: a moving mechanism, and sweeps."""
    if error is None and app.builder.format == "html":
        problem = problems.load("stewart_platform")
        motion = lv.integrate(
            problem.system,
            lv.Spark(3),
            t=(0, 10),
            h=0.02,
            params={"c": 3000.0},
            **problem.start,
        )
        folder = Path(app.outdir) / "_static"
        plot.view(motion, path=folder / "mechanism.html", trace="plate")
        runpy.run_path(str(Path(app.confdir).parent / "tools" / "sweeps.py"))["main"](
            folder
        )


def setup(app):
    """Connect the above."""
    app.connect("source-read", show_tables)
    app.connect("doctree-read", keep_numbers_whole)
    app.connect("env-updated", fill_notebooks)
    app.connect("build-finished", write_view)
