"""Solutions as tables for other programs: CSV and Parquet, with a row for each kept step."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from liouville._solution.export.datasets import needed
from liouville._solution.export.layout import laid_out, place_of, positions, reactions
from liouville._solution.export.touching import columns_of
from liouville._solution.solution import Array, Solution
from liouville._solution.states import unit_of

if TYPE_CHECKING:
    import pandas


def save_csv(solution: Solution, path: Path) -> None:
    """Write a CSV file, one row a kept step with all digits."""
    columns = table(solution)
    heads = [_headed(solution, name) for name in columns]
    header = ",".join(f'"{name}"' if "," in name else name for name in heads)
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.17g")


def _headed(solution: Solution, column: str) -> str:
    """Return the name of a column with its unit, if that is given."""
    name, _, label = column.partition("[")
    unit = unit_of(solution, name, (label[:-1],) if label else ())
    return f"{column} ({unit})" if unit else column


def save_parquet(solution: Solution, path: Path) -> None:
    """Write a Parquet file, with how the run went under the key "liouville" of its metadata."""
    arrow, parquet = needed("pyarrow"), needed("pyarrow.parquet")
    facts = json.dumps({name: x for name, x in laid_out(solution).attributes.items()})
    made = arrow.table({name: np.ascontiguousarray(x) for name, x in table(solution).items()})
    parquet.write_table(made.replace_schema_metadata({"liouville": facts}), path)


def to_dataframe(solution: Solution) -> pandas.DataFrame:
    """Return a solution as a DataFrame; see :meth:`liouville.Solution.to_dataframe`."""
    frame: pandas.DataFrame = needed("pandas").DataFrame(table(solution))
    return frame


def table(solution: Solution) -> dict[str, Array]:
    """Return columns of equal length; of an ensemble one member after another, with its number."""
    members, names = solution.members, solution.names
    columns: dict[str, Array] = {}
    if members is None:
        columns["t"] = solution.t
    else:
        columns["member"] = np.repeat(np.arange(members), len(solution.t))
        columns["t"] = np.tile(solution.t, members)

    def add(name: str, values: Array, labels: tuple[str, ...] | None = None) -> None:
        whole = values if members is None else _after_one_another(values)
        if whole.ndim == 1:
            columns.update(_real(name, whole))
            return
        labels = labels or tuple(str(i) for i in range(whole.shape[1]))
        for i, label in enumerate(labels):
            columns.update(_real(f"{name}[{label}]", whole[:, i]))

    for name, values in solution.states.items():
        kind = "unknowns" if name == "z" and "unknowns" in names else "coordinates"
        add(name, values, names["constraints" if name == "lam" else kind])
    for name, (values, _) in positions(solution).items():
        add(name, values)
    for name, values in (solution.invariants | solution.balance).items():
        add(name, values)
    for name, values in solution.residuals.items():
        add(name, values, names["constraints"][place_of(name, values, names["constraints"])])
    forces = reactions(solution)
    if forces is not None:
        add("reaction", forces, names["coordinates"])
    for name, values in solution.observed.items():
        add(name, values)
    for name, values, _ in columns_of(solution.contacts):
        add(name, values, tuple(solution.contacts))
    return columns


def _after_one_another(values: Array) -> Array:
    """Give values of shape (k, P, ...) as (P k, ...), one member after another."""
    count, members, *rest = values.shape
    return np.moveaxis(values, 1, 0).reshape(count * members, *rest)


def _real(name: str, values: Array) -> dict[str, Any]:
    """Give a column as it is, or real and imaginary parts of a complex one."""
    if not np.iscomplexobj(values):
        return {name: values}
    return {f"re {name}": values.real, f"im {name}": values.imag}
