"""Solutions as files, by their suffix: some come back, others are for other programs."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from liouville._basics import checksum, schema
from liouville._basics.checksum import FREE, META
from liouville._basics.errors import hinted, quoted
from liouville._basics.handlers import raise_of_handler
from liouville._basics.locks import lock_of, locked
from liouville._methods import Method
from liouville._solution.export.datasets import dataset_of, from_xarray, needed, paired, unpaired
from liouville._solution.export.formats import points_of, read_npz, save_mat, save_npz, save_xyz
from liouville._solution.export.layout import MARK, VERSION
from liouville._solution.export.reading import order_of, read
from liouville._solution.export.tables import save_csv, save_parquet
from liouville._solution.solution import Solution
from liouville._systems import System

if TYPE_CHECKING:
    import xarray

PACKAGES = {
    ".nc": ("xarray", "h5py", "h5netcdf"),
    ".zarr": ("xarray", "zarr", "google_crc32c"),
    ".mat": ("scipy.io",),
    ".parquet": ("pyarrow", "pyarrow.parquet"),
}

#: Formats of other programs that liouville does not read, with what they lack.
FOREIGN = {
    ".mat": "a MATLAB file holds arrays without the names of their axes",
    ".parquet": "a Parquet file holds only columns of numbers",
    ".csv": "a CSV file holds only columns of numbers",
    ".xyz": "an XYZ file holds only points",
}


def check(path: str | os.PathLike[str], coordinates: Sequence[str] | None = None) -> None:
    """Refuse a path that a solution could not be saved to, before a long run and not after it.

    Parameters
    ----------
    path : path
        Where the solution is to go.
    coordinates : sequence of str, optional
        Names of its coordinates, which an ``.xyz`` must be points by.

    Raises
    ------
    ValueError
        The suffix is none of ``SUFFIXES``, or the coordinates are no points.
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
    if path.suffix == ".xyz" and coordinates is not None:
        points_of(coordinates)


def save(solution: Solution, path: str | os.PathLike[str]) -> None:
    """Write a solution to a file; see :meth:`liouville.Solution.save`."""
    path = Path(path)
    check(path)
    path = path.resolve()
    lock = lock_of(path)
    if lock.is_file():
        with locked(lock, f"{str(path)!r} is the store of a run that is going on"):
            pass
    with replacing(path) as temporary:
        WRITERS[path.suffix](solution, temporary)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a path beside this one to write to, which takes its place once all is written."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.tmp")
    try:
        yield temporary
        if path.is_dir():
            shutil.rmtree(path)
        temporary.replace(path)
    except BaseException:
        shutil.rmtree(temporary) if temporary.is_dir() else temporary.unlink(missing_ok=True)
        raise


def _save_netcdf(solution: Solution, path: Path) -> None:
    write_netcdf(paired(dataset_of(solution)), path)


def _save_zarr(solution: Solution, path: Path) -> None:
    write_zarr(paired(dataset_of(solution)), path, {})


#: Writers of a solution, by the suffix of the file.
WRITERS: dict[str, Callable[[Solution, Path], None]] = {
    ".nc": _save_netcdf,
    ".zarr": _save_zarr,
    ".npz": save_npz,
    ".mat": save_mat,
    ".parquet": save_parquet,
    ".csv": save_csv,
    ".xyz": save_xyz,
}

SUFFIXES = tuple(WRITERS)


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
    arrays = {}
    for file in sorted(path.glob(f"*/{META}")):
        checksum.sign(file, FREE)
        arrays[file.parent.name] = checksum.document_in(file)
    group = checksum.group_of(checksum.document_in(path / META)[FREE], arrays)
    (path / META).write_text(checksum.signed(group, FREE), encoding="utf-8")


def _without_fill(dataset: xarray.Dataset) -> dict[str, dict[str, Any]]:
    """Return encodings without a fill value: a stored NaN is the run's own NaN."""
    numbers = (name for name, x in dataset.variables.items() if x.dtype.kind == "f")
    return {str(name): {"_FillValue": None} for name in numbers}


def load(
    path: str | os.PathLike[str], *, system: System | None = None, method: Method | None = None
) -> Solution:
    """Read a NetCDF or NumPy file or a Zarr folder that ``solution.save`` wrote.

    The file may be anybody's: no code in it is run, and only the arrays are read that it names.

    Parameters
    ----------
    path : path
        A ``.nc`` or ``.npz`` file or a ``.zarr`` folder.
    system : System, optional
        The system that was integrated, for a file holds no functions: reactions of single
        constraints, joints and bodies need it.
    method : Method, optional
        The method, which gives the states between the steps: ``load(...)(0.5)``.

    Returns
    -------
    Solution
        Equal to the saved one bit for bit; its ``system`` is None unless given.

    Raises
    ------
    FileNotFoundError
        There is nothing at this path.
    ValueError
        The suffix is unknown, what is there is no saved solution, or it is damaged: a checksum
        does not fit, an array or a part of one is missing, or an entry is not what it must be; or
        the system or the method is not the one that made it.
    ImportError
        xarray or the package for this kind of file is not installed.

    Examples
    --------
    >>> import liouville as lv
    >>> from liouville.problems import pendulum
    >>> run = lv.integrate(pendulum.system, lv.Spark(3), t=(0, 1), h=0.1, **pendulum.start)
    >>> run.save("pendulum.npz")
    >>> bool((lv.load("pendulum.npz").q == run.q).all())
    True
    """
    found = _read(Path(path))
    if system is not None and not isinstance(system, System):
        raise TypeError(f"system must be the one that was integrated, not {system!r}")
    if system is not None:
        names = tuple(system.coordinates)
        if names != found.names["coordinates"]:
            own = quoted(found.names["coordinates"])
            raise ValueError(f"system must have the coordinates {own}, not {quoted(names)}")
    if method is not None and repr(method) != found.method:
        raise ValueError(f"method must be the one that made it, {found.method}, not {method!r}")
    choice = method if found.dense_order else None
    return replace(found, system=system, choice=choice)


def ends(path: Path) -> Solution:
    """Read the same with its first and its last record only."""
    return _read(path, are_all=False)


def _read(path: Path, are_all: bool = True) -> Solution:
    check(path)
    if path.suffix in FOREIGN:
        raise ValueError(
            hinted(
                f"{str(path)!r} cannot be loaded: {FOREIGN[path.suffix]}",
                "save to .nc, .zarr or .npz what you want to load again",
            )
        )
    if not path.exists():
        raise FileNotFoundError(f"there is no file {str(path)!r}")
    where = repr(str(path))
    if path.suffix == ".npz":
        with _naming(f"{where} cannot be read as .npz"):
            layout = read_npz(path)
        _check_mark(path, layout.attributes)
        return read(layout, where)
    engine: dict[str, Any] = {"engine": "h5netcdf"}
    if path.suffix == ".zarr":
        # of Zarr 2 there is a codec that unpickles
        engine = {"engine": "zarr", "consolidated": _check_folder(path), "zarr_format": 3}
        is_whole = True
    else:
        is_whole = checksum.is_intact(path)
    with _opened(path, engine) as opened:
        _check_mark(path, opened.attrs)
        if not is_whole:
            raise ValueError(
                hinted(
                    f"{str(path)!r} lacks the checksum that solution.save writes at its end",
                    "the file is damaged, or another program wrote it again; xarray may read it",
                )
            )
        dataset = _named(opened, path)
        if not are_all:
            step = max(1, dataset.sizes["time"] - 1)
            dataset = dataset.isel(time=slice(None, None, step))
        for name, variable in dataset.variables.items():
            with _naming(f"{where} is damaged: its array {str(name)!r} cannot be read"):
                variable.load()
    return from_xarray(unpaired(dataset, where), where)


def _named(opened: xarray.Dataset, path: Path) -> xarray.Dataset:
    """Return the arrays alone that a file names, once they are there and as large as they say."""
    where = repr(str(path))
    names = order_of(opened.attrs, where)
    for name in ("time", *names):
        if name not in opened.variables:
            raise ValueError(f"{where} has no {name!r}")
    found = opened.drop_vars(set(map(str, opened.variables)) - {"time", *names})
    if "time" not in found.sizes:
        raise ValueError(f"'time' of {where} must be a row of numbers")
    if path.is_file() and found.nbytes > path.stat().st_size:
        raise ValueError(
            f"the arrays of {where} are of {found.nbytes} bytes, and it of {path.stat().st_size}"
        )
    return found


def _check_folder(path: Path) -> bool:
    """Find damage to a Zarr folder, and folders of others, before any array is read.

    Returns whether its group describes the arrays, which a run that goes on lengthens all at once.
    """
    described = path / META
    if not described.is_file():
        raise ValueError(f"{str(path)!r} cannot be read as .zarr: it holds no {META}")
    attributes = checksum.document_in(described).get(FREE)
    _check_mark(path, attributes if isinstance(attributes, dict) else {})
    group = checksum.verified(described, FREE)
    arrays = checksum.arrays_of(group, repr(str(path)))
    checksum.check_arrays(path, order_of(group[FREE], repr(str(path))), arrays)
    return bool(arrays)


def _check_mark(path: Path, attributes: Mapping[str, Any]) -> None:
    found = attributes.get(MARK)
    if found is None:
        sentence = f"{str(path)!r} holds no liouville solution"
        raise ValueError(hinted(sentence, "liouville.load reads what solution.save wrote"))
    found = schema.entry(attributes, MARK, schema.integers(0), repr(str(path)))
    if found != VERSION:
        sentence = f"{str(path)!r} has layout {found} of a solution, this liouville reads {VERSION}"
        raise ValueError(hinted(sentence, "read it with the liouville that wrote it"))


def _opened(path: Path, engine: Mapping[str, Any]) -> xarray.Dataset:
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
        raise_of_handler(error)
        why = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{sentence}: {why}") from error
