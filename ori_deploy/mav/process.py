"""The process that speaks MAVLink: `python -m ori_deploy.mav.process SOCKET`.

A flood on the network, or a link that hangs, keeps this process busy and not the control loop. It ends when the
loop does.
"""

from __future__ import annotations

import pickle
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress

from ori_deploy.errors import OriDeployError
from ori_deploy.mav.component import Component
from ori_deploy.mav.links import Links
from ori_deploy.mav.parameters import Parameters, parameters_of
from ori_deploy.mav.settings import Settings
from ori_deploy.mav.signing_key import KeptTimestamps, load_key, timestamps_beside
from ori_deploy.mav.words import ALIVE_EVERY_S, Alive, Failed, Ready, Word, item_of, word_of
from ori_deploy.telemetry.channel import Frame, Reader, packed
from ori_deploy.wire.vehicle import Party, Signing

TICK_S = 0.02
READ_BYTES = 1 << 16


class LoopEnd:
    """This side of the channel to the control loop."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._reader = Reader()
        self.gone = False

    def fileno(self) -> int:
        """For select."""
        return self._end.fileno()

    def say(self, word: Word) -> None:
        """Pass a word on: short, rare, and taken in every cycle, so that waiting for room is no matter."""
        try:
            self._end.sendall(packed([item_of(word)]))
        except OSError:
            self.gone = True

    def heard(self) -> Iterator[Frame]:
        """What there is; never waits."""
        while True:
            try:
                data = self._end.recv(READ_BYTES, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self.gone = True
                return
            yield from self._reader.feed(data)

    def settings(self) -> Settings:
        """What comes first."""
        while True:
            for frame in self._reader.feed(self._end.recv(READ_BYTES)):
                settings: Settings = pickle.loads(frame[0][1])
                return settings


def main(words: list[str]) -> None:
    """Serve until the loop is gone."""
    loop = LoopEnd(socket.socket(fileno=int(words[0])))
    try:
        settings = loop.settings()
        with suppress(KeyboardInterrupt):
            serve(loop, settings)
    except (OriDeployError, OSError) as wrong:
        loop.say(Failed(str(wrong)))


def serve(loop: LoopEnd, settings: Settings) -> None:
    """Open the links, say so, and serve them."""
    parameters = Parameters(parameters_of(settings), settings.parameters_file)
    party = Party(settings.system_id, settings.component_id)
    signing, kept = None, None
    if settings.key_file is not None:
        signing = Signing(load_key(settings.key_file), accept_unsigned=settings.accept_unsigned)
        kept = KeptTimestamps(timestamps_beside(settings.key_file), signing)
    with kept or nullcontext(), Links(settings.links, party, signing) as links:
        loop.say(Ready())
        component = Component(settings, parameters, links.send, loop.say, time.monotonic())
        said_s = time.monotonic()
        while not loop.gone:
            _turn(loop, links, component)
            if time.monotonic() - said_s > ALIVE_EVERY_S:
                loop.say(Alive())
                said_s = time.monotonic()
            if kept is not None:
                kept.tick()


def _turn(loop: LoopEnd, links: Links, component: Component) -> None:
    """Wait for whatever comes, a moment at most, and attend to it."""
    for heard in links.receive(TICK_S, wake=(loop.fileno(),)):
        component.heard(heard, time.monotonic())
    for frame in loop.heard():
        for word in map(word_of, frame):
            if word is not None:
                component.told(word, time.monotonic())
    component.tick(time.monotonic())


if __name__ == "__main__":
    main(sys.argv[1:])
