"""Where the page listens: on loopback unless somebody says otherwise on purpose, and on no other port than was named.

Without viser, which takes long to load: a controller asks here before it starts its page.
"""

from __future__ import annotations

import errno
import socket
from typing import Any

from ori_deploy.errors import InputError

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})

PORT = 8080
"""Where the page is unless somebody says otherwise, or on one of the next."""
_NEXT_PORTS = 20


def own_host(host: str, *, beyond_loopback: bool = False, option: str = "--host") -> str:
    """A host without the brackets that an address has round it.

    Raises
    ------
    InputError
        Not on loopback, and nobody said so on purpose.
    """
    bare = host.removeprefix("[").removesuffix("]")
    if bare not in LOOPBACK and not beyond_loopback:
        raise InputError(
            f"{option}: other machines could reach the page",
            value=host,
            limit="127.0.0.1",
            remedy="say --beyond-loopback, and give the address with its token to nobody else",
        )
    return bare


def listening(host: str, port: int | None, names: tuple[str, str] = ("--host", "--port")) -> socket.socket:
    """A socket that listens there.

    Parameters
    ----------
    host
        A `Door`'s.
    port
        0: any that is free. None: `PORT`, or the next one that is free; a port that somebody named is never another.
    names
        Options that gave both.

    Raises
    ------
    InputError
        Not this machine's host, or somebody else's port.
    """
    try:
        family, _, _, _, place = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        _listen(family, place, 0).close()
    except (OSError, UnicodeError) as wrong:
        raise InputError(
            f"{names[0]}: cannot listen there", value=host, limit="an address of this machine", remedy="127.0.0.1"
        ) from wrong
    ports = range(PORT, PORT + _NEXT_PORTS) if port is None else (port,)
    for one in ports:
        try:
            return _listen(family, place, one)
        except OSError as wrong:
            busy = wrong
    told = "cannot be had" if busy.errno != errno.EADDRINUSE else "in use"
    raise InputError(
        f"{names[1]}: the port is {told}",
        value=ports[0] if len(ports) == 1 else f"{ports[0]} to {ports[-1]}",
        limit="a free port",
        remedy="0 takes any; an earlier page goes when its controller has ended and its tabs are closed",
    ) from busy


def _listen(family: int, place: tuple[Any, ...], port: int) -> socket.socket:
    ear = socket.socket(family, socket.SOCK_STREAM)
    try:
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        ear.bind((place[0], port, *place[2:]))
        ear.listen(100)
    except BaseException:
        ear.close()
        raise
    return ear
