"""The arguments of `jaxmyo stability`."""

import argparse
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Add the command to those of the parser."""
    stability = commands.add_parser(
        "stability",
        help="the inf-sup test, checkerboards, maps of the extremes, and thousands of random problems",
        description="Measure how stable the elements and the solves are: the numerical inf-sup test of p, q and both "
        "over meshes, patches and coordinates; checkerboards of p and q, and how patches remove them; maps of the "
        "extremes with a status at each point; random problems over those extremes, held against hand-made equations "
        "and a branch followed from rest. Writes report.md, CSV files and figures.",
    )
    stability.add_argument(
        "--out", type=Path, default=Path("stability-out"), metavar="DIR", help="default: %(default)s"
    )
    stability.add_argument(
        "--quick", action="store_true", help="coarser meshes, fewer problems, nothing in three dimensions"
    )
    stability.add_argument("--json", action="store_true", help="one JSON object on stdout")
    stability.set_defaults(run=_run)


def _run(options: argparse.Namespace, started: float) -> int:
    from jaxmyo.stability import command

    return command.run(options.out, options.quick, options.json, started)
