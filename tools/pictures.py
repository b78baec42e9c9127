"""Draw the pictures of docs/copy.md: each program's last figure, under the name that follows it.

Run as ``python tools/pictures.py``; with names of pictures, these alone.
"""

import re
import sys
from pathlib import Path

import matplotlib as mpl
from PIL import Image

from liouville import plot

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "copy.md"
PROGRAM = re.compile(r"^```python\n(.*?)^```\n(?:\n!\[[^\]]*\]\((_static/\S+)\))?", re.M | re.S)


def main(*wanted: str) -> None:
    """Run the programs of the page in one namespace, as they stand there."""
    mpl.use("agg")
    names: dict[str, object] = {}
    for program, picture in PROGRAM.findall(PAGE.read_text("utf-8")):
        if picture and wanted and Path(picture).stem not in wanted:
            continue
        *lines, last = program.rstrip().splitlines()
        exec("\n".join(lines), names)  # the page of this repository
        found = eval(last, names) if picture else exec(last, names)
        if picture:
            path = PAGE.parent / picture
            path.parent.mkdir(parents=True, exist_ok=True)
            figure = getattr(found, "figure", found)
            with mpl.rc_context(plot.STYLE):
                figure.set_size_inches(4.8, 2.7)
                figure.savefig(path, dpi=100)
            Image.open(path).convert("RGB").quantize(48).save(path, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
