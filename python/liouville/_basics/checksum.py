"""Checksums: a byte that changed on the disk is found when its file is read.

A file of our own ends in a line with the checksum of all before it. A JSON document has its
checksum among its own entries, so that it stays one; of a Zarr folder that covers what describes
the arrays, and the codec crc32c covers their chunks.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from liouville._basics import schema

#: The entry of a JSON document with the checksum of all others.
KEY = "crc32"

#: The file that describes a Zarr group or array, and the entry of it that is free.
META, FREE = "zarr.json", "attributes"

#: The entry of a group with what describes its arrays, so that all of them are seen as of one time.
ARRAYS = "consolidated_metadata"

#: What the sizes of an array and of its chunks are.
SHAPE, CHUNK = schema.lists(schema.integers(0)), schema.lists(schema.integers(1))

#: An array has at most so many axes.
AXES = 8

#: How the last line of a file begins, and how long it is.
LINE = b"\nliouville crc32 "
SIZE = len(LINE) + 9

#: Bytes that are read at a time.
BLOCK = 1 << 20

Document = dict[str, Any]


def line_of(data: Any, crc: int = 0) -> bytes:
    """Return the last line of a file that holds these bytes, after others of this checksum."""
    return LINE + b"%08x\n" % zlib.crc32(data, crc)


def append_to(file: Path) -> None:
    """Append the line to a file."""
    with file.open("r+b") as opened:
        crc, _ = _crc_of(opened, os.fstat(opened.fileno()).st_size)
        opened.seek(0, os.SEEK_END)
        opened.write(line_of(b"", crc))


def is_intact(file: Path) -> bool:
    """Return whether a file ends in its checksum; ValueError where it ends in another."""
    with file.open("rb") as opened:
        crc, line = _crc_of(opened, max(0, os.fstat(opened.fileno()).st_size - SIZE))
    if not line.startswith(LINE):
        return False
    if line != line_of(b"", crc):
        raise ValueError(damaged(file))
    return True


def damaged(file: Path) -> str:
    """Say that a file changed since it was written."""
    return f"{str(file)!r} is damaged: it is not what its checksum says"


def signed(document: Document, place: str = "") -> str:
    """Return a JSON document with its checksum, at the top or within one of its entries."""
    document = json.loads(json.dumps(document))
    holder = document[place] if place else document
    holder.pop(KEY, None)
    holder[KEY] = _crc_of_document(document)
    return json.dumps(document, indent=2) + "\n"


def sign(file: Path, place: str = "") -> None:
    """Add its checksum to a JSON document."""
    file.write_text(signed(document_in(file), place), encoding="utf-8")


def document_in(file: Path) -> Document:
    """Read a JSON document, whose checksum is not looked at."""
    try:
        found = json.loads(file.read_bytes().decode())
    except FileNotFoundError as error:
        raise ValueError(f"{str(file)!r} is missing") from error
    except (ValueError, RecursionError) as error:  # also where it is no text
        raise ValueError(f"{str(file)!r} is damaged: it holds no JSON ({error})") from error
    if not isinstance(found, dict):
        raise ValueError(f"{str(file)!r} is damaged: it holds a {type(found).__name__}")
    return found


def verified(file: Path, place: str = "") -> Document:
    """Read a JSON document, less its checksum; ValueError where that is another."""
    document = document_in(file)
    holder = document.get(place) if place else document
    if not isinstance(holder, dict) or holder.pop(KEY, None) != _crc_of_document(document):
        raise ValueError(damaged(file))
    return document


def group_of(attributes: Document, arrays: Document) -> Document:
    """Return the description of a Zarr group and its arrays."""
    document: Document = {FREE: attributes, "zarr_format": 3, "node_type": "group"}
    if arrays:
        document[ARRAYS] = {"kind": "inline", "must_understand": False, "metadata": arrays}
    return document


def arrays_of(group: Document, where: str) -> Document:
    """Return descriptions of the arrays of a group, none where an earlier release wrote it."""
    if ARRAYS not in group:
        return {}
    entry = schema.entry(group, ARRAYS, schema.MAPPING, where)
    found: Document = schema.entry(entry, "metadata", schema.mappings(schema.MAPPING), where)
    for name, array in found.items():
        _check_name(name, where)
        if (array.get("zarr_format"), array.get("node_type")) != (3, "array"):
            raise ValueError(f"{name!r} of {where} must be an array of Zarr 3")
    return found


def _check_name(name: str, where: str) -> None:
    if not name.isprintable() or name in ("", ".", "..") or set(name) & {"/", "\\"}:
        raise ValueError(f"an array of {where} must have a name that is no path, not {name!r}")


def check_arrays(folder: Path, names: Sequence[str], described: Document) -> None:
    """Refuse a Zarr folder whose arrays are not all there, or are described otherwise."""
    for name in names:
        _check_name(name, repr(str(folder)))
        file = folder / name / META
        array = verified(file, FREE)
        for chunk in _chunks_of(described.get(name, array), repr(str(file))):
            part = folder.joinpath(name, "c", *map(str, chunk))
            if not part.is_file():
                raise ValueError(f"{str(part)!r} is missing, and with it a part of {name!r}")


def _chunks_of(array: Document, where: str) -> Iterator[tuple[int, ...]]:
    shape = schema.entry(array, "shape", SHAPE, where)
    grid = schema.entry(array, "chunk_grid", schema.MAPPING, where)
    configuration = schema.entry(grid, "configuration", schema.MAPPING, where)
    chunk = schema.entry(configuration, "chunk_shape", CHUNK, where)
    if len(shape) != len(chunk) or len(shape) > AXES:
        sizes = f"{len(chunk)} sizes for {len(shape)} axes"
        raise ValueError(f"'chunk_shape' of {where} must be a size for each axis, not {sizes}")
    return _places([-(-n // k) for n, k in zip(shape, chunk, strict=True)])


def _places(counts: list[int]) -> Iterator[tuple[int, ...]]:
    """Give the places of a grid; no memory is taken for those that are not asked for."""
    if not counts:
        yield ()
        return
    first, *rest = counts
    for place in range(first):
        for others in _places(rest):
            yield (place, *others)


def _crc_of(opened: Any, left: int) -> tuple[int, bytes]:
    """Return the checksum of the next bytes of a file, and the rest of it."""
    crc = 0
    while left and (block := opened.read(min(left, BLOCK))):
        crc = zlib.crc32(block, crc)
        left -= len(block)
    return crc, opened.read()


def _crc_of_document(document: Document) -> str:
    """Return the checksum of a document's content, independent of its layout."""
    try:
        text = json.dumps(document, sort_keys=True)
    except RecursionError:  # as deep as can just be read
        return ""
    return f"{zlib.crc32(text.encode()):08x}"
