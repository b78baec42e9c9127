"""GIF files; imported when one is written, as matplotlib is."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter
from matplotlib.figure import Figure
from PIL import Image


class Writer(AbstractMovieWriter):
    """Write frames with one palette: to find one for each frame takes most of the time."""

    def setup(self, fig: Figure, outfile: str | Path, dpi: float | None = None) -> None:
        """Begin a file."""
        super().setup(fig, outfile, dpi)
        self.frames: list[Image.Image] = []

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        """Take the figure as it is now."""
        buffer = io.BytesIO()
        self.fig.savefig(buffer, **savefig_kwargs, format="rgba", dpi=self.dpi)
        frame = Image.frombytes("RGBA", self.frame_size, buffer.getvalue())
        self.frames.append(frame.convert("RGB"))

    def finish(self) -> None:
        """Write the file, with the colours of one frame a second and of the last."""
        seen = [*self.frames[:: self.fps], self.frames[-1]]
        palette = Image.fromarray(np.concatenate([np.asarray(frame) for frame in seen])).quantize()
        first, *others = (
            frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in self.frames
        )
        duration = int(1000 / self.fps)
        first.save(self.outfile, save_all=True, append_images=others, duration=duration, loop=0)
