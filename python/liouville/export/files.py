"""Solutions as files: NetCDF and Zarr both ways, CSV for reading elsewhere."""

from __future__ import annotations

import json
import os
import shutil
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville import checksum
from liouville.checksum import FREE, META
from liouville.errors import hinted
from liouville.export.datasets import (
    MARK,
    VERSION,
    from_xarray,
    needed,
    paired,
    place_of,
    to_xarray,
    unpaired,
)
from liouville.locks import lock_of, locked
from liouville.solution import Array, Solution

if TYPE_CHECKING:
    import xarray

SUFFIXES = (".nc", ".zarr", ".csv")

PACKAGES = {".nc": ("xarray", "h5py", "h5netcdf"), ".zarr": ("xarray", "zarr", "google_crc32c")}


def check(path: str | os.PathLike[str]) -> None:
    """Refuse a path that a solution could not be saved to, before a long run and not after it.

    Raises
    ------
    ValueError
        The suffix is none of ``SUFFIXES``.
    FileNotFoundError
        The folder does not exist.
    ImportError
        A package that this kind of file needs is not installed.
    """
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise ValueError(
            f"cannot tell the kind of file from the suffix of {str(path)!r}\n"
            f"hint: use one of {', '.join(SUFFIXES)}"
        )
    if not path.absolute().parent.is_dir():
        raise FileNotFoundError(f"the folder of {str(path)!r} does not exist\nhint: create it")
    for package in PACKAGES.get(path.suffix, ()):
        needed(package)


def save(solution: Solution, path: str | os.PathLike[str]) -> None:
    """Write a solution to a file, replacing what was there once all is written.

    Parameters
    ----------
    solution : Solution
        What to write.
    path : path
        Where: ``.nc`` writes NetCDF 4, ``.zarr`` a Zarr 3 folder; ``.csv`` one row a kept step
        with all digits, but without names, statistics or status, so it cannot be loaded back.

    Raises
    ------
    ValueError, FileNotFoundError, ImportError
        As :func:`check` does; or an ensemble is to go to a ``.csv``.
    BlockingIOError
        A stored run is going on there.
    """
    path = Path(path)
    check(path)
    path = path.resolve()
    lock = lock_of(path)
    if lock.is_file():
        with locked(lock, f"{str(path)!r} is the store of a run that is going on"):
            pass
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.tmp")
    try:
        if path.suffix == ".csv":
            _save_csv(solution, temporary)
        elif path.suffix == ".nc":
            write_netcdf(paired(to_xarray(solution)), temporary)
        else:
            write_zarr(paired(to_xarray(solution)), temporary, {})
        if path.is_dir():
            shutil.rmtree(path)
        temporary.replace(path)
    except BaseException:
        shutil.rmtree(temporary) if temporary.is_dir() else temporary.unlink(missing_ok=True)
        raise


def write_netcdf(dataset: xarray.Dataset, path: Path) -> None:
    """Write a NetCDF file that ends in its checksum."""
    dataset.to_netcdf(path, engine="h5netcdf", encoding=_without_fill(dataset))
    checksum.append_to(path)


def write_zarr(dataset: xarray.Dataset, path: Path, chunks: Mapping[str, int]) -> None:
    """Write a Zarr folder with checksums; arrays along some axes have uncompressed chunks."""
    codecs = needed("zarr.codecs")
    compressed = [codecs.ZstdCodec(), codecs.Crc32cCodec()]
    encoding = _without_fill(dataset)
    for name, variable in dataset.variables.items():
        own = encoding.setdefault(str(name), {})
        own["compressors"] = compressed
        if variable.dims[0] in chunks:
            rest = (max(1, size) for size in variable.shape[1:])
            own["chunks"] = (chunks[str(variable.dims[0])], *rest)
            own["compressors"] = compressed[1:]
    dataset.to_zarr(
        path, mode="w", encoding=encoding, zarr_format=3, consolidated=False,
        write_empty_chunks=True,  # one that is missing is damage
    )  # fmt: skip
    for file in (path / META, *path.glob(f"*/{META}")):
        checksum.sign(file, FREE)


def _without_fill(dataset: xarray.Dataset) -> dict[str, dict[str, Any]]:
    """Return encodings without a fill value: a stored NaN is the run's own NaN."""
    numbers = (name for name, x in dataset.variables.items() if x.dtype.kind == "f")
    return {str(name): {"_FillValue": None} for name in numbers}


def load(path: str | os.PathLike[str]) -> Solution:
    """Read a solution that :func:`save` wrote to a NetCDF file or a Zarr folder.

    Parameters
    ----------
    path : path
        A ``.nc`` file or a ``.zarr`` folder.

    Returns
    -------
    Solution
        Equal to the saved one bit for bit; its ``system`` is None, for a file holds no functions.

    Raises
    ------
    FileNotFoundError
        There is nothing at this path.
    ValueError
        The suffix is unknown, what is there is no saved solution, or it is damaged: a checksum
        does not fit, or an array or a part of one is missing.
    ImportError
        xarray or the package for this kind of file is not installed.
    """
    return _read(Path(path))


def ends(path: Path) -> Solution:
    """Read the same with its first and its last record only."""
    return _read(path, are_all=False)


def _read(path: Path, are_all: bool = True) -> Solution:
    check(path)
    if path.suffix == ".csv":
        raise ValueError(
            f"{str(path)!r} cannot be loaded: a CSV file holds only columns of numbers\n"
            "hint: save to .nc or .zarr what you want to load again"
        )
    if not path.exists():
        raise FileNotFoundError(f"there is no file {str(path)!r}")
    is_whole = _check_folder(path) if path.suffix == ".zarr" else checksum.is_intact(path)
    with _opened(path) as opened:
        _check_mark(path, opened.attrs)
        if not is_whole:
            raise ValueError(
                hinted(
                    f"{str(path)!r} lacks the checksum that solution.save writes at its end",
                    "the file is damaged, or another program wrote it again; xarray may read it",
                )
            )
        step = 1 if are_all else max(1, opened.sizes["time"] - 1)
        dataset = opened.isel(time=slice(None, None, step))
        for name, variable in dataset.variables.items():
            with _naming(f"{str(path)!r} is damaged: its array {str(name)!r} cannot be read"):
                variable.load()
    return from_xarray(unpaired(dataset))


def _check_folder(path: Path) -> bool:
    """Find damage to a Zarr folder, and folders of others, before any array is read."""
    described = path / META
    if not described.is_file():
        raise ValueError(f"{str(path)!r} cannot be read as .zarr: it holds no {META}")
    attributes = checksum.document_in(described).get(FREE)
    _check_mark(path, attributes if isinstance(attributes, dict) else {})
    group = checksum.verified(described, FREE)
    checksum.check_arrays(path, json.loads(group[FREE]["order"]))
    return True


def _check_mark(path: Path, attributes: Mapping[str, Any]) -> None:
    found = attributes.get(MARK)
    if found is None:
        sentence = f"{str(path)!r} holds no liouville solution"
        raise ValueError(hinted(sentence, "liouville.load reads what solution.save wrote"))
    if found != VERSION:
        sentence = f"{str(path)!r} has layout {found} of a solution, this liouville reads {VERSION}"
        raise ValueError(hinted(sentence, "read it with the liouville that wrote it"))


def _opened(path: Path) -> xarray.Dataset:
    engine: dict[str, Any] = {"engine": "h5netcdf"}
    if path.suffix == ".zarr":
        # of Zarr 2 there is a codec that unpickles
        engine = {"engine": "zarr", "consolidated": False, "zarr_format": 3}
    with _naming(f"{str(path)!r} cannot be read as {path.suffix}"):
        opened: xarray.Dataset = needed("xarray").open_dataset(
            path, decode_times=False, mask_and_scale=False,
            create_default_indexes=False,  # of all times, in memory
            **engine,
        )  # fmt: skip
    return opened


@contextmanager
def _naming(sentence: str) -> Iterator[None]:
    """Turn any error of a library that reads a file into a sentence that names the file."""
    try:
        yield
    except (ImportError, MemoryError):
        raise
    except Exception as error:
        why = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{sentence}: {why}") from error


def _save_csv(solution: Solution, path: Path) -> None:
    if solution.members is not None:
        raise ValueError("a table has no room for an ensemble\nhint: save it as .nc or .zarr")
    names = solution.names
    columns = {"t": solution.t}
    for name, values in solution.states.items():
        kind = "unknowns" if name == "z" and "unknowns" in names else "coordinates"
        labels = names["constraints" if name == "lam" else kind]
        labels = labels or tuple(str(i) for i in range(values.shape[1]))
        columns |= {f"{name}[{label}]": values[:, i] for i, label in enumerate(labels)}
    columns |= solution.invariants | solution.balance
    for name, values in solution.residuals.items():
        labels = names["constraints"][place_of(name, values, names["constraints"])]
        columns |= {f"{name}[{label}]": values[:, i] for i, label in enumerate(labels)}
    for name, values in solution.observed.items():
        if values.ndim == 1:
            columns[name] = values
        else:
            columns |= {f"{name}[{i}]": values[:, i] for i in range(values.shape[1])}
    columns = {label: part for name, x in columns.items() for label, part in _real(name, x)}
    header = ",".join(f'"{name}"' if "," in name else name for name in columns)
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.17g")


def _real(name: str, values: Array) -> list[tuple[str, Array]]:
    """Give a column as it is, or real and imaginary parts of a complex one."""
    if not np.iscomplexobj(values):
        return [(name, values)]
    return [(f"re {name}", values.real), (f"im {name}", values.imag)]
