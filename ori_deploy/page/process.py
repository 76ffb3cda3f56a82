"""Whether a process is gone: what does not answer may be moving, what is gone no longer commands anything."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

_OVER = "ZX"
"""States of a process that has ended, and that nobody has asked about yet."""
_STATE, _BEGAN = 0, 19
"""Places in /proc/PID/stat, after the name."""


@dataclass(frozen=True)
class Process:
    """A process, told apart from a later one with the same number.

    Attributes
    ----------
    pid
        Its number.
    began
        When it was started, in the kernel's ticks since it booted; None where it was gone already.
    """

    pid: int
    began: int | None

    @classmethod
    def of(cls, pid: int) -> Process:
        """The one that has this number now."""
        return cls(pid, _began(pid))

    @property
    def gone(self) -> bool:
        """Whether it is known to have ended; where nothing can be known, it may be running."""
        try:
            return self.began is None or _began(self.pid) != self.began
        except OSError:
            return False


def _began(pid: int) -> int | None:
    """When a process was started, or None where there is none. Raises `OSError` where that cannot be found out."""
    try:
        told = Path(f"/proc/{pid}/stat").read_text(errors="replace")
    except (FileNotFoundError, ProcessLookupError):
        if not Path("/proc/self/stat").exists():
            raise
        return None
    words = told.rpartition(")")[2].split()  # a name may have blanks and brackets
    return None if words[_STATE] in _OVER else int(words[_BEGAN])
