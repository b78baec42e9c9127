"""Where the unknowns of the program of an optimal control problem are."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from liouville._basics.arguments import check_memory
from liouville._studies.optimal.arguments import Times
from liouville._studies.optimal.program import Places

#: Bytes of an unknown in IPOPT and CasADi, of the smallest systems.
LEAST_BYTES = 2000.0


@dataclass(frozen=True)
class Layout:
    """Where the unknowns are: y and z at nodes, and of each step V, Z, h Psi and u.

    Then those of all steps: the end, parameters, and what conditions at the end add. The unknowns Z
    are those of systems whose velocity is not z itself, else the places of V.
    """

    y: Places
    z: Places
    V: Places
    Z: Places
    impulses: Places
    u: Places
    end: Places
    params: Places
    more: Places
    size: int

    @classmethod
    def of(
        cls,
        counts: tuple[int, int, int],
        is_own_velocity: bool,
        stages: int,
        times: Times,
        params: int,
        more: int,
    ) -> Layout:
        """Lay them out step by step, of n coordinates, m constraints and k controls."""
        (n, m, k), steps = counts, times.steps
        sizes = [stages * n, 0 if is_own_velocity else stages * n]
        sizes += [(stages + 1) * m, stages * k, n, n]
        firsts = np.cumsum([0, *sizes])
        unknowns = steps * int(firsts[-1])
        check_memory(
            f"a program of {unknowns} unknowns in {steps} steps", LEAST_BYTES * unknowns,
            "take fewer steps",
        )  # fmt: skip
        rows = 2 * n + np.arange(steps)[:, None] * firsts[-1] + np.arange(firsts[-1])
        parts = [rows[:, a:b] for a, b in pairwise(firsts.tolist())]
        V, Z, impulses, u, y, z = parts
        start = np.arange(n)[None]
        last = 2 * n + unknowns
        end = np.arange(last, last + (times.limits is not None))
        first = last + end.size
        last = first + params
        return cls(
            y=np.vstack([start, y]),
            z=np.vstack([n + start, z]),
            V=V.reshape(steps, stages, n),
            Z=(V if is_own_velocity else Z).reshape(steps, stages, n),
            impulses=impulses.reshape(steps, stages + 1, m),
            u=u.reshape(steps, stages, k),
            end=end,
            params=np.arange(first, last),
            more=np.arange(last, last + more),
            size=last + more,
        )
