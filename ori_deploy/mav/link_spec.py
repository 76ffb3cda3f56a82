"""Links of the vehicle's network as people write them: `udpin:127.0.0.1:14550`, `serial:/dev/ttyUSB0:57600`."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from typing import Literal, get_args

from ori_deploy.errors import InputError

LinkKind = Literal["udpin", "udpout", "tcpin", "tcp", "serial"]

FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD"
LISTENING = ("udpin", "tcpin")
HIGHEST_PORT = 65535
BAUDS = (300, 4_000_000)
HOST_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?")


@dataclass(frozen=True, slots=True)
class LinkSpec:
    """A link.

    Attributes
    ----------
    kind
        `udpin` and `tcpin` listen, `udpout` and `tcp` call, `serial` is a device.
    place
        Host, or device.
    number
        Port, or baud rate. Port 0, where it listens, is any free one.
    """

    kind: LinkKind
    place: str
    number: int

    def __str__(self) -> str:
        place = f"[{self.place}]" if self.kind != "serial" and ":" in self.place else self.place
        return f"{self.kind}:{place}:{self.number}"


def parse_link(text: str, beyond_loopback: bool = False) -> LinkSpec:
    """The link that a text names.

    Parameters
    ----------
    text
        One of `FORMS`. An IPv6 address stands in brackets.
    beyond_loopback
        Whether links may listen where other machines reach them.

    Raises
    ------
    InputError
        It names none, or listens on more than loopback where that was not said.
    """
    kind, _, rest = text.partition(":")
    place, colon, number = rest.rpartition(":")
    for known in get_args(LinkKind):
        if kind == known and colon:
            spec = LinkSpec(known, _device(text, place) if known == "serial" else _host(text, place), 0)
            spec = LinkSpec(known, spec.place, _number(text, known, number))
            if known in LISTENING and not beyond_loopback and not _is_loopback(spec.place):
                raise InputError(
                    f"link {text}: listens where other machines reach it",
                    value=spec.place,
                    limit="loopback: 127.0.0.1, ::1 or localhost",
                    remedy="listen on 127.0.0.1, or say that others may: --beyond-loopback, "
                    "or beyond_loopback = true in the settings",
                )
            return spec
    raise InputError(f"link {text!r}: not a link", limit=FORMS, remedy="mend it, for instance udpin:127.0.0.1:14550")


def _number(text: str, kind: LinkKind, number: str) -> int:
    what = "baud rate" if kind == "serial" else "port"
    lowest, highest = BAUDS if kind == "serial" else (0 if kind in LISTENING else 1, HIGHEST_PORT)
    if not (number.isascii() and number.isdigit() and len(number) < 9 and lowest <= int(number) <= highest):
        raise InputError(
            f"link {text}: {what}", value=repr(number), limit=f"{lowest} to {highest}", remedy=f"mend the {what}"
        )
    return int(number)


def _device(text: str, place: str) -> str:
    if not place or not place.isprintable():
        raise InputError(
            f"link {text!r}: device", value=repr(place), limit="a path", remedy="for instance /dev/ttyUSB0"
        )
    return place


def _host(text: str, place: str) -> str:
    """An address or a name; `localhost` is what it has to be, whatever a resolver makes of it."""
    bracketed = place.startswith("[") and place.endswith("]")
    bare = place[1:-1] if bracketed else place
    if bare == "localhost":
        return "127.0.0.1"
    try:
        version: int = ipaddress.ip_address(bare).version
    except ValueError:
        version = 0
    looks_numeric = bare.replace(".", "").isdigit()
    if (version == 6) == bracketed and (version or (HOST_NAME.fullmatch(bare) and not looks_numeric)):
        return bare
    raise InputError(
        f"link {text!r}: host",
        value=repr(place),
        limit="an IPv4 address, an IPv6 address in brackets, or a name",
        remedy="mend it, for instance 127.0.0.1",
    )


def _is_loopback(place: str) -> bool:
    try:
        return ipaddress.ip_address(place).is_loopback
    except ValueError:
        return False  # a name may be given any address by whoever runs the resolver
