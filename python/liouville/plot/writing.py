"""Films as files; imported when one is written, as it imports Pillow."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from liouville._basics.errors import hinted

Picture = NDArray[np.uint8]
Pictures = Callable[[Sequence[int] | None], Iterator[Picture]]

#: Bits of each colour that a palette distinguishes.
BITS = 5


def write(pictures: Pictures, count: int, path: Path, fps: int) -> None:
    """Write pictures of shape (height, width, 4) to a file, by its suffix."""
    if path.suffix == ".mp4":
        _write_mp4(pictures(None), path, fps)
    else:
        _write_gif(pictures, count, path, fps)


def _write_gif(pictures: Pictures, count: int, path: Path, fps: int) -> None:
    """Write frames with one palette: to find one for each frame takes most of the time.

    It has the commonest colours of one frame a second and of the last.
    """
    seen = (_colours(picture) for picture in pictures([*range(0, count, fps), count - 1]))
    often = sum(np.bincount(own.ravel(), minlength=8**BITS) for own in seen)
    commonest = np.argsort(often)[::-1][:256]
    palette = Image.new("P", (1, 1))
    palette.putpalette(_of_colours(commonest).tobytes())
    square = Image.fromarray(_of_colours(np.arange(8**BITS)).reshape(2**BITS, -1, 3))
    table = np.asarray(square.quantize(palette=palette, dither=Image.Dither.NONE)).ravel()
    frames = [Image.fromarray(table[_colours(picture)]) for picture in pictures(None)]
    for frame in frames:
        frame.putpalette(_of_colours(commonest).tobytes())
    first, *others = frames
    first.save(
        path,
        save_all=True,
        append_images=others,
        duration=int(1000 / fps),
        loop=0,
        optimize=False,  # all have one palette already
    )


def _colours(picture: Picture) -> NDArray[np.uint32]:
    """Return the colour of each pixel as a number of 3 BITS bits."""
    whole = np.ascontiguousarray(picture).view("<u4")[..., 0]
    mask, rest = 2**BITS - 1, 8 - BITS
    red = (whole >> rest) & mask
    green = (whole >> (2 * rest)) & (mask << BITS)
    blue = (whole >> (3 * rest)) & (mask << 2 * BITS)
    found: NDArray[np.uint32] = red | green | blue
    return found


def _of_colours(numbers: NDArray[np.integer[Any]]) -> Picture:
    """Return red, green and blue of these numbers, shape (k, 3)."""
    mask = 2**BITS - 1
    parts = [(numbers >> (k * BITS)) & mask for k in range(3)]
    found: Picture = (np.stack(parts, axis=1) * 255 // mask).astype(np.uint8)
    return found


def _write_mp4(pictures: Iterator[Picture], path: Path, fps: int) -> None:
    """Hand frames to ffmpeg."""
    first = next(pictures)
    height, width, _ = first.shape
    given = ["-f", "rawvideo", "-pix_fmt", "rgba", "-s", f"{width}x{height}", "-r", str(fps)]
    even = "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white"  # as the codec wants it
    wanted = ["-an", "-vf", even, "-pix_fmt", "yuv420p", str(path)]
    command = ["ffmpeg", "-y", "-loglevel", "error", *given, "-i", "-", *wanted]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        assert run.stdin is not None
        assert run.stderr is not None
        try:
            for picture in chain([first], pictures):
                run.stdin.write(picture.tobytes())
            run.stdin.close()
        except BrokenPipeError:  # it says why below
            pass
        said = run.stderr.read().decode(errors="replace").strip()
    if run.returncode:
        last = said.splitlines()[-1] if said else f"it ended with {run.returncode}"
        sentence = f"ffmpeg could not write {str(path)!r}: {last}"
        raise RuntimeError(hinted(sentence, "write a .gif, or a page: .html"))
