"""The block of `benchmarks/block.py` by FElupe with Pardiso; prints one line of JSON. It needs felupe and pypardiso.

By default as its documentation advises for rubber-like bodies: `SolidBodyNearlyIncompressible`, the three fields u, p
and det F of which p and det F are condensed in each element, with the bulk modulus K = 1000 kPa. The law is a
`ConstitutiveMaterial` written out by hand, which is faster than its automatic differentiation, evaluated in chunks by
threads; the assembly is threaded, too. W has − ln J added (−1 kPa of pressure), so that the body is free of stress at
rest; without it, K would shrink the body by 1/K.

--mixed: (u, p) with −½ p (J² − 1), exactly incompressible, which is jaxmyo's discrete problem.
"""

import argparse
import json
import resource
import sys
import time
from importlib.metadata import version
from pathlib import Path

import felupe as fem
import numpy as np
import pypardiso
from felupe import math as fm

FORCE = 1e-8  # largest force on a free node [mN]


def fibres(P, A, F):
    """Adds to P and A those of ½ I1 + (I4 − 1)² [kPa], fibres along x; A, the derivative of P by F, may be None."""
    along = F[:, 0]
    by_I4 = 4.0 * (np.sum(along**2, axis=0) - 1.0)
    if A is None:
        P += F
        P[:, 0] += by_I4 * along
        return
    for i in range(3):
        for j in range(3):
            A[i, j, i, j] += 1.0
        A[i, 0, i, 0] += by_I4
    A[:, 0, :, 0] += 8.0 * along[:, None] * along[None]


class Law(fem.ConstitutiveMaterial):
    """½ (I1 − 3) − ln J + (I4 − 1)² [kPa]."""

    def __init__(self):
        self.x = [np.eye(3), np.zeros(0)]
        self.parallel = True

    def _gradient(self, x):
        P = -fm.transpose(fm.inv(x[0]))
        fibres(P, None, x[0])
        return [P, x[-1]]

    def _hessian(self, x):
        inverse = fm.transpose(fm.inv(x[0]))
        A = fm.cdya_il(inverse, inverse)
        fibres(None, A, x[0])
        return [A]


class MixedLaw(fem.ConstitutiveMaterial):
    """½ (I1 − 3) + (I4 − 1)² − ½ p (J² − 1) [kPa]."""

    def __init__(self):
        self.x = [np.eye(3), np.zeros(1), np.zeros(0)]
        self.parallel = True

    def _gradient(self, x):
        F, p = x[0], x[1][0]
        J = fm.det(F)
        P = -p * J**2 * fm.transpose(fm.inv(F, J))
        fibres(P, None, F)
        return [P, -0.5 * (J**2 - 1.0)[None], x[-1]]

    def _hessian(self, x):
        F, p = x[0], x[1][0]
        J = fm.det(F)
        inverse = fm.transpose(fm.inv(F, J))
        A = p * J**2 * (fm.cdya_il(inverse, inverse) - 2.0 * fm.dya(inverse, inverse))
        fibres(None, A, F)
        return [A, -(J**2) * inverse, np.zeros((1, 1, *J.shape))]


def check(dx, x, f, xtol, ftol, dof1=None, dof0=None, items=None):
    """Norm of the correction, largest residual of a free unknown, and whether Newton's method has arrived."""
    largest = np.abs(f[dof1]).max()
    return np.linalg.norm(dx), largest, largest <= FORCE


def solve(mesh, bulk, mixed):
    """Newton's method from rest, the stretch in one step."""
    region = fem.RegionHexahedron(mesh)
    if mixed:
        field = fem.FieldsMixed(region, n=2, values=(0.0, 1.0))  # p = 1 kPa is free of stress
        solid = fem.SolidBody(MixedLaw(), field)
    else:
        field = fem.FieldContainer([fem.Field(region, dim=3)])
        solid = fem.SolidBodyNearlyIncompressible(Law(), field, bulk=bulk)
    bounds = {
        "x0": fem.Boundary(field[0], fx=0.0),
        "x1": fem.Boundary(field[0], fx=1.0, skip=(True, False, False)),
        "move": fem.Boundary(field[0], fx=1.0, skip=(False, True, True), value=0.2),
    }
    dof0, dof1 = fem.dof.partition(field, bounds)
    return fem.newtonraphson(
        x0=field,
        items=[solid],
        dof0=dof0,
        dof1=dof1,
        ext0=fem.dof.apply(field, bounds, dof0),
        solver=pypardiso.spsolve,
        kwargs={"parallel": True},
        check=check,
        verbose=0,
    )


def peak_GB():
    """The most memory that this process has held [GB]."""
    try:  # that of the parent counts in `getrusage` where a process starts as a copy of it
        return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) * 1024 / 1e9
    except (OSError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e9


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("n", type=int, help="elements along an edge")
    parser.add_argument("--repeat", type=int, default=2, help="warm solves after the first")
    parser.add_argument("--bulk", type=float, default=1000.0, help="bulk modulus K [kPa]")
    parser.add_argument("--mixed", action="store_true", help="u and p, exactly incompressible")
    options = parser.parse_args()
    mesh = fem.Cube(n=options.n + 1)
    seconds = []
    for _ in range(1 + options.repeat):
        start = time.perf_counter()
        result = solve(mesh, options.bulk, options.mixed)
        seconds.append(time.perf_counter() - start)
    points, u = mesh.points, result.x[0].values
    forces = result.fun[: u.size].reshape(-1, 3)
    on_y1 = np.flatnonzero(np.isclose(points[:, 1], 1.0))
    away = np.hypot(*(points[on_y1][:, [0, 2]] - 0.5).T)
    values = {
        "code": "felupe-mixed" if options.mixed else "felupe",
        "versions": f"felupe {version('felupe')}, Pardiso (MKL {version('mkl')})",
        "seconds": seconds,
        "iterations": int(result.iterations),
        "peak_GB": peak_GB(),
        "reaction_mN": float(forces[np.isclose(points[:, 0], 1.0), 0].sum()),
        "lateral_mm": float(u[on_y1[away <= away.min() + 1e-9], 1].mean()),
        "force_mN": float(result.fnorms[-1]),
    }
    print(json.dumps(values))


if __name__ == "__main__":
    main()
