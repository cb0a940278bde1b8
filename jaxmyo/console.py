"""What the commands of `jaxmyo` have in common: lines on stderr, a folder to write to, versions."""

import platform
import sys
from importlib.metadata import version
from pathlib import Path


def say(text: str) -> None:
    """A line on stderr; stdout is for results."""
    print(text, file=sys.stderr, flush=True)


def make_writable(out: Path) -> None:
    """Make a folder; an OSError if nothing can be written there, before anything is computed."""
    out.mkdir(parents=True, exist_ok=True)
    (out / ".writable").touch()
    (out / ".writable").unlink()


def versions(*packages: str) -> dict[str, str]:
    """The versions of Python and of installed packages."""
    return {"python": platform.python_version(), **{p: version(p) for p in packages}}
