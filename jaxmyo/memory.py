"""Memory that is free, but still of this process."""

import ctypes
import sys


def give_back() -> None:
    """Give it back to the system: glibc keeps what was freed in many small pieces, hundreds of megabytes of it."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)
