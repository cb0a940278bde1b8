"""The arguments of `jaxmyo paper`."""

import argparse
from pathlib import Path
from typing import Any

from jaxmyo.constants import SETS


def add(commands: Any) -> None:
    """Add the command to those of the parser."""
    paper = commands.add_parser(
        "paper",
        help="recompute the paper's results and compare them with what it prints",
        description="Recompute the results of the paper: of the thin sample Table 1, the free contraction and the "
        "uniaxial tests, of the active tube its cycle and how far it is from the exact solution. Print Table 1 beside "
        "the printed values; write CSV files, states of the tube for ParaView (.vtu), figures, and report.html, which "
        "shows it all and holds every statement of the paper against what comes out.",
    )
    paper.add_argument("--out", type=Path, default=Path("paper-out"), metavar="DIR", help="default: %(default)s")
    paper.add_argument(
        "--set",
        choices=list(SETS),
        help="one set of material constants for the table, the figures and the tube (default: Table 1 with all three, "
        "everything else with table1)",
    )
    paper.add_argument("--json", action="store_true", help="one JSON object on stdout instead of the table")
    paper.set_defaults(run=_run)


def _run(options: argparse.Namespace, started: float) -> int:
    from jaxmyo.paper import command

    return command.run(options.out, options.set, options.json, started)
