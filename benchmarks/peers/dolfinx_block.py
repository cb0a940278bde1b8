"""The block of `benchmarks/block.py` by DOLFINx with MUMPS; prints one line of JSON. It needs DOLFINx ≥ 0.10.

NOT RUN so far: written from the documentation, where pip has no DOLFINx.

Q1–DG0, exactly incompressible by −½ p (J² − 1), 2×2×2 Gauss points: jaxmyo's discrete problem. PETSc's SNES with full
Newton steps and LU by MUMPS, in one process. The first solve compiles the forms (their cache is a temporary folder).
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import NonlinearProblem
from dolfinx.mesh import CellType, create_unit_cube
from mpi4py import MPI
from petsc4py import PETSc

FORCE = 1e-8  # norm of the residual [mN]
OPTIONS = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "basic",  # the prescribed motion is part of the residual, which need not fall at first
    "snes_atol": FORCE,
    "snes_rtol": 0.0,
    "snes_stol": 0.0,
    "snes_max_it": 20,
    "snes_error_if_not_converged": True,
    "ksp_error_if_not_converged": True,
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}


def solve(mesh, cache):
    """Newton's method from rest, the stretch in one step: u, the forces (n_nodes, 3) [mN], the iterations."""
    V, Q = fem.functionspace(mesh, ("Lagrange", 1, (3,))), fem.functionspace(mesh, ("DG", 0))
    u, p, v, q = fem.Function(V, name="u"), fem.Function(Q, name="p"), ufl.TestFunction(V), ufl.TestFunction(Q)
    p.x.array[:] = 1.0  # free of stress
    dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": 3, "quadrature_rule": "default"})
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    C, J = F.T * F, ufl.det(F)
    W = 0.5 * (ufl.tr(C) - 3.0) + (C[0, 0] - 1.0) ** 2 - 0.5 * p * (J**2 - 1.0)
    none = fem.Constant(mesh, PETSc.ScalarType(0.0))  # keeps the block of p in the pattern
    forces = ufl.inner(ufl.diff(W, F), ufl.grad(v)) * dx
    residual = [forces, -0.5 * (J**2 - 1.0) * q * dx + none * p * q * dx]

    def face(x, value):
        return fem.locate_dofs_geometrical(V, lambda at: np.isclose(at[0], x)), np.array(value, PETSc.ScalarType)

    bcs = [fem.dirichletbc(value, dofs, V) for dofs, value in (face(0.0, (0.0, 0.0, 0.0)), face(1.0, (0.2, 0.0, 0.0)))]
    problem = NonlinearProblem(
        residual,
        [u, p],
        bcs=bcs,
        kind="mpi",
        petsc_options_prefix="block_",
        petsc_options=OPTIONS,
        jit_options={"cache_dir": cache},
    )
    problem.solve()
    internal = fem.assemble_vector(fem.form(forces, jit_options={"cache_dir": cache}))
    return u, internal.array.reshape(-1, 3), problem.solver.getIterationNumber()


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
    options = parser.parse_args()
    n, seconds = options.n, []
    PETSc.Options()["block_mat_mumps_icntl_14"] = 80  # room for pivots, % of the estimate; SNES has no such option
    mesh = create_unit_cube(MPI.COMM_SELF, n, n, n, CellType.hexahedron)
    with tempfile.TemporaryDirectory() as cache:
        for _ in range(1 + options.repeat):
            start = time.perf_counter()
            u, forces, iterations = solve(mesh, cache)
            seconds.append(time.perf_counter() - start)
    points, values = u.function_space.tabulate_dof_coordinates(), u.x.array.reshape(-1, 3)
    on_x1, clamped = np.isclose(points[:, 0], 1.0), np.isclose(np.abs(points[:, 0] - 0.5), 0.5)
    on_y1 = np.flatnonzero(np.isclose(points[:, 1], 1.0))
    away = np.hypot(*(points[on_y1][:, [0, 2]] - 0.5).T)
    result = {
        "code": "dolfinx",
        "versions": f"dolfinx {dolfinx.__version__}, PETSc {'.'.join(map(str, PETSc.Sys.getVersion()))}, MUMPS",
        "seconds": seconds,
        "iterations": iterations,
        "peak_GB": peak_GB(),
        "reaction_mN": float(forces[on_x1, 0].sum()),
        "lateral_mm": float(values[on_y1[away <= away.min() + 1e-9], 1].mean()),
        "force_mN": float(np.abs(forces[~clamped]).max()),
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
