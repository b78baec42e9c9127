"""The border between Python and the core, whole."""

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal, final

import numpy as np
from numpy.typing import NDArray

_Pattern = tuple[int, int, NDArray[np.int64], NDArray[np.int64]]
_Error = dict[str, Any]
_Term = tuple[int, int, float, "Rows"]

__all__ = [
    "OPERATIONS",
    "VERSION",
    "Column",
    "FieldPullback",
    "Hamiltonian",
    "Mechanical",
    "MembersPullback",
    "Operator",
    "Plane",
    "Pullback",
    "Rows",
    "Run",
    "SecondOrder",
    "SemiExplicit",
    "SemiExplicitSensitivity",
    "Sensitivity",
    "Separable",
    "Split",
    "SplitBeginning",
    "Tape",
    "WaveDerivative",
    "WaveRecord",
    "chebyshev_degree",
    "compositions",
    "driven_cost",
    "first_dependent",
    "independent_rows",
    "ladder",
    "listing",
    "lobatto_pair",
    "magnus_cost",
    "members_pullback",
    "multipliers",
    "processor_degree",
    "project",
    "project_linear",
    "pullback",
    "run",
    "run_each",
    "spark_tableau",
    "split_beginning",
    "split_program",
    "stability",
    "violation",
]

OPERATIONS: dict[str, int]
VERSION: str

@final
class Column:
    def __new__(cls, numbers: NDArray[np.float64]) -> Column: ...

@final
class Tape:
    def __new__(
        cls,
        inputs: list[int],
        outputs: int,
        lines: NDArray[np.int64],
        values: NDArray[np.float64],
        columns: list[Column] = ...,
    ) -> Tape: ...
    @staticmethod
    def unpacked(
        inputs: list[int],
        outputs: int,
        program: bytes,
        terms: tuple[NDArray[np.float64], list[_Term], list[_Term]] | None = None,
        columns: list[Column] = ...,
    ) -> Tape: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __len__(self) -> int: ...
    @property
    def inputs(self) -> list[int]: ...
    @property
    def outputs(self) -> int: ...
    def roundings(
        self, params: NDArray[np.float64], args: list[NDArray[np.float64]]
    ) -> NDArray[np.float64]: ...
    def map(
        self, params: NDArray[np.float64], args: list[NDArray[np.float64]]
    ) -> NDArray[np.float64]: ...
    def with_columns(self, replaced: list[tuple[Column, Column]]) -> Tape: ...
    def with_terms(
        self,
        constant: NDArray[np.float64],
        products: list[_Term],
        forms: list[_Term],
    ) -> Tape: ...

@final
class Rows:
    def __new__(
        cls,
        rows: int,
        cols: int,
        row: NDArray[np.int64],
        col: NDArray[np.int64],
        values: NDArray[np.float64],
    ) -> Rows: ...

@final
class Mechanical:
    def __new__(
        cls,
        n: int,
        m: int,
        is_linear: bool,
        tapes: dict[str, Tape],
        patterns: dict[str, _Pattern],
        left_out: list[int] = ...,
    ) -> Mechanical: ...

@final
class Pullback:
    @property
    def run(self) -> Run: ...
    def forget(self) -> None: ...
    def give(self, rows: NDArray[np.float64]) -> None: ...
    def give_events(self, rows: list[NDArray[np.float64]]) -> None: ...
    def follow(
        self,
        saved: NDArray[np.float64] | None,
        last: int,
        kept: NDArray[np.int64],
        rows: NDArray[np.float64],
    ) -> _Error | None: ...
    def end(
        self, row: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float] | _Error: ...

@final
class MembersPullback:
    most: ClassVar[int]
    def stop(self) -> None: ...
    def pull(
        self,
        members: Sequence[int],
        last: int,
        kept: NDArray[np.int64],
        rows: NDArray[np.float64],
    ) -> (
        tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
        | None
    ): ...

@final
class Sensitivity:
    def __new__(
        cls, problem: Mechanical, tapes: dict[str, Tape], patterns: dict[str, _Pattern]
    ) -> Sensitivity: ...

@final
class SplitBeginning:
    @property
    def pairs(self) -> int: ...
    @property
    def reached(self) -> float: ...
    @property
    def next(self) -> float: ...

@final
class SecondOrder:
    def __new__(
        cls,
        problem: Mechanical,
        tapes: dict[str, Tape],
        patterns: dict[str, _Pattern],
        power_of_lam: bool,
    ) -> SecondOrder: ...

@final
class Separable:
    def __new__(cls, problem: Mechanical, tapes: dict[str, Tape]) -> Separable: ...

@final
class SemiExplicit:
    def __new__(
        cls,
        n: int,
        l: int,
        is_linear: bool,
        tapes: dict[str, Tape],
        patterns: dict[str, _Pattern],
    ) -> SemiExplicit: ...
    def unknowns(
        self,
        t: float,
        y: NDArray[np.float64],
        z: NDArray[np.float64],
        params: NDArray[np.float64],
    ) -> NDArray[np.float64] | _Error: ...

@final
class SemiExplicitSensitivity:
    def __new__(
        cls, problem: SemiExplicit, tapes: dict[str, Tape], patterns: dict[str, _Pattern]
    ) -> SemiExplicitSensitivity: ...

def listing(
    tape: Tape,
) -> tuple[
    list[tuple[int, float]], list[tuple[str, int, list[int]]], list[tuple[str, int, list[int]]]
]: ...
def first_dependent(
    problem: Mechanical,
    params: NDArray[np.float64],
    t: float,
    y: NDArray[np.float64],
    cutoff: float,
) -> int | None: ...
def violation(
    problem: Mechanical,
    params: NDArray[np.float64],
    t: float,
    start: tuple[NDArray[np.float64], NDArray[np.float64]],
    tolerances: tuple[float, float, Sequence[int]],
    with_hidden: bool,
) -> tuple[int, str, int, float, float] | None: ...

@final
class Run:
    def advance(
        self, seconds: float, steps: int | None = None
    ) -> Literal["paused", "done"] | _Error: ...
    @property
    def done(self) -> int: ...
    @property
    def over(self) -> int: ...
    def failures(self) -> list[_Error]: ...
    def found(self) -> list[tuple[int, tuple[Literal["change", "rise", "jump"], list[float]]]]: ...
    @property
    def t(self) -> float: ...
    @property
    def stats(self) -> dict[str, int | float]: ...
    def events(
        self,
    ) -> tuple[
        list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uintp]]],
        list[tuple[int, float, float | None, int]],
    ]: ...
    def take(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def collect(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def place(self) -> NDArray[np.float64] | None: ...
    def save(self) -> NDArray[np.float64] | None: ...
    def restore(self, saved: NDArray[np.float64]) -> None: ...

def run(
    system: Mechanical | Separable | SecondOrder | SemiExplicit | Split | Hamiltonian,
    method: object,
    job: object,
) -> Run | _Error: ...
def pullback(
    problem: Mechanical | SecondOrder | SemiExplicit,
    method: object,
    job: object,
    sensitivity: Sensitivity | SemiExplicitSensitivity,
    alpha: tuple[tuple[Tape, _Pattern, Tape, Tape, Tape], Tape, Tape, Tape] | None,
) -> Pullback | _Error: ...
def members_pullback(
    problem: Mechanical, method: object, job: object, sensitivity: Sensitivity
) -> MembersPullback | None: ...
def run_each(
    members: Sequence[tuple[Hamiltonian, object, object]], threads: int
) -> Run | _Error: ...
def multipliers(
    problem: Mechanical,
    params: NDArray[np.float64],
    t: float,
    y: NDArray[np.float64],
    z: NDArray[np.float64],
) -> NDArray[np.float64] | _Error: ...

@final
class Plane:
    def __new__(
        cls,
        frozen: Sequence[tuple[object, ...]],
        axes: Sequence[tuple[object, ...]],
        coefficients: NDArray[np.float64],
        mean: Sequence[NDArray[np.float64]],
    ) -> Plane: ...
    @staticmethod
    def traced(
        frozen: int, tapes: Sequence[Tape], params: NDArray[np.float64], is_separable: bool
    ) -> Plane: ...
    def sample(self, points: NDArray[np.float64]) -> NDArray[np.float64]: ...

@final
class Split:
    def __new__(cls, n: int, pieces: Sequence[tuple[object, ...]]) -> Split: ...

@final
class FieldPullback:
    def __new__(cls, split: Split, method: object, job: object) -> FieldPullback: ...
    def follow(
        self,
        saved: NDArray[np.float64],
        last: int,
        at_ends: tuple[NDArray[np.int64], NDArray[np.float64]],
        at_times: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> _Error | None: ...
    def end(self, row: NDArray[np.float64]) -> NDArray[np.float64]: ...

@final
class Operator:
    @staticmethod
    def rows(rows: Rows) -> Operator: ...
    @staticmethod
    def diagonals(
        n: int, offsets: Sequence[int], values: Sequence[NDArray[np.float64]]
    ) -> Operator: ...
    @staticmethod
    def dense(matrix: NDArray[np.float64]) -> Operator: ...
    @staticmethod
    def spins(
        bonds: Sequence[tuple[int, int, float, float]], fields: Sequence[float], up: int | None
    ) -> Operator: ...
    @staticmethod
    def kinetic(energies: Sequence[NDArray[np.float64]]) -> Operator: ...
    @staticmethod
    def product(
        n: int, function: Callable[..., NDArray[np.float64]], is_driven: bool = False
    ) -> Operator: ...
    @staticmethod
    def coupling(
        points: int, levels: NDArray[np.float64], vectors: NDArray[np.float64]
    ) -> Operator: ...
    def repeated(self, times: int) -> Operator: ...
    @property
    def size(self) -> int: ...

@final
class Hamiltonian:
    def __new__(
        cls,
        terms: Sequence[Operator],
        is_doubled: bool = False,
        drive: tuple[Tape, NDArray[np.float64]] | None = None,
        potential: tuple[Tape, Tape, NDArray[np.float64], NDArray[np.float64]] | None = None,
        nonlinearity: tuple[Tape, Tape, NDArray[np.float64], float] | None = None,
        absorber: NDArray[np.float64] | None = None,
    ) -> Hamiltonian: ...
    @property
    def size(self) -> int: ...
    def multiply(self, x: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def ritz(
        self, steps: int, seed: int, weights: Sequence[float] | None = None
    ) -> tuple[float, float, float, float]: ...
    def asymmetry(self, seed: int) -> float: ...

@final
class WaveRecord:
    def __new__(cls, tolerance: float | None, is_closed: bool) -> WaveRecord: ...
    def __len__(self) -> int: ...
    def lay_out(
        self, hamiltonian: Hamiltonian, method: object, t0: float, times: Sequence[float]
    ) -> None: ...
    def nodes(self, window: int) -> NDArray[np.float64]: ...
    def raise_degree(self, window: int, degree: int) -> None: ...
    def lengthen(self, window: int, changes: NDArray[np.float64]) -> None: ...

@final
class WaveDerivative:
    def __new__(
        cls, hamiltonian: Hamiltonian, groups: Sequence[int], record: WaveRecord, threads: int
    ) -> WaveDerivative: ...
    def __len__(self) -> int: ...
    def add_shears(
        self, coefficients: NDArray[np.float64], shift: float, t: float, h: float, steps: int
    ) -> None: ...
    def piece(self, piece: int) -> tuple[int, NDArray[np.float64]]: ...
    def keep_ends(self, state: NDArray[np.complex128]) -> None: ...
    def repeat(
        self,
        piece: int,
        state: NDArray[np.complex128],
        weights: NDArray[np.float64],
        potential: NDArray[np.float64],
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]: ...
    def follow(
        self,
        piece: int,
        changes: NDArray[np.complex128],
        weights: NDArray[np.float64],
        potential: NDArray[np.float64],
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]: ...
    def pull(
        self,
        pieces: tuple[int, int],
        steps: Sequence[int],
        of_steps: NDArray[np.complex128],
        wanted: tuple[bool, bool],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    @property
    def cotangent(self) -> NDArray[np.complex128]: ...

def chebyshev_degree(theta: float, tolerance: float) -> int: ...
def driven_cost(
    hamiltonian: Hamiltonian, method: object, t: float, end: float
) -> tuple[int, int, int, float, float]: ...
def magnus_cost(
    hamiltonian: Hamiltonian, method: object, times: Sequence[float]
) -> tuple[float, float, float, bool]: ...
def processor_degree(order: int, stages: int, theta: float) -> int | None: ...
def split_beginning(
    hamiltonian: Hamiltonian,
    method: object,
    interval: tuple[float, float],
    flows: int,
    psi: NDArray[np.complex128],
) -> SplitBeginning: ...
def split_program(name: str) -> list[tuple[bool, float, float]]: ...
def project(
    tapes: tuple[Tape, Tape, Tape],
    patterns: tuple[_Pattern, _Pattern],
    x: NDArray[np.float64],
    held: NDArray[np.float64],
    params: NDArray[np.float64],
) -> NDArray[np.float64] | _Error: ...
def project_linear(
    tapes: tuple[Tape, Tape, Tape],
    patterns: tuple[_Pattern, _Pattern],
    x: NDArray[np.float64],
    held: NDArray[np.float64],
    params: NDArray[np.float64],
    rows: NDArray[np.float64],
    is_transposed: bool,
) -> NDArray[np.float64] | _Error: ...
def independent_rows(
    matrix: NDArray[np.float64], cutoff: float
) -> tuple[list[int], float, float]: ...
def lobatto_pair(stages: int, force: str) -> dict[str, NDArray[np.float64]]: ...
def spark_tableau(stages: int, points: str) -> dict[str, NDArray[np.float64]]: ...
def compositions() -> dict[str, dict[str, Any]]: ...
def ladder() -> list[dict[str, Any]]: ...
def stability() -> list[dict[str, Any]]: ...
