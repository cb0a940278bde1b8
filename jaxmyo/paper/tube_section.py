"""The section of the report on the tube."""

from collections.abc import Sequence
from pathlib import Path

from jaxmyo.paper import report
from jaxmyo.paper.homogeneous import CONSTRAINT
from jaxmyo.paper.report import Section
from jaxmyo.paper.sample import activation
from jaxmyo.paper.tube import A_OVER_D, ENDS, GRADING, KINDS, T0_KPA, Tube, pressure
from jaxmyo.paper.tube_accuracy import Accuracy
from jaxmyo.paper.tube_results import TubeResults
from jaxmyo.paper.tube_tension import Change
from jaxmyo.scenes.tube import HEIGHT, RI, RO

END_LABELS = ("0", "½")


def tube(name: str, results: TubeResults, figures: Sequence[Path]) -> Section:
    """The tube with the constants `name`; figures: as `tube_output.write_figures` gives them."""
    of_cycle, accuracy = results.tube, results.accuracy
    return Section(
        "Active thick-walled tube",
        text=[
            f"A tube of radii {RI:g} and {RO:g} mm and height {HEIGHT:g} mm, fibres around, struts of the weave along "
            "the axis, planar ends, over a cycle β(s) = sin² πs with the inner pressure P = 8 + 10 sin² πs kPa. Its "
            "ends are open: the pressure acts on the inner wall only. The paper does not give T0 and a/D of the tube: "
            f"T0 = {T0_KPA:g} kPa and a/D = {A_OVER_D:g} are a choice. It says nothing of the tube in numbers but the "
            "error, so a statement in words counts as reproduced if the numbers have the sign that it says.",
            f"{of_cycle.elements} elements through the wall, the outermost {GRADING:g} times the innermost; one "
            f"multiplier q of the weave for the whole wall. {len(of_cycle.s)} times, with and without the constraint, "
            "each state C from the one before, the first from the passive tube. All states converged, the largest "
            f"relative residual is {of_cycle.residual:.1e}; {_stability(of_cycle)}. Activation and pressure are in "
            "phase, so that the way up (s < ½) and the way down are the same states: the radii differ by at most "
            f"{of_cycle.up_and_down:.0e} mm, and the radii do not lag behind the pressure.",
            "The exact tube: three numbers (inner radius, height, q) from integrals over the wall, the incompressible "
            "deformation given. The error of the elements as they are is the L2 norm over the wall. Extrapolated: the "
            "polynomial in h² through the radii of all meshes at h = 0, at the nodes of the coarsest.",
            "The states A and C at s = 0 and s = ½, with and without the constraint, are in the files tube_*.vtu with "
            "all their fields, for ParaView.",
        ],
        claims=results.claims,
        tables=[
            _states(name, of_cycle),
            _exact(name, accuracy),
            _errors(name, accuracy),
            _meshes(accuracy),
            _changes(name, results.changes),
        ],
        figures=list(zip(figures, _captions(name, of_cycle, accuracy), strict=True)),
    )


def _stability(tube: Tube) -> str:
    unstable = sum(int((tube.walls(kind).negative > 0).sum()) for kind in KINDS)
    return f"{unstable} states are unstable" if unstable else "no state is unstable"


def _states(name: str, tube: Tube) -> report.Table:
    rows = []
    for kind in KINDS:
        for label, k in zip(END_LABELS, tube.ends, strict=True):
            for c, acting in enumerate(CONSTRAINT):
                wall, A = tube.walls(kind).at(c, k), tube.A.at(c, k)
                lengths = [f"{x:.5f}" for x in (wall.ri, wall.ro, wall.thickness, wall.height)]
                q = f"{A.q:.4f}" if kind == "A" and acting else "–"
                tensions = [f"{T:.4f}" for T in (*A.T_f, A.T_cf[0])]
                rows.append([kind, label, "yes" if acting else "no", *lengths, q, *tensions])
    return report.Table(
        f"The tube at s = 0 (β = 0, P = {pressure(0.0):g} kPa in state C) and s = ½ (β = 1, P = {pressure(1.0):g} kPa "
        f"in state C), {tube.elements} elements, {_case(name)}. A: free contraction, no load; T_f, T_cf: pseudo-active "
        "tensions of A, which act in C too, at the Gauss points next to the walls; T_cf is the same at both",
        (
            "state",
            "s [–]",
            "constraint",
            "ri [mm]",
            "ro [mm]",
            "wall [mm]",
            "height ratio [–]",
            "q [kPa]",
            "T_f inside [kPa]",
            "T_f outside [kPa]",
            "T_cf [kPa]",
        ),
        rows,
        row_headers=3,
    )


def _exact(name: str, accuracy: Accuracy) -> report.Table:
    rows = []
    for kind in KINDS:
        for end, label in enumerate(END_LABELS):
            for c, acting in enumerate(CONSTRAINT):
                wall = accuracy.exact[c][end].of(kind)
                q = f"{wall.q:.9f}" if kind == "A" and acting else "–"
                lengths = [f"{x:.12f}" for x in (wall.ri, wall.ro, wall.height)]
                rows.append([kind, label, "yes" if acting else "no", *lengths, q])
    return report.Table(
        f"The exact tube, {_case(name)}",
        ("state", "s [–]", "constraint", "ri [mm]", "ro [mm]", "height ratio [–]", "q [kPa]"),
        rows,
        row_headers=3,
    )


def _errors(name: str, accuracy: Accuracy) -> report.Table:
    rows = []
    for i, kind in enumerate(KINDS):
        for c, acting in enumerate(CONSTRAINT):
            cells = [kind, "yes" if acting else "no", f"{accuracy.raw[0, i, c, 1]:.2e}"]
            for mesh, orders in enumerate(accuracy.orders, 1):
                cells += [f"{accuracy.raw[mesh, i, c, 1]:.2e}", f"{orders[i, c]:.3f}"]
            rows.append([*cells, f"{accuracy.extrapolated[i, c, 1]:.1e}"])
    first, *finer = (tube.elements for tube in accuracy.tubes)
    header = [f"{first} elements", *(text for n in finer for text in (f"{n} elements", "order [–]"))]
    return report.Table(
        f"Relative L2 error [–] of the radii at s = ½, observed orders of convergence, {_case(name)}",
        ("state", "constraint", *header, "extrapolated"),
        rows,
        row_headers=2,
    )


def _meshes(accuracy: Accuracy) -> report.Table:
    rows = [
        [f"{t.elements}", f"{2 * len(CONSTRAINT) * len(t.s)}", f"{t.solve_s:.2f}", f"{t.total_s:.1f}"]
        for t in accuracy.tubes
    ]
    return report.Table(
        "Time of these solves, measured while other programs of the report compiled. Total: with the setting up and "
        "the compilation of the two programs of a mesh (or their reading, if an earlier run has kept them)",
        ("elements", "states A and C", "solves [s]", "total [s]"),
        rows,
    )


def _changes(name: str, changes: Sequence[Change]) -> report.Table:
    rows = [[f"{c.T0:g}", f"{c.with_constraint:+.5f}", f"{c.without:+.5f}"] for c in changes]
    return report.Table(
        "Change of the inner radius under pressure from s = 0 to s = ½ for other tensions T0, exact tube, "
        f"a/D = {A_OVER_D:g}, constants: {name}",
        ("T0 [kPa]", "with the constraint [mm]", "without [mm]"),
        rows,
    )


def _captions(name: str, tube: Tube, accuracy: Accuracy) -> list[str]:
    symbols = "Open symbols: the coupling by the kinematic constraint acts; full symbols: it does not"
    states = f"State C under the pressure P = 8 + 10 β kPa, s from 0 to ½; {_case(name)}"
    times = f"{len(tube.s)} times s"
    meshes = ", ".join(str(t.elements) for t in accuracy.tubes)
    half = f"β = {activation(ENDS)[1]:g}"
    return [
        f"Pressure P [kPa] and tonus β T0 [kPa] over the time s [–] of the cycle ({times}) and against the degree of "
        "activation β [–], there with the pseudo-active tensions T_f, T_cf [kPa] that the weave leaves in state A; "
        f"{_case(name)}.",
        f"Height over that of the undeformed tube [–] against the degree of activation β [–]. {states}. {symbols}; the "
        "arrow goes from without to with.",
        f"Inner radius [mm] against the degree of activation β [–]. {states}. {symbols}; the arrow goes from without "
        "to with.",
        f"Outer radius [mm] against the degree of activation β [–]. {states}. {symbols}; the arrow goes from without "
        "to with.",
        f"Relative L2 error [–] of the radii against the number of elements through the wall ({meshes}), and "
        f"extrapolated in h² from all of them, at s = ½; {_case(name)}. {symbols}.",
        f"Outer and inner radius [mm] at s = ½ ({half}) against the stiffness k [kPa] of the weave, whose energy is "
        f"½ k h²; {_case(name)}. With one q for the whole wall the exact constraint is the limit of a stiff weave. "
        "With a q in each element (symbols), or at every radius (dashed), a stiff weave locks: planar ends, det F = 1 "
        "and h = 0 at every radius leave a free tube no deformation, however fine the mesh.",
    ]


def _case(name: str) -> str:
    return f"T0 = {T0_KPA:g} kPa, a/D = {A_OVER_D:g}, constants: {name}"
