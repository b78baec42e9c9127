"""The border between Python and the core, whole."""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Pattern = tuple[int, int, list[int], list[int]]
Trouble = dict[str, Any]

OPERATIONS: dict[str, int]

class Tape:
    def __new__(
        cls, inputs: list[int], outputs: int, lines: NDArray[np.int64], values: NDArray[np.float64]
    ) -> Tape: ...
    def __len__(self) -> int: ...
    @property
    def inputs(self) -> list[int]: ...
    @property
    def outputs(self) -> int: ...
    def map(
        self, params: NDArray[np.float64], args: list[NDArray[np.float64]]
    ) -> NDArray[np.float64]: ...

class Mechanical:
    def __new__(
        cls,
        n: int,
        m: int,
        is_linear: bool,
        tapes: dict[str, Tape],
        patterns: dict[str, Pattern],
    ) -> Mechanical: ...

class MechanicalRun:
    @staticmethod
    def start(
        problem: Mechanical,
        method: object,
        observer: Tape,
        params: NDArray[np.float64],
        y: NDArray[np.float64],
        z: NDArray[np.float64],
        span: tuple[float, float, int, int],
        states: bool,
    ) -> MechanicalRun | Trouble: ...
    def advance(self, seconds: float) -> Literal["paused", "done"] | Trouble: ...
    @property
    def done(self) -> int: ...
    @property
    def stats(self) -> dict[str, int]: ...
    def take(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

def project(
    tapes: tuple[Tape, Tape, Tape],
    entries: Pattern,
    x: NDArray[np.float64],
    held: NDArray[np.float64],
    params: NDArray[np.float64],
) -> NDArray[np.float64] | Trouble: ...
def gauss_lobatto(stages: int) -> dict[str, NDArray[np.float64]]: ...
