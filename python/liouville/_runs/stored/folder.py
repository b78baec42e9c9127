"""The files of a stored run: arrays that grow by whole chunks, and files that appear at once."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from liouville._basics import checksum, schema
from liouville._basics.checksum import FREE, META

#: Where job and state are, beside the arrays.
CHECKPOINT = "checkpoint"

#: The types of arrays that grow, as they are on the disk.
KINDS = {"float64": "<f8", "int64": "<i8"}

#: Zeros to fill a chunk with.
ZEROS = bytes(1 << 20)


class Folder:
    """A Zarr folder whose arrays grow along their first axes.

    Attributes
    ----------
    path : Path
        Where it is.
    arrays : dict of str to dict
        The description of each array that grows, as Zarr has it.
    attributes : dict
        Those of the whole.
    """

    def __init__(self, path: Path, axes: Mapping[str, int]) -> None:
        self.path = path
        self._new: set[Path] = set()
        group = checksum.verified(path / META, FREE)
        self.attributes: dict[str, Any] = group[FREE]
        self._all = checksum.arrays_of(group, repr(str(path)))
        self.arrays = {
            name: meta for name, meta in self._all.items() if _first_axis(meta, path / name) in axes
        }

    def clear(self) -> None:
        """Remove what was about to appear when a run was cut off."""
        for file in (self.path / CHECKPOINT).glob("*.tmp"):
            file.unlink()

    def put(self, name: str, place: int, values: np.ndarray) -> None:
        """Write chunk `place` of an array, which `values` may fill in part."""
        meta = self.arrays.get(name)
        if meta is None:
            raise ValueError(f"{str(self.path / name / META)!r} is missing")
        shape = meta["chunk_grid"]["configuration"]["chunk_shape"]
        if not values.size:
            return
        kind = KINDS[meta["data_type"]]
        assert values.shape[1:] == tuple(shape[1:])
        rest = ["0"] * (len(shape) - 1)
        data = np.ascontiguousarray(values, dtype=kind).reshape(-1).view(np.uint8)
        size = 8 * int(np.prod(shape))
        file = self.path.joinpath(name, "c", str(place), *rest)
        self.write(file, data, _crc_of(data, size).to_bytes(4, "little"), size)

    def show(self, lengths: Mapping[str, int], attributes: Mapping[str, Any]) -> None:
        """Set how long the arrays are along each axis, and attributes of the whole.

        Readers see both at once, by the one file that has them.
        """
        for name, meta in self.arrays.items():
            length = lengths[meta["dimension_names"][0]]
            if meta["shape"][0] != length:
                meta["shape"][0] = length
                self.write(self.path / name / META, checksum.signed(meta, FREE).encode())
        self.attributes |= attributes
        group = checksum.group_of(self.attributes, self._all)
        self.write(self.path / META, checksum.signed(group, FREE).encode())

    def write(self, file: Path, data: Any, end: bytes = b"", size: int = 0) -> None:
        """Write a file that is there as a whole or as it was; its end stands after `size` bytes."""
        temporary = self.path / CHECKPOINT / f"{os.getpid()}-{len(self._new)}.tmp"
        with temporary.open("wb") as opened:
            opened.write(data)
            opened.seek(max(size, opened.tell()))
            opened.write(end)
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary.replace(file)
        self._new |= {file, file.parent}

    def commit(self, file: str, data: bytes) -> None:
        """Write a file of the checkpoint once everything before it is on the disk."""
        self.sync()
        self.write(self.path / CHECKPOINT / file, data, checksum.line_of(data))
        self.sync()

    def sync(self) -> None:
        """Wait until everything written is on the disk."""
        for path in self._new:
            if os.name == "nt" and path.is_dir():
                continue  # which syncs no folders
            descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        self._new.clear()


def attributes_of(path: Path) -> dict[str, Any]:
    """Return the attributes of a group."""
    found: dict[str, Any] = checksum.verified(path / META, FREE)[FREE]
    return found


def _first_axis(meta: Mapping[str, Any], path: Path) -> str | None:
    """Return the name of an array's first axis."""
    names = schema.entry(meta, "dimension_names", schema.lists(schema.TEXT), repr(str(path)))
    return names[0] if names else None


def _crc_of(data: np.ndarray, size: int) -> int:
    """Return the checksum of a chunk of so many bytes, zeros after its data."""
    import google_crc32c  # of the extra io

    crc: int = google_crc32c.value(data)
    for left in range(size - data.size, 0, -len(ZEROS)):
        crc = google_crc32c.extend(crc, ZEROS[:left])
    return crc
