"""What the paper says of the tube in words and one number, each beside the numbers that come out here."""

from collections.abc import Sequence

from jaxmyo.paper.claims import Claim
from jaxmyo.paper.sample import activation
from jaxmyo.paper.tube import A_OVER_D, T0_KPA, Tube, pressure
from jaxmyo.paper.tube_accuracy import PAPER_ERROR, Accuracy
from jaxmyo.paper.tube_tension import Change

CASE = f"tube, T0 = {T0_KPA:g} kPa, a/D = {A_OVER_D:g}"
IN_WORDS = "(no number given)"


def claims(tube: Tube, accuracy: Accuracy, changes: Sequence[Change]) -> list[Claim]:
    """The statements about the tube; those in words are reproduced if the numbers have the sign that they say."""
    rest, half = tube.ends
    ri, ro, wall, height = tube.C.ri, tube.C.ro, tube.C.thickness, tube.C.height  # each constraint × time
    by_constraint = [float(x[0, half] - x[1, half]) for x in (ri, ro)]
    fall = ri[:, half] - ri[:, rest]
    T_f, T_cf = tube.A.T_f[0, half], tube.A.T_cf[0, half]
    finest = accuracy.tubes[-1].elements
    meshes = ", ".join(str(t.elements) for t in accuracy.tubes)
    P = pressure(activation(tube.s))
    return [
        Claim(
            f"the constraint thickens the wall under pressure (state C at s = ½; {CASE})",
            f"wall thickening effect {IN_WORDS}",
            f"wall {wall[0, half]:.4f} mm with, {wall[1, half]:.4f} mm without",
            bool(wall[0, half] > wall[1, half]),
        ),
        Claim(
            f"the constraint makes the tube contract in the z direction (state C at s = ½; {CASE})",
            f"contraction in z {IN_WORDS}",
            f"height ratio {height[0, half]:.4f} with, {height[1, half]:.4f} without",
            bool(height[0, half] < height[1, half]),
        ),
        Claim(
            f"without the constraint both radii increase when the pressure decreases, from s = ½ to s = 1 ({CASE})",
            f"both increase {IN_WORDS}",
            f"P {P[half]:g} → {P[-1]:g} kPa: ri {ri[1, half]:.4f} → {ri[1, -1]:.4f} mm, "
            f"ro {ro[1, half]:.4f} → {ro[1, -1]:.4f} mm",
            bool(ri[1, -1] > ri[1, half] and ro[1, -1] > ro[1, half]),
        ),
        Claim(
            f"with the constraint the inner radius decreases from s = 0 to s = ½, but less than without ({CASE})",
            f"decreases less {IN_WORDS}",
            f"by {-fall[0]:.4f} mm with, {-fall[1]:.4f} mm without; {_over_tensions(changes)}",
            _less(float(fall[0]), float(fall[1])),
        ),
        Claim(
            f"the constraint has more effect on the outer radius than on the inner one (state C at s = ½; {CASE})",
            f"the more important effect {IN_WORDS}",
            f"it changes ro by {by_constraint[1]:+.4f} mm, ri by {by_constraint[0]:+.4f} mm",
            abs(by_constraint[1]) > abs(by_constraint[0]),
        ),
        Claim(
            f"the pseudo-active tensions T_f and T_cf are greater at the outer wall than at the inner ({CASE})",
            f"greater {IN_WORDS}",
            f"|T_f| {abs(T_f[1]):.4f} kPa outside, {abs(T_f[0]):.4f} inside; "
            f"T_cf {T_cf[1]:.4f} kPa outside, {T_cf[0]:.4f} inside",
            bool(abs(T_f[1]) > abs(T_f[0]) and T_cf[1] > T_cf[0] * (1.0 + 1e-9)),
        ),
        Claim(
            f"relative L2 norm of the error, {finest} elements through the wall ({CASE})",
            f"less than {PAPER_ERROR:.0e} in all the cases",
            f"at most {accuracy.raw[-1].max():.1e}, falling like 1/n² with the number n of elements",
            bool(accuracy.raw[-1].max() < PAPER_ERROR),
        ),
        Claim(
            f"relative L2 norm of the error, extrapolated in h² from {meshes} elements ({CASE})",
            f"less than {PAPER_ERROR:.0e} in all the cases",
            f"at most {accuracy.extrapolated.max():.1e}",
            bool(accuracy.extrapolated.max() < PAPER_ERROR),
        ),
    ]


def _less(with_constraint: float, without: float) -> bool:
    """Whether both changes of the inner radius are decreases, and the first is the smaller one."""
    return without < with_constraint < 0.0


def _over_tensions(changes: Sequence[Change]) -> str:
    """Whether the statement of the inner radius comes out at another T0."""
    found = [f"{c.T0:g}" for c in changes if _less(c.with_constraint, c.without)]
    tried = f"{changes[0].T0:g} to {changes[-1].T0:g} kPa"
    if found:
        return f"of T0 = {tried} it comes out at {', '.join(found)} kPa"
    ends = [f"{c.T0:g} kPa {c.with_constraint:+.4f} with, {c.without:+.4f} without" for c in (changes[0], changes[-1])]
    return f"at no T0 from {tried} (change in mm at {'; '.join(ends)})"
