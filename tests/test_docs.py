"""What the documentation says runs, and what it cites exists."""

import doctest
import pkgutil
import re
from importlib import import_module
from pathlib import Path

import pytest

import liouville

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if not {"_build", "gallery"} & set(page.parts)]
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


def programs(page):
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


def name(path):
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", [page for page in PAGES if programs(page)], ids=name)
def test_the_programs_of_a_page_run(page, elsewhere):
    scope = {"__name__": "page"}
    for program in programs(page):
        exec(compile(program, name(page), "exec"), scope)


@pytest.mark.parametrize("module", ["liouville", *MODULES])
def test_the_examples_in_docstrings_are_true(module, elsewhere):
    failed, _ = doctest.testmod(import_module(module), optionflags=doctest.ELLIPSIS)
    assert failed == 0


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
