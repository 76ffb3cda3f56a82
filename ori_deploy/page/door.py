"""Who is let in: the one door through which browsers reach the page.

viser answers whoever asks, and so any site that the operator has open in another tab could speak to a page on
loopback. Therefore nothing is answered without the secret that the page's address carries, nor to a browser that
shows somebody else's page, nor under a name that is not the machine's own.
"""

from __future__ import annotations

import hmac
import http
import secrets
import socket
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import rich
import viser
import viser._messages as messages
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ori_deploy.errors import InputError
from ori_deploy.page.listening import LOOPBACK, own_host

CHANNEL = "operate"
"""The last part of the path of the operator's own socket, beside the one of the scene."""

_MOST_MESSAGES = 1 << 14
"""That go to a browser in one piece."""

Channel = Callable[[ServerConnection], Awaitable[None]]


@dataclass(frozen=True)
class Door:
    """What is let in.

    Attributes
    ----------
    token
        The secret; part of the address.
    host
        Where the page listens.
    """

    token: str
    host: str

    @classmethod
    def on(
        cls, host: str, *, beyond_loopback: bool = False, token: str | None = None, option: str = "--host"
    ) -> Door:
        """A door with a new secret; `option` is the one that gave the host.

        Raises
        ------
        InputError
            Not on loopback, and nobody said so on purpose.
        """
        bare = own_host(host, beyond_loopback=beyond_loopback, option=option)
        return cls(secrets.token_urlsafe(18) if token is None else token, bare)

    def address(self, port: int) -> str:
        """What to open in a browser."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/{self.token}"

    def refuses(self, path: str, host: str | None, origin: str | None) -> str | None:
        """Why a request is not answered; None where it is.

        Parameters
        ----------
        path
            Of its address.
        host, origin
            Its headers of these names. Browsers send an origin with every websocket, programs none.
        """
        given = _path(path).split("/")[0]
        if not hmac.compare_digest(given.encode(errors="replace"), self.token.encode()):
            return "the address lacks the token that was printed when the page began"
        try:
            name = urlsplit(f"//{host or ''}").hostname
            from_where = None if origin is None else urlsplit(origin).netloc
        except ValueError:
            return "asked for in a way that no browser would"
        if self.host in LOOPBACK and (name is None or f"{name}" not in LOOPBACK):
            return "asked for under another name"  # some site's name that leads to loopback
        if origin is not None and from_where != host:
            return "asked for by another site's page"
        return None


def part_of(path: str) -> str:
    """What comes after the token."""
    return _path(path).partition("/")[2]


def _path(target: str) -> str:
    """What a request asks for, without what follows a question mark; never a host, whatever stands there."""
    return target.partition("?")[0].partition("#")[0].strip("/")


@contextmanager
def _behind(door: Door, ear: socket.socket, page: bytes, channel: Channel | None) -> Iterator[list[Door]]:
    """Until the end of the block a websocket server that is started stands behind the door, and uses our ear.

    viser has no place to put either; it starts its server with this function, and looks for a port on its own, with
    neither an end nor a word. The list that is yielded is empty until it has done so.
    """
    stands: list[Door] = []
    real = websockets.asyncio.server.serve

    def serve(handler: Callable[[ServerConnection], Awaitable[None]], *where: Any, **how: Any) -> Any:
        del where, how["process_request"]

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            del connection
            headers = request.headers
            why = door.refuses(request.path, headers.get("Host"), headers.get("Origin"))
            if why is not None:
                return _text(http.HTTPStatus.FORBIDDEN, f"refused: {why}\n".encode(), "text/plain; charset=utf-8")
            if headers.get("Upgrade", "").lower() == "websocket":
                return None
            if part_of(request.path):
                return _text(http.HTTPStatus.NOT_FOUND, b"nothing here\n", "text/plain; charset=utf-8")
            return _text(http.HTTPStatus.OK, page, "text/html; charset=utf-8")

        async def handle(connection: ServerConnection) -> None:
            path = connection.request.path if connection.request is not None else ""
            if part_of(path) != CHANNEL:
                await handler(connection)
            elif channel is not None:
                await channel(connection)

        stands.append(door)
        return real(handle, sock=ear, process_request=answer, **how)

    websockets.asyncio.server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield stands
    finally:
        websockets.asyncio.server.serve = real  # type: ignore[misc]


def _text(status: http.HTTPStatus, body: bytes, kind: str) -> Response:
    headers = Headers(
        {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
            "X-Frame-Options": "DENY",
            "Connection": "close",
        }
    )
    return Response(status.value, status.phrase, headers, body)


def open_server(door: Door, ear: socket.socket, page: bytes, channel: Channel | None = None) -> viser.ViserServer:
    """A viser server behind a door; an operator's own socket beside it.

    Parameters
    ----------
    ear
        What `listening` made.

    Raises
    ------
    InputError
        This viser cannot be guarded.
    """
    rich.get_console().quiet = True  # its banner tells an address that is refused
    with _behind(door, ear, page, channel) as stands:
        server = viser.ViserServer(host=door.host, port=ear.getsockname()[1], verbose=False)
    if not stands:
        server.stop()
        raise InputError(
            "the page cannot be guarded with this version of viser", value=viser.__version__, limit=">= 1.1, < 2"
        )
    # Any browser could ask viser to put the page on the internet.
    for kind in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(kind)
    # viser tears what is sent as one into pieces of 128 messages, and a browser draws in between: a pose of 24 cells
    # is more than that.
    server._websock_server.get_message_buffer().max_window_size = _MOST_MESSAGES
    return server
