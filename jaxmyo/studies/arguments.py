"""The arguments of `jaxmyo study`."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo.constants import SETS
from jaxmyo.studies.design import check_range

RANGE = "START:STOP:N"


def add(commands: Any) -> None:
    """Add the command to those of the parser."""
    study = commands.add_parser(
        "study",
        help="the thin sample over a grid of a/D, T0 and beta: free contraction and loaded state",
        description="The thin sample of the paper over a grid: the free contraction A, and the state C at a biaxial "
        "stretch, for every a/D, T0 and beta. Writes study.csv, study.nc (NetCDF) and a figure of contours. The same "
        "command goes on with a study that was interrupted.",
    )
    study.add_argument(
        "--a-over-D",
        type=_axis("--a-over-D", "a_over_D"),
        default="0:0.25:26",
        metavar=RANGE,
        help="a/D [–], N values from START to STOP, or one number (default: %(default)s)",
    )
    study.add_argument(
        "--T0",
        type=_axis("--T0", "T0"),
        default="1:60:60",
        metavar=RANGE,
        help="beating tension [kPa] (default: %(default)s)",
    )
    study.add_argument(
        "--beta",
        type=_axis("--beta", "beta"),
        default="1",
        metavar=RANGE,
        help="degree of activation [–] (default: %(default)s); the figure is of the largest",
    )
    study.add_argument(
        "--stretch",
        nargs=2,
        type=_stretch,
        default=(1.2, 1.2),
        metavar=("X", "Y"),
        help="stretches of state C along the fibres and across them [–] (default: 1.2 1.2, as in Table 1)",
    )
    study.add_argument(
        "--set", choices=list(SETS), default="table1", help="set of material constants (default: %(default)s)"
    )
    study.add_argument("--out", type=Path, default=Path("study-out"), metavar="DIR", help="default: %(default)s")
    study.add_argument("--json", action="store_true", help="one JSON object on stdout instead of the summary")
    study.add_argument(
        "--distributed",
        action="store_true",
        help="one of several processes, started by SLURM or mpirun, that share the work and see the same DIR",
    )
    study.set_defaults(run=_run)


def _run(options: argparse.Namespace, started: float) -> int:
    from jaxmyo.studies import command

    return command.run(options, started)


def _axis(option: str, name: str) -> Callable[[str], NDArray[np.float64]]:
    def parse(text: str) -> NDArray[np.float64]:
        try:
            parts = text.split(":")
            if len(parts) == 1:
                values = np.array([float(text)])
            else:
                start, stop, n = (kind(part) for kind, part in zip((float, float, int), parts, strict=True))
                values = np.linspace(start, stop, n)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is neither {RANGE} (as 0:0.25:6) nor a number") from None
        if not np.isfinite(values).all():
            raise argparse.ArgumentTypeError(f"{text!r} is not finite")
        if not values.size or (len(parts) > 1 and not start < stop):
            raise argparse.ArgumentTypeError(f"{text!r} must have START < STOP and N ≥ 1")
        return _checked(option, name, values)

    return parse


def _stretch(text: str) -> float:
    try:
        return float(_checked("--stretch", "stretch", np.array(float(text))))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from None


def _checked(option: str, name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    try:
        check_range(option, name, values)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return values
