"""The programs of the documentation run, its sources exist, and it has one sentence a line."""

import ast
import csv
import doctest
import pkgutil
import re
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import pytest
from pages import PAGES, ROOT, name, tokens

import liouville

PROSE = [*PAGES, ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md"]
MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages(liouville.__path__, "liouville.")
    if not module.name.endswith("._core")
)
SOURCES = [
    *PAGES,
    *sorted((ROOT / "python").rglob("*.py")),
    *sorted((ROOT / "crates").rglob("*.rs")),
    *sorted((ROOT / "examples").glob("*.py")),
]

# The demo is a program, and no page.
GALLERY = [path for path in sorted((ROOT / "examples").glob("*.py")) if path.stem != "demo"]

# A sentence ends inside a line: not after an initial, nor after a catchword in italics.
END = re.compile(r"(?<!\b[A-Z])(?<=\S)[.?!][)*\"]* +(?=[A-Z*({\[~])")
CATCHWORD = re.compile(r"\*[^*]+[.?!]\* ")


# What a command of a page would take minutes for, and what stands for it here.
SHORTER = {"--until 1e6": "--until 50", "--until 0.2": "--until 0.002"}


def blocks(page, language):
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.M | re.S)


def commands(page):
    """Return the calls of the program ``liouville`` on a page."""
    return re.findall(r"^liouville (.*?) *(?:#.*)?$", "\n".join(blocks(page, "sh")), re.M)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=name)
def test_the_programs_of_a_page_run_and_print_what_it_says(page, elsewhere, capsys):
    scope = {"__name__": "page"}
    printed = ""
    for program, _, said in re.findall(
        r"^```python\n(.*?)^```\n(\s*```text\n(.*?)^```)?",
        page.read_text(encoding="utf-8"),
        re.M | re.S,
    ):
        exec(compile(program, name(page), "exec"), scope)
        printed = capsys.readouterr().out
        assert said in printed


# Those of README.md are run by tools/check_wheel.py.
@pytest.mark.parametrize("page", [page for page in PAGES[1:] if commands(page)], ids=name)
def test_the_commands_of_a_page_run(page, liouville):
    model = next(program for program in blocks(page, "python") if "def lagrangian" in program)
    Path("pendulum.py").write_text(model, encoding="utf-8")
    for command in commands(page):
        for long, short in SHORTER.items():
            command = command.replace(long, short)
        ran = liouville(command)
        assert ran.returncode == 0, f"liouville {command}\n{ran.stdout}{ran.stderr}"


@pytest.mark.parametrize("module", ["liouville", *MODULES])
def test_the_examples_in_docstrings_are_true(module, elsewhere):
    failed, _ = doctest.testmod(import_module(module), optionflags=doctest.ELLIPSIS)
    assert failed == 0


@pytest.mark.parametrize("script", GALLERY, ids=name)
def test_an_example_of_the_gallery_is_a_notebook_of_prose_and_code(script):
    docstring, *cells = re.split(r"^# %%\n", script.read_text(encoding="utf-8"), flags=re.M)
    assert ast.get_docstring(ast.parse(docstring))
    assert len(cells) >= 2
    for cell in cells:
        assert re.match(r"# [A-Z]", cell), f"a cell without prose:\n{cell}"
        assert ast.parse(cell).body, f"a cell without code:\n{cell}"
    assert cells[-1].endswith("plt.show()\n") or "print(" in cells[-1]


def test_programs_for_users_have_no_private_modules():
    programs = {name(page): "\n".join(blocks(page, "python")) for page in PAGES}
    programs |= {name(script): script.read_text(encoding="utf-8") for script in GALLERY}
    assert not [where for where, program in programs.items() if "liouville._" in program]


def test_every_source_cited_is_in_the_list():
    bibliography = (ROOT / "docs" / "references.bib").read_text(encoding="utf-8")
    known = re.findall(r"^@\w+\{(\w+),", bibliography, re.M)
    assert len(known) == len(set(known))
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        cited = ",".join(re.findall(r"(?:\{cite:\w+\}|:cite:\w+:)`([^`]+)`", text)).split(",")
        for line in re.findall(r"^\s*//!(.*)", text, re.M):
            cited += re.findall(r"\b[a-z]{3,}(?:19|20)\d\d[a-z]*\b", line)
        missing = sorted(set(filter(None, map(str.strip, cited))) - set(known))
        assert not missing, f"{name(path)} cites {missing}, which docs/references.bib does not have"


def test_the_list_of_sources_can_be_read():
    """An entry that is not closed ends the build of all pages."""
    entries = (
        pytest.importorskip("pybtex.database").parse_file(ROOT / "docs/references.bib").entries
    )
    assert len(entries) > 100


@pytest.mark.parametrize("page", PROSE, ids=name)
def test_every_file_that_a_page_names_exists(page):
    folders = "benchmarks|crates|docs|examples|python|tests|tools"
    named = re.findall(rf"`(?:python )?((?:{folders})/[\w./-]+)", page.read_text(encoding="utf-8"))
    made = ("docs/_build/",)
    missing = [path for path in named if not (path.startswith(made) or (ROOT / path).exists())]
    assert not missing, f"{name(page)} names {missing}"


def test_every_table_that_was_measured_is_shown_and_written_by_a_benchmark():
    """Numbers typed by hand grow stale, and so do files that no program writes."""
    measured = ROOT / "docs" / "measured"
    pages = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md"))
    programs = "\n".join(
        path.read_text(encoding="utf-8") for path in (ROOT / "benchmarks").glob("*.py")
    )
    there = {path.stem for path in measured.glob("*.csv")}
    assert set(re.findall(r"^\[.+\]\(measured/(\w+)\.csv\)$", pages, re.M)) == there
    written = set(re.findall(r"publish\(\s*\"(\w+)\"", programs))
    written |= set(re.findall(r"\(\"(gradient_\w+)\", ", programs))
    assert written == there - {"taken"}
    with (measured / "taken.csv").open(encoding="utf-8", newline="") as file:
        assert {row["table"] for row in csv.DictReader(file)} == written


def faults(text):
    """Yield the number of each line that is too long or not one sentence, and why.

    Code, tables and links may be long.
    """
    blocks = tokens(text)
    wide = [range(*block.map) for block in blocks if block.type in ("fence", "table_open")]
    for number, line in enumerate(text.splitlines()):
        only_link = re.fullmatch(r"!?\[[^\]]*\]\(\S+\)", line)
        if len(line) > 160 and not only_link and not any(number in block for block in wide):
            yield number + 1, f"{len(line)} characters"
    for opening, block in pairwise(blocks):
        if opening.type != "paragraph_open" or block.type != "inline":
            continue
        last = block.content.count("\n")
        for index, line in enumerate(block.content.splitlines()):
            number = block.map[0] + index + 1
            plain = re.sub(r"`[^`]*`|\$[^$]+\$|\{\w+(:\w+)?\}`[^`]*`", "~", line)
            if END.search(CATCHWORD.sub("", plain, count=1)):
                yield number, "two sentences"
            if index < last and not re.search(r"[.?!][)*\"]*$", plain):
                yield number, "a sentence is broken"


@pytest.mark.parametrize("page", PROSE, ids=name)
def test_prose_has_one_sentence_a_line(page):
    found = [f"{name(page)}:{line}: {why}" for line, why in faults(page.read_text("utf-8"))]
    assert not found, "\n".join(found)


def test_other_lines_are_seen():
    assert list(faults("One is. Two are.\n")) == [(1, "two sentences")]
    assert list(faults("- One\n  is.\n")) == [(1, "a sentence is broken")]
    assert list(faults(f"Let {'very ' * 40}long.\n")) == [(1, "209 characters")]
    assert list(faults("*Order.* By C. Runge, $x. Y$ and `a. B` are.\nSo (too).\n")) == []
    assert list(faults(f"[{'link ' * 40}](page.md)\n\n| {'cell. Cell. ' * 20} |\n|-|\n")) == []


# A docstring begins with its subject: "Return the solvers", never "Return what solved".
NO_SUBJECT = re.compile(r"(Return )?(those|such|what|that which|so many|as many)\b|of ", re.I)


def test_a_docstring_begins_with_its_subject():
    for sentence in ("Return what solved it.", "Those that turn.", "So many steps.", "Of it."):
        assert NO_SUBJECT.match(sentence)
    for sentence in ("Return the solvers.", "Whatever is kept.", "Suchlike.", "Offsets of rows."):
        assert not NO_SUBJECT.match(sentence)
    lacking = []
    for path in sorted((ROOT / "python").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                told = ast.get_docstring(node) or ""
                if NO_SUBJECT.match(told):
                    lacking.append(f"{name(path)}: {told.splitlines()[0]}")
    assert not lacking, "\n".join(lacking)
