"""What is written of the tube: CSV files, states for ParaView, figures, and the numbers of --json."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from jaxmyo.export import write_vtu
from jaxmyo.paper import tube_figures
from jaxmyo.paper.homogeneous import CONSTRAINT
from jaxmyo.paper.output import write_csv
from jaxmyo.paper.sample import activation
from jaxmyo.paper.tube import A_OVER_D, GRADING, KINDS, T0_KPA, Tube, Walls, pressure
from jaxmyo.paper.tube_accuracy import Accuracy
from jaxmyo.paper.tube_results import TubeResults
from jaxmyo.paper.tube_weave import K_KPA, SoftWeave
from jaxmyo.status import Status

#: Pieces of an element of the tube, which is a whole ring, in the files for ParaView.
REFINE = (1, 48, 1)
#: Names of s = 0 and s = ½ in the files, of with and without the constraint.
END_NAMES = ("s0", "half")
CASE_NAMES = ("", "_without_constraint")
CASE_KEYS = ("with_constraint", "without_constraint")


def write_data(folder: Path, name: str, results: TubeResults) -> list[Path]:
    """The CSV files, and the states at s = 0 and s = ½ as VTK files."""
    tube = results.tube
    files = [
        write_csv(folder / "tube.csv", cycle_rows(name, tube)),
        write_csv(folder / "tube_weave.csv", weave_rows(name, results.soft)),
    ]
    for c, case in enumerate(CASE_NAMES):
        for end, k in zip(END_NAMES, tube.ends, strict=True):
            for kind in KINDS:
                path = folder / f"tube_{end}_{kind}{case}.vtu"
                files.append(write_vtu(path, tube.state(kind, c, k), REFINE))
    return files


def write_figures(folder: Path, name: str, results: TubeResults) -> list[Path]:
    """The figures as PNG files, in the order of the report."""
    tube = results.tube
    return [
        tube_figures.pressure_and_tonus(folder / "tube_pressure.png", name, tube),
        tube_figures.height(folder / "tube_height.png", name, tube),
        tube_figures.inner_radius(folder / "tube_inner_radius.png", name, tube),
        tube_figures.outer_radius(folder / "tube_outer_radius.png", name, tube),
        tube_figures.accuracy(folder / "tube_accuracy.png", name, results.accuracy),
        tube_figures.weave(folder / "tube_weave.png", name, results.soft, results.lines, results.limit),
    ]


def cycle_rows(name: str, tube: Tube) -> Iterator[dict[str, Any]]:
    """States A and C over the cycle; `constraint` is 0 and `q_A_kPa` empty without it."""
    beta = activation(tube.s)
    for c, constraint in enumerate(CONSTRAINT):
        for k, s in enumerate(tube.s):
            A, C = tube.A.at(c, k), tube.C.at(c, k)
            yield {
                "set": name,
                "constraint": int(constraint),
                "elements": tube.elements,
                "T0_kPa": T0_KPA,
                "a_over_D": A_OVER_D,
                "s": s,
                "beta": beta[k],
                "pressure_C_kPa": pressure(beta[k]),
                "q_A_kPa": A.q if constraint else None,
                "T_f_inner_kPa": A.T_f[0],
                "T_f_outer_kPa": A.T_f[1],
                "T_cf_inner_kPa": A.T_cf[0],
                "T_cf_outer_kPa": A.T_cf[1],
                **_columns("A", A),
                **_columns("C", C),
            }


def weave_rows(name: str, soft: Sequence[SoftWeave]) -> Iterator[dict[str, Any]]:
    """States A and C at s = ½ with a weave of finite stiffness, one q per element."""
    for mesh in soft:
        for k, stiffness in enumerate(K_KPA):
            case = {"set": name, "elements": mesh.elements, "T0_kPa": T0_KPA, "a_over_D": A_OVER_D}
            states = {**_columns("A", mesh.A.at(k)), **_columns("C", mesh.C.at(k))}
            yield {**case, "weave_stiffness_kPa": stiffness, **states}


def _columns(kind: str, wall: Walls) -> dict[str, Any]:
    """Lengths of the deformed tube, and how far they can be trusted."""
    return {
        f"ri_{kind}_mm": wall.ri,
        f"ro_{kind}_mm": wall.ro,
        f"wall_{kind}_mm": wall.thickness,
        f"height_ratio_{kind}": wall.height,
        f"status_{kind}": Status(int(wall.status)).name,
        f"negative_eigenvalues_{kind}": wall.negative,
        f"relative_residual_{kind}": wall.residual,
    }


def as_json(name: str, results: TubeResults) -> dict[str, Any]:
    """The tube at s = 0 and s = ½ (lengths in mm, q in kPa), and how far it is from the exact one."""
    tube = results.tube
    states: dict[str, Any] = {}
    for c, case in enumerate(CASE_KEYS):
        states[case] = {
            end: {kind: _numbers(tube.walls(kind).at(c, k), kind) for kind in KINDS}
            for end, k in zip(END_NAMES, tube.ends, strict=True)
        }
    return {
        "set": name,
        "T0_kPa": T0_KPA,
        "a_over_D": A_OVER_D,
        "elements": tube.elements,
        "grading": GRADING,
        **states,
        "up_and_down_mm": tube.up_and_down,
        "accuracy": _accuracy(results.accuracy),
        "inner_radius_change_mm": [c._asdict() for c in results.changes],
    }


def _numbers(wall: Walls, kind: str) -> dict[str, float]:
    numbers = {"ri_mm": float(wall.ri), "ro_mm": float(wall.ro), "height_ratio": float(wall.height)}
    return numbers | ({"q_kPa": float(wall.q)} if kind == "A" else {})


def _accuracy(found: Accuracy) -> dict[str, Any]:
    """Relative L2 errors at s = ½, with and without the constraint."""
    by_mesh = [
        {
            "elements": tube.elements,
            "states": 2 * len(CONSTRAINT) * len(tube.s),
            "solve_seconds": tube.solve_s,
            "total_seconds": tube.total_s,
            "relative_L2_error": _by_case(errors[:, :, 1]),
        }
        for tube, errors in zip(found.tubes, found.raw, strict=True)
    ]
    return {
        "meshes": by_mesh,
        "orders": [_by_case(orders) for orders in found.orders],
        "extrapolated_relative_L2_error": _by_case(found.extrapolated[:, :, 1]),
    }


def _by_case(values: Any) -> dict[str, dict[str, float]]:
    """kind × constraint as a dictionary of dictionaries."""
    return {
        kind: {case: float(value) for case, value in zip(CASE_KEYS, row, strict=True)}
        for kind, row in zip(KINDS, values, strict=True)
    }
