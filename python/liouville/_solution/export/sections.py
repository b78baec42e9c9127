"""Sections as labelled datasets of xarray, and as files for other programs."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._basics.errors import hinted
from liouville._solution.export.datasets import needed
from liouville._solution.export.files import check, replacing, write_netcdf
from liouville._solution.export.layout import SLASH

if TYPE_CHECKING:
    import xarray

    from liouville._studies.section import Section

#: The dimension of the points.
CROSSING = "crossing"


def section_to_xarray(section: Section) -> xarray.Dataset:
    """Give a section as a labelled dataset, its points along the dimension ``crossing``.

    Its variables are ``x`` and, of each other event, ``event_t_NAME``, ``event_x_NAME`` and
    ``event_member_NAME``; times and members are coordinates of the points, and how it was made is
    in the attributes.

    Raises
    ------
    ImportError
        xarray is not installed.
    """
    normal, offset = section.plane
    variables: dict[str, Any] = {"x": ((CROSSING, "coordinate"), section.x)}
    for name, points in section.events.items():
        label = name.replace("/", SLASH)
        axis = f"event_axis_{label}"
        variables[f"event_t_{label}"] = (axis, points.t)
        variables[f"event_x_{label}"] = ((axis, "coordinate"), points.states["x"])
        variables[f"event_member_{label}"] = (axis, points.states["member"])
    failures = {k: [x.step, x.t, x.message] for k, x in section.failures.items()}
    attributes = {
        "status": section.status,
        "method": section.method,
        "members": section.members,
        "normal": normal,
        "offset": offset,
        "period": np.nan if section.period is None else section.period,
        "direction": section.direction,
        "failures": json.dumps(failures),
        "endings": json.dumps(section.endings),
    }
    places = {"t": (CROSSING, section.t), "member": (CROSSING, section.member)}
    labels = {"coordinate": np.array(section.names, dtype=object)}
    made: xarray.Dataset = needed("xarray").Dataset(variables, places | labels, attributes)
    return made


def save_section(section: Section, path: str | os.PathLike[str]) -> None:
    """Write a section for other programs, replacing what was there once all is written.

    Parameters
    ----------
    section : Section
        What to write.
    path : path
        Where: ``.nc`` writes the dataset of :func:`section_to_xarray` as NetCDF 4, ``.csv`` a row
        for each point, with its member, its time and its coordinates to all digits.

    Raises
    ------
    ValueError, FileNotFoundError, ImportError
        The suffix is another, the folder does not exist, or a package is not installed.
    """
    path = Path(path)
    if path.suffix not in WRITERS:
        sentence = f"a section is not saved to {str(path)!r}"
        raise ValueError(hinted(sentence, f"use one of {', '.join(WRITERS)}"))
    check(path)
    with replacing(path.resolve()) as temporary:
        WRITERS[path.suffix](section, temporary)


def _save_netcdf(section: Section, path: Path) -> None:
    write_netcdf(section_to_xarray(section), path)


def _save_csv(section: Section, path: Path) -> None:
    rows = np.column_stack([section.member, section.t, section.x])
    header = ",".join(["member", "t", *(f"x[{name}]" for name in section.names)])
    kinds = ["%d", *["%.17g"] * (rows.shape[1] - 1)]
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt=kinds)


#: Writers of a section, by the suffix of the file.
WRITERS: dict[str, Callable[[Section, Path], None]] = {".nc": _save_netcdf, ".csv": _save_csv}
