"""The block of `benchmarks/block.py` by DOLFINx with MUMPS; prints one line of JSON. It needs DOLFINx 0.5 to 0.9.

Run with 0.5.2, PETSc 3.18.5 and MUMPS 5.5.1 of Debian 12, with OpenBLAS; names that have changed since are looked up.

Q1–DG0, exactly incompressible by −½ p (J² − 1), 2×2×2 Gauss points: jaxmyo's discrete problem. Newton's method with
full steps on the block system, and LU by MUMPS, in one process; forms, pattern and ordering are kept for all steps of a
solve. The first solve compiles the forms (their cache is a temporary folder).
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
from dolfinx.fem import petsc
from dolfinx.mesh import CellType, create_unit_cube
from mpi4py import MPI
from petsc4py import PETSc

FORCE = 1e-8  # largest force on a free node [mN]
ITERATIONS = 20  # of Newton's method


def spaces(mesh):
    """Q1 vectors for u, constants for p."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(mesh, ("Lagrange", 1, (3,))), fem.functionspace(mesh, ("DG", 0))
    return fem.VectorFunctionSpace(mesh, ("Lagrange", 1)), fem.FunctionSpace(mesh, ("DG", 0))


def direct(matrix):
    """LU by MUMPS."""
    solver = PETSc.KSP().create(matrix.comm)
    solver.setOperators(matrix)
    solver.setType("preonly")
    solver.pc.setType("lu")
    solver.pc.setFactorSolverType("mumps")
    solver.pc.setFactorSetUpSolverType()
    solver.pc.getFactorMatrix().setMumpsIcntl(14, 80)  # room for pivots, % of the estimate
    solver.setErrorIfNotConverged(True)
    return solver


def solve(mesh, cache):
    """Newton's method from rest, the stretch in one step: u, the forces (n_nodes, 3) [mN], the iterations."""
    V, Q = spaces(mesh)
    u, p, v, q = fem.Function(V), fem.Function(Q), ufl.TestFunction(V), ufl.TestFunction(Q)
    du, dp = ufl.TrialFunction(V), ufl.TrialFunction(Q)
    p.x.array[:] = 1.0  # free of stress
    dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": 3, "quadrature_rule": "default"})
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    C, J = F.T * F, ufl.det(F)
    W = 0.5 * (ufl.tr(C) - 3.0) + (C[0, 0] - 1.0) ** 2 - 0.5 * p * (J**2 - 1.0)
    none = fem.Constant(mesh, PETSc.ScalarType(0.0))  # keeps the block of p in the pattern
    of_u = ufl.inner(ufl.diff(W, F), ufl.grad(v)) * dx
    of_p = -0.5 * (J**2 - 1.0) * q * dx
    by_p = none * dp * q * dx
    # The flags with which DOLFINx's own demos compile forms that have to be fast.
    jit = {"cache_dir": cache, "cffi_extra_compile_args": ["-Ofast", "-march=native"]}
    option = {"jit_options": jit} if "jit_options" in fem.form.__code__.co_varnames else {"jit_params": jit}
    residual = fem.form([of_u, of_p], **option)
    tangent = [[ufl.derivative(of_u, u, du), ufl.derivative(of_u, p, dp)], [ufl.derivative(of_p, u, du), by_p]]
    tangent = fem.form(tangent, **option)

    def face(x, value):
        dofs = fem.locate_dofs_geometrical(V, lambda at: np.isclose(at[0], x))
        return fem.dirichletbc(np.array(value, PETSc.ScalarType), dofs, V)

    bcs = [face(0.0, (0.0, 0.0, 0.0)), face(1.0, (0.2, 0.0, 0.0))]
    A = petsc.create_matrix_block(tangent)
    x, correction, b = A.createVecLeft(), A.createVecLeft(), A.createVecLeft()
    solver = direct(A)
    for iteration in range(ITERATIONS + 1):
        x.array[:] = np.concatenate([u.x.array, p.x.array])
        b.set(0.0)
        petsc.assemble_vector_block(b, residual, tangent, bcs=bcs, x0=x, scale=-1.0)  # 0 where u has to be as it is
        if np.abs(b.array).max() <= FORCE:
            forces = fem.assemble_vector(residual[0]).array.reshape(-1, 3)
            break
        if iteration == ITERATIONS:
            raise RuntimeError(f"no convergence in {ITERATIONS} iterations: {np.abs(b.array).max():.1e} mN are left")
        A.zeroEntries()
        petsc.assemble_matrix_block(A, tangent, bcs=bcs)
        A.assemble()
        solver.solve(b, correction)
        u.x.array[:] -= correction.array[: len(u.x.array)]
        p.x.array[:] -= correction.array[len(u.x.array) :]
    for each in (solver, A, x, correction, b):
        each.destroy()
    return u, forces, iteration


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
