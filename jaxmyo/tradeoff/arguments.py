"""The arguments of `jaxmyo tradeoff`."""

import argparse
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Add the command to those of the parser."""
    tradeoff = commands.add_parser(
        "tradeoff",
        help="what accuracy costs: error against time and memory, over mesh, quadrature, precision, tolerance, ...",
        description="Six bodies, each solved at many settings of the dials that trade speed for accuracy, and compared "
        "with its exact or a much finer solution. Writes a table (CSV), a report (Markdown) with the errors by source "
        "and what each dial costs and buys, a figure of the Pareto front of each body, and the fronts as data. "
        "The same command goes on with a run that was interrupted.",
    )
    tradeoff.add_argument("--quick", action="store_true", help="coarser meshes and fewer settings: some minutes")
    tradeoff.add_argument("--out", type=Path, default=Path("tradeoff-out"), metavar="DIR", help="default: %(default)s")
    tradeoff.add_argument("--json", action="store_true", help="one JSON object on stdout instead of the summary")
    tradeoff.set_defaults(run=_run)


def _run(options: argparse.Namespace, started: float) -> int:
    from jaxmyo.tradeoff import command

    return command.run(options, started)
