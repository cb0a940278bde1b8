"""The arguments of `jaxmyo fit`."""

import argparse
from pathlib import Path
from typing import Any

LAWS = ("lin-yin", "guccione")
#: What can be fitted by a name instead of a file, and the options that it has; all others are for files.
CASES: dict[str, tuple[str, ...]] = {"lin-yin": (), "table1": ("starts", "seed")}


def add(commands: Any) -> None:
    """Add the command to the parser's commands."""
    fit = commands.add_parser(
        "fit",
        help="fit the constants of a law to measured curves, and say what the curves can tell",
        description="Fit the constants of a law to measured curves (a CSV file: columns such as protocol, state, "
        "stretch_f, stretch_cf, cauchy_f [kPa], see jaxmyo/data.py), and print the estimates with their intervals. "
        "'lin-yin' fits the curves of Lin and Yin 1998, Fig. 4, that come with the package; 'table1' finds the "
        "constants that Table 1 of the paper was computed with. Writes a figure of data and fit and a JSON file of "
        "everything needed to repeat it.",
    )
    fit.add_argument("data", metavar="DATA.csv", help="a CSV file, or one of: " + ", ".join(CASES))
    fit.add_argument("--law", choices=LAWS, default="lin-yin", help="default: %(default)s")
    fit.add_argument("--free", metavar="NAMES", help="fit these, e.g. C1p,T0=0.6 (default: the constants)")
    fit.add_argument("--fix", metavar="NAMES", help="do not fit these, e.g. C3p=-2.6,C4p")
    fit.add_argument("--per-protocol", metavar="NAMES", default="", help="a value of their own for each protocol")
    fit.add_argument("--T0", type=float, default=0.0, metavar="KPA", help="beating tension (default: %(default)s)")
    fit.add_argument("--a-over-D", type=float, metavar="RATIO", help="with the weave, a/D of it (default: without)")
    fit.add_argument("--starts", type=int, metavar="N", help="the given start and N-1 random ones (default: 1)")
    fit.add_argument("--seed", type=int, default=0, metavar="N", help="of the random starts (default: %(default)s)")
    fit.add_argument("--loss", choices=["linear", "soft_l1", "huber", "cauchy"], default="linear")
    fit.add_argument("--loss-scale", type=float, default=1.0, metavar="KPA", help="of a robust loss")
    fit.add_argument("--out", type=Path, default=Path("fit-out"), metavar="DIR", help="default: %(default)s")
    fit.add_argument("--json", action="store_true", help="one JSON object on stdout instead of the table")

    def run(options: argparse.Namespace, started: float) -> int:
        own = CASES.get(options.data, tuple(vars(options)))
        for name, value in vars(options).items():
            if name not in (*own, "data", "out", "json") and value != fit.get_default(name):
                option = "--" + name.replace("_", "-")
                fit.error(f"{option} is for a file of data; {options.data} is fitted as it stands")
        from jaxmyo.fitting import command

        return command.run(options, started)

    fit.set_defaults(run=run)
