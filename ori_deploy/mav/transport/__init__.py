"""What carries frames: a UDP socket, TCP connections, a serial device. None of them ever waits for a peer.

Each gives the bytes it has with the key of where they came from, and takes frames for such a key.
"""

from __future__ import annotations

import socket

from ori_deploy.errors import InputError
from ori_deploy.mav.link_spec import LinkSpec
from ori_deploy.mav.transport.base import Address, Gone, Key, Transport
from ori_deploy.mav.transport.serial_device import SerialTransport
from ori_deploy.mav.transport.tcp import TcpClient, TcpServer
from ori_deploy.mav.transport.udp import UdpClient, UdpServer

__all__ = ["Gone", "Key", "Transport", "open_transport"]


def open_transport(spec: LinkSpec) -> Transport:
    """Open a link. What calls, or is a device, is opened again and again until it is there.

    Raises
    ------
    InputError
        The host has no address, or it cannot be listened there.
    """
    if spec.kind == "serial":
        return SerialTransport(spec)
    address = _resolved(spec)
    try:
        if spec.kind == "udpin":
            return UdpServer(spec, address)
        if spec.kind == "udpout":
            return UdpClient(spec, address)
        return TcpServer(spec, address) if spec.kind == "tcpin" else TcpClient(spec, address)
    except OSError as wrong:
        raise InputError(
            f"link {spec}: cannot be opened",
            value=wrong.strerror or wrong,
            limit="a free port on an address of this machine" if spec.kind in ("udpin", "tcpin") else None,
            remedy="end what has it, or take another",
        ) from wrong


def _resolved(spec: LinkSpec) -> Address:
    """Once, as asking a resolver may take its time."""
    try:
        family, _, _, _, address = socket.getaddrinfo(spec.place, spec.number, type=socket.SOCK_DGRAM)[0]
    except OSError as wrong:
        raise InputError(
            f"link {spec}: host", value=f"{spec.place}: {wrong.strerror}", limit="a host that has an address",
            remedy="mend the name, or give the address",
        ) from wrong  # fmt: skip
    return family, address  # type: ignore[return-value]
