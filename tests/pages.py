"""The pages of the documentation: where they are, and how they are read."""

import runpy
from pathlib import Path

from markdown_it.renderer import RendererHTML
from myst_parser.config.main import MdParserConfig
from myst_parser.parsers.mdit import create_md_parser

ROOT = Path(__file__).resolve().parent.parent
CONF = ROOT / "docs" / "conf.py"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if not {"_build", "gallery"} & set(page.parts)]


def name(path):
    return path.relative_to(ROOT).as_posix()


def tokens(text):
    """Return the blocks of a page in MyST's Markdown, with the extensions of ``docs/conf.py``."""
    extensions = set(runpy.run_path(CONF)["myst_enable_extensions"])
    return create_md_parser(MdParserConfig(enable_extensions=extensions), RendererHTML).parse(text)
