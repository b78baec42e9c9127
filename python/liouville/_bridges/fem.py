"""Bodies that scikit-fem has assembled, as structures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from liouville._basics.errors import misshapen
from liouville._systems import Structure


class Body:
    """An assembled body: its matrices, and which degrees of freedom move.

    Coordinates are the degrees of freedom of the basis that are not clamped, in their order. They
    are called after scikit-fem's names, with the vertex, facet, edge or element they belong to:
    ``"u^1 vertex 4"``.

    Parameters
    ----------
    basis : skfem.Basis
        The basis the matrices are assembled with.
    mass, stiffness : sparse matrix
        As ``form.assemble(basis)`` gives them, shape (N, N).
    damping : sparse matrix, optional
        The same, for the velocity.
    clamped : skfem.DofsView or array_like of int, optional
        Degrees of freedom that are zero for ever, as ``basis.get_dofs("left")``.

    Attributes
    ----------
    free : ndarray
        The degree of freedom of each coordinate, shape (n,).
    names : tuple of str
        The name of each coordinate.

    Examples
    --------
    ::

        mesh = skfem.MeshQuad.init_tensor(x, y).with_boundaries({"left": lambda x: x[0] == 0})
        basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()))
        body = Body.elastic(
            basis, young=210e9, poisson=0.3, density=7800.0, clamped=basis.get_dofs("left")
        )
        system = body.structure()
    """

    def __init__(
        self, basis: Any, mass: Any, stiffness: Any, damping: Any = None, *, clamped: Any = None
    ) -> None:
        count = basis.N
        free = np.ones(count, dtype=bool)
        free[_dofs(clamped, count)] = False
        self.basis = basis
        self.free = np.flatnonzero(free)
        every = _names(basis)
        self.names = tuple(every[k] for k in self.free)
        self._every = every
        self._place = np.full(count, -1)
        self._place[self.free] = np.arange(self.free.size)
        matrices = {"mass": mass, "stiffness": stiffness, "damping": damping}
        self._matrices = {
            name: _free(name, matrix, self.free, count)
            for name, matrix in matrices.items()
            if matrix is not None
        }

    @classmethod
    def elastic(
        cls,
        basis: Any,
        *,
        young: float,
        poisson: float,
        density: float,
        rayleigh: tuple[float, float] = (0.0, 0.0),
        clamped: Any = None,
    ) -> Body:
        """Assemble a linear elastic body; needs scikit-fem.

        Parameters
        ----------
        basis : skfem.Basis
            Of a vector element; in the plane the body is one unit thick, and its strain plane.
        young, poisson, density : float
            Young's modulus, Poisson's ratio, and mass a volume.
        rayleigh : tuple of two floats, default (0, 0)
            Factors (a, b) of the damping a M + b K.
        clamped : skfem.DofsView or array_like of int, optional
            As for the class.
        """
        try:
            import skfem
            from skfem.helpers import dot
            from skfem.models.elasticity import lame_parameters, linear_elasticity
        except ImportError as error:
            error.add_note("hint: pip install liouville[fem]")
            raise
        stiffness = linear_elasticity(*lame_parameters(young, poisson)).assemble(basis)
        mass = skfem.BilinearForm(lambda u, v, w: density * dot(u, v)).assemble(basis)
        a, b = rayleigh
        damping = a * mass + b * stiffness if a or b else None
        return cls(basis, mass, stiffness, damping, clamped=clamped)

    def structure(
        self,
        *,
        force: Callable[..., Any] | ArrayLike | None = None,
        constraint: Callable[..., Any] | None = None,
        params: Mapping[str, ArrayLike] | None = None,
        invariants: Mapping[str, Callable[..., Any]] | None = None,
    ) -> Structure:
        """Make the system; the arguments are those of :class:`liouville.Structure`."""
        return Structure(
            **self._matrices,
            force=force,
            constraint=constraint,
            q=self.names,
            params=params,
            invariants=invariants,
        )

    def at(self, dofs: Any) -> np.ndarray:
        """Return the coordinate of each of these degrees of freedom.

        Parameters
        ----------
        dofs : skfem.DofsView or array_like of int
            Degrees of freedom that are not clamped, as ``basis.get_dofs("right").all("u^2")``.

        Returns
        -------
        ndarray
            Where they are in q.

        Raises
        ------
        ValueError
            One of them is clamped, or there is no such degree of freedom.
        """
        wanted = _dofs(dofs, self._place.size)
        places: np.ndarray = self._place[wanted]
        if (places < 0).any():
            name = self._every[wanted[np.argmin(places)]]
            raise ValueError(f"'{name}' is clamped and no coordinate")
        return places

    def values(self, q: ArrayLike) -> np.ndarray:
        """Return all degrees of freedom, the clamped ones zero: shape (..., N) for q of (..., n).

        Raises
        ------
        ValueError
            There are not n coordinates.
        """
        array = np.asarray(q, dtype=float)
        if array.shape[-1:] != self.free.shape:
            raise misshapen("q", array.shape, f"(..., {self.free.size})")
        every = np.zeros((*array.shape[:-1], self._place.size))
        every[..., self.free] = array
        return every

    def load(self, load: ArrayLike) -> np.ndarray:
        """Return the part of an assembled load, shape (N,), that the coordinates feel."""
        array = np.asarray(load, dtype=float)
        if array.shape != self._place.shape:
            raise misshapen("load", array.shape, self._place.shape)
        return array[self.free]


def _dofs(dofs: Any, count: int) -> np.ndarray:
    """Return numbers of degrees of freedom, of a view or an array."""
    if dofs is None:
        return np.empty(0, dtype=int)
    found = np.atleast_1d(dofs.flatten() if hasattr(dofs, "flatten") else np.asarray(dofs))
    if found.size == 0:
        return np.empty(0, dtype=int)
    if found.dtype.kind not in "iu" or found.min() < 0 or found.max() >= count:
        raise ValueError(f"degrees of freedom must be integers from 0 to {count - 1}, not {dofs!r}")
    return found


def _free(name: str, matrix: Any, free: np.ndarray, count: int) -> Any:
    """Return the rows and columns of a sparse matrix that move."""
    if not hasattr(matrix, "tocsr"):
        raise TypeError(f"{name} must be a sparse matrix of SciPy's, not {matrix!r}")
    if matrix.shape != (count, count):
        hint = "give the matrices before anything is condensed out, and name what is clamped"
        raise misshapen(name, matrix.shape, f"({count}, {count}) as the basis has", hint)
    return matrix.tocsr()[free][:, free]


def _names(basis: Any) -> list[str]:
    """Name each degree of freedom."""
    names, components, dofs = [""] * basis.N, iter(basis.elem.dofnames), basis.dofs
    kinds = {
        "vertex": dofs.nodal_dofs,
        "facet": dofs.facet_dofs,
        "edge": dofs.edge_dofs,
        "element": dofs.interior_dofs,
    }
    for kind, rows in kinds.items():
        for row in rows if rows is not None else ():
            component = next(components)
            for k, dof in enumerate(row):
                names[dof] = f"{component} {kind} {k}"
    return names
