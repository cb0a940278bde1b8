"""The dials of a solve that trade speed for accuracy, one setting of all of them, and how a solve is given it."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from typing import Any, Literal
from unittest.mock import patch

import numpy as np

from jaxmyo import factor, solve, sparse
from jaxmyo.newton import Settings

Precision = Literal["float64", "float32", "mixed"]
Solver = Literal["", "dense", "Pardiso, float32", "Pardiso, float64", "SuperLU", "multigrid"]


@dataclass(frozen=True)
class Dials:
    """One setting of all dials.

    model: which scene of the body ("" is the body's own); elements: of the mesh, along the direction that is refined;
    grading: size of the outermost element of a wall over the innermost one; quadrature: Gauss points along each
    direction in which something varies; patches: of the multipliers, "" is the scene's own; precision; tolerance,
    path_tolerance, move: of `Settings`; steps: so many equal load steps instead of adaptive ones (0); solver: of the
    linear systems, "" is the one that is chosen without asking; inner: relative residual of the Krylov iterations in
    sparse solves, 0 for what Newton's method can use; tangent: "reused" keeps factors and tangents for the next
    iterations as long as that pays, "new" makes them anew at every iteration; compiler: "quick" compiles a small body
    in a third of the time of "default"; extrapolated: meshes of n, 2 n, ... elements whose results are extrapolated to
    h = 0, `elements` is the finest.
    """

    model: str = ""
    elements: int = 16
    grading: float = 1.0
    quadrature: int = 2
    patches: str = ""
    precision: Precision = "float64"
    tolerance: float = 1e-13
    path_tolerance: float = 1e-7
    move: float = 0.3
    steps: int = 0
    solver: Solver = ""
    inner: float = 0.0
    tangent: Literal["reused", "new"] = "reused"
    compiler: Literal["quick", "default"] = "quick"
    extrapolated: int = 1

    @property
    def program(self) -> tuple[Any, ...]:
        """What one process measures: other numbers run the same compiled code."""
        return (
            self.model,
            self.elements,
            self.grading,
            self.quadrature,
            self.patches,
            self.precision,
            self.solver,
            self.compiler,
        )

    @property
    def settings(self) -> Settings:
        """Of the solves."""
        found = Settings(tolerance=self.tolerance, path_tolerance=self.path_tolerance, move=self.move)
        if self.precision != "float64":
            found = found._replace(precision=self.precision)
        # A step that may be no shorter than 1/n, and is asked to be, is 1/n long; one that fails ends the path.
        return found._replace(move=1e-6, min_step=(1.0 - 1e-9) / self.steps) if self.steps else found

    def changed(self, other: "Dials") -> dict[str, Any]:
        """The dials in which it differs from another setting."""
        mine, theirs = asdict(self), asdict(other)
        return {name: value for name, value in mine.items() if value != theirs[name]}


@contextmanager
def applied(dials: Dials) -> Iterator[None]:
    """Those dials of sparse solves that no setting names: they are chosen by size, or as Newton's method goes along."""
    with ExitStack() as stack:
        if dials.solver not in ("", "dense"):
            kind = {"SuperLU": factor._SuperLU, "multigrid": factor.Multigrid}.get(dials.solver, factor._Pardiso)
            stack.enter_context(patch.object(solve, "LARGE", 0))
            stack.enter_context(patch.object(factor, "chosen", lambda n_u: kind))
        if dials.solver == "Pardiso, float64":
            begin = factor._Pardiso._begin
            stack.enter_context(patch.object(factor._Pardiso, "_begin", lambda self, dtype: begin(self, np.float64)))
        if dials.inner or dials.tangent == "new":
            stack.enter_context(patch.object(sparse.Sparse, "solve", _inner_solve(dials)))
        if dials.tangent == "new":
            stack.enter_context(patch.object(sparse, "NEAR", -1.0))
        yield


def _inner_solve(dials: Dials) -> Any:
    original = sparse.Sparse.solve

    def solve(self: Any, K: Any, mu: float, b: Any, accuracy: float, guess: Any, last: bool) -> Any:
        if dials.tangent == "new" and not self.has_factors_of(K):
            self._factored = None
        return original(self, K, mu, b, dials.inner or accuracy, guess, last)

    return solve
