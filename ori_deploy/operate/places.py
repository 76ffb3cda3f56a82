"""Where the sockets of running controllers are, and which of them belong to programs that are no more."""

from __future__ import annotations

import socket
from pathlib import Path

SUFFIX = ".sock"
_CONNECT_S = 1.0


def socket_path(folder: Path, pid: int) -> Path:
    """The socket of the controller in a process."""
    return folder / f"{pid}{SUFFIX}"


def sockets(folder: Path) -> tuple[tuple[int, Path], ...]:
    """Pids and sockets that lie in a folder, whether somebody listens or not."""
    try:
        found = [path for path in folder.iterdir() if path.suffix == SUFFIX and path.stem.isascii()]
        return tuple(sorted((int(path.stem), path) for path in found if path.stem.isdigit() and path.is_socket()))
    except OSError:
        return ()


def remove_stale(folder: Path) -> None:
    """Remove sockets that nobody listens at and whose process is gone, as kill -9 leaves them."""
    for pid, path in sockets(folder):
        # Both: one that is just being made is not listened at yet, and numbers of processes are used again.
        if not Path(f"/proc/{pid}").exists() and not listened_at(path):
            path.unlink(missing_ok=True)


def listened_at(path: Path) -> bool:
    """Whether a program answers at a socket, or is too busy to."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(_CONNECT_S)
        try:
            probe.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except OSError:
            return True  # busy, or not ours to judge
    return True
