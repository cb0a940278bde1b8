"""What a solve tells while it runs: lines to the logger "jaxmyo", a progress bar, and a look at the clock."""

import logging
import time
from types import TracebackType
from typing import Any

from jaxmyo import checks
from jaxmyo.linear import At

LOG = logging.getLogger("jaxmyo")


def wanted() -> bool:
    """Whether someone reads the lines."""
    return LOG.isEnabledFor(logging.INFO)


def iteration(number: Any, at: At, alpha: Any, correction: Any, taken: bool) -> None:
    """One line per Newton iteration."""
    if wanted():
        LOG.info(
            "    iteration %2d  residual %.2e  step length %.3g  correction %.2e%s",
            int(number),
            float(at.residual),
            float(alpha),
            float(correction),
            "" if taken else "  refused",
        )


class Watch:
    """The progress of one path: a bar if it is wanted, and whether its time is over."""

    def __init__(self, time_limit: float | None, progress: bool) -> None:
        self._end = None if time_limit is None else time.monotonic() + time_limit
        self._bar: Any = None
        if progress:
            try:
                from tqdm import tqdm
            except ModuleNotFoundError as error:
                raise checks.missing(error, "a progress bar needs", "tqdm") from error
            self._bar = tqdm(total=100.0, unit="%", bar_format="{desc}{percentage:3.0f} % |{bar}| {elapsed}{postfix}")

    @property
    def is_over(self) -> bool:
        """Whether the time limit has passed."""
        return self._end is not None and time.monotonic() > self._end

    def step(self, number: Any, t: Any, status: str, residual: Any, iterations: Any) -> None:
        """A load step has ended."""
        if wanted():
            LOG.info(
                "  step %d to %.4g %% of the path: %s, residual %.2e, %d iterations",
                int(number),
                100.0 * float(t),
                status,
                float(residual),
                int(iterations),
            )
        if self._bar is not None:
            self._bar.update(max(0.0, 100.0 * float(t)) - self._bar.n)
            self._bar.set_postfix_str(f"step {int(number)}, residual {float(residual):.1e}")

    def __enter__(self) -> "Watch":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()
