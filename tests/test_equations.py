"""Every formula of the documentation is set by the MathJax that the built pages carry."""

import ast
import importlib.util
import json
import re
import runpy
import subprocess
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace

import pytest
import sphinx.util.logging  # noqa: F401 - sphinx.ext.mathjax wants it loaded
from docutils import nodes
from pages import CONF, PAGES, ROOT, name, tokens
from py_mini_racer import mini_racer
from sphinx.ext.mathjax import html_visit_displaymath

SOURCES = [*sorted((ROOT / "python").rglob("*.py")), *sorted((ROOT / "examples").glob("*.py"))]
MATHJAX = Path(importlib.util.find_spec("sphinx-mathjax-offline").origin).parent / "static/mathjax"

# The parts of tex-chtml.js, the script of the pages, around a document that is no browser's.
PARTS = (
    "loader",
    "core",
    "adaptors/liteDOM",
    "input/tex",
    "output/chtml",
    "output/chtml/fonts/tex",
)
SETTER = r"""
const {TeX} = MathJax._.input.tex_ts, {CHTML} = MathJax._.output.chtml_ts;
const adaptor = MathJax._.adaptors.liteAdaptor.liteAdaptor();
MathJax._.handlers.html_ts.RegisterHTMLHandler(adaptor);
const InputJax = new TeX({packages: ["base", "ams", "newcommand"]});
const OutputJax = new CHTML({font: new MathJax._.output.chtml.fonts.tex_ts.TeXFont()});
const page = MathJax._.mathjax.mathjax.document("", {InputJax, OutputJax});
const set = ([tex, display]) => adaptor.outerHTML(page.convert(tex, {display}));
"""


@pytest.fixture(scope="module")
def mathjax():
    """Return a function that sets formulas and returns the errors of MathJax in each."""
    with mini_racer() as engine:
        for part in PARTS:
            engine.eval((MATHJAX / f"{part}.js").read_text(encoding="utf-8"))
        engine.eval(SETTER)

        def errors(formulas):
            made = json.loads(engine.eval(f"JSON.stringify({json.dumps(formulas)}.map(set))"))
            assert all("<mjx-math" in one for one in made)
            return [re.findall(r'data-mjx-error="(.*?)"', one) for one in made]

        yield errors


def written(text, no_wrap=False):
    """Return a displayed formula as Sphinx writes it into a page."""
    config = SimpleNamespace(mathjax_display=("", ""))
    writer = SimpleNamespace(
        body=[], encode=str, starttag=lambda *_, **__: "", builder=SimpleNamespace(config=config)
    )
    node = nodes.math_block(text, text, nowrap=no_wrap, number=None)
    with pytest.raises(nodes.SkipNode):
        html_visit_displaymath(writer, node)
    return "".join(writer.body).removesuffix("</div>\n").removesuffix("</div>")


def in_markdown(text):
    """Yield line, formula and whether it is displayed."""
    for block in tokens(text):
        line = block.map[0] + 1 if block.map else 0
        for token in [block, *(block.children or [])]:
            if token.type == "math_inline":
                yield line, token.content, False
            elif token.type.startswith("math_"):
                yield line, written(token.content), True
            elif token.type == "amsmath":
                yield line, written(token.content, no_wrap=True), True
            elif token.type == "fence" and token.info == "{eval-rst}":
                yield from in_restructured_text(token.content, line + 1)
            elif token.type == "text":
                assert not re.search(r"\$|\\[a-z]", token.content), f"no formula: {token.content}"


def in_restructured_text(text, line):
    """Yield line, formula and whether it is displayed."""
    inline = re.compile(r":math:`([^`]+)`")
    displayed = re.compile(r"^( *)\.\. math::((?:.*\n?)(?:\1 +.*\n?|\s*\n)*)", re.M)
    for match in inline.finditer(text):
        yield line + text.count("\n", 0, match.start()), match[1].replace("\n", " "), False
    for match in displayed.finditer(text):
        first, _, rest = match[2].partition("\n")
        formula = first.strip() + "\n" + textwrap.dedent(rest)
        yield line + text.count("\n", 0, match.start()), written(formula.strip()), True


def in_python(text):
    """Yield the formulas of all docstrings, and of the comments that are text of the gallery."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Expr(ast.Constant(str(docstring))):
                yield from in_restructured_text(docstring, node.lineno)
    for match in re.finditer(r"(?:^# .*\n|^#\n)+", text, re.M):
        comment = re.sub(r"^# ?", "", match[0], flags=re.M)
        yield from in_restructured_text(comment, 1 + text.count("\n", 0, match.start()))


@pytest.mark.parametrize("path", [*PAGES, *SOURCES], ids=name)
def test_every_formula_is_set(path, mathjax):
    find = in_python if path.suffix == ".py" else in_markdown
    found = list(find(path.read_text(encoding="utf-8")))
    bad = [
        f"{name(path)}:{line}: {', '.join(errors)}: {formula}"
        for (line, formula, _), errors in zip(found, mathjax([f[1:] for f in found]), strict=True)
        if errors
    ]
    assert not bad, "\n".join(bad)


@pytest.mark.parametrize(
    ("formula", "error"),
    [
        (r"\begin{split}a \\ b \tag{1}\end{split}", r"\tag not allowed in split environment"),
        (r"\nosuchmacro x", r"Undefined control sequence \nosuchmacro"),
        (r"\frac{a", "Missing close brace"),
    ],
)
def test_a_formula_that_cannot_be_set_is_seen(formula, error, mathjax):
    assert mathjax([[formula, True]]) == [[error]]


def test_formulas_are_found_where_they_stand():
    page = "Let $x$ be.\n\n$$\na \\\\ b\n$$\n\n| t |\n|---|\n| $y$ |\n"
    found = [(formula, display) for _, formula, display in in_markdown(page)]
    assert found[:2] == [("x", False), (r"\begin{split}" + "\na \\\\ b\n" + r"\end{split}", True)]
    assert found[2:] == [("y", False)]
    with pytest.raises(AssertionError, match="no formula: This costs \\$"):
        list(in_markdown("This costs \\$.\n"))
    source = '"""Do.\n\n.. math:: a\n    = b\n\nSo :math:`c`.\n"""\n# %%\n# And :math:`d`.\n'
    assert [(line, formula) for line, formula, _ in in_python(source)] == [
        (6, "c"), (3, "a\n= b"), (9, "d")
    ]  # fmt: skip


def test_a_page_needs_no_network(tmp_path):
    (tmp_path / "index.md").write_text("# Page\n\n$$\nx = 1\n$$\n", encoding="utf-8")
    away = {"sphinx_gallery.gen_gallery", "sphinxcontrib.bibtex"}
    extensions = [name for name in runpy.run_path(CONF)["extensions"] if name not in away]
    options = ["-q", "-c", CONF.parent, "-D", f"extensions={','.join(extensions)}"]
    command = [sys.executable, "-m", "sphinx", *options, tmp_path, tmp_path / "out"]
    subprocess.run(command, check=True, capture_output=True)
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    fetched = re.findall(r'<(?:script|img)\b[^>]*\bsrc="([^"?]+)', page)
    fetched += re.findall(r'<link rel="stylesheet"[^>]*\bhref="([^"?]+)', page)
    assert any("mathjax" in file for file in fetched)
    assert [file for file in fetched if not (tmp_path / "out" / file).is_file()] == []
