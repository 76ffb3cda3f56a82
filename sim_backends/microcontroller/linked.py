"""Hinges in the board's world that stand where servos on another simulated bus turn them."""

from __future__ import annotations

import contextlib
import json
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ori_deploy.errors import OriDeployError
from sim_backends.microcontroller.launcher import Microcontroller

PATIENCE_S = 10.0


class LinkError(OriDeployError):
    """The other simulation does not say where its servos stand."""


class LinkedStructure:
    """The structure that two simulations share, as the latches of one see it.

    Servos are not held by the latches: a magnet that is torn open looks as if it had let go.

    Parameters
    ----------
    board
        Its world has one hinge per servo.
    control
        Control socket of the virtual Dynamixel bus.
    ids
        Its servos, in the order of the hinges.
    """

    def __init__(self, board: Microcontroller, control: Path, ids: Sequence[int]) -> None:
        self._board, self._control, self._ids = board, control, tuple(ids)

    def step(self) -> None:
        """Turn every hinge to where its servo stands now.

        Raises
        ------
        LinkError
            The other simulation is not there.
        """
        found = self._truth()
        for k, (servo, here) in enumerate(zip(self._ids, self._board.truth().shaft_rad, strict=True)):
            self._board.push(k, found[servo] - here)

    def _truth(self) -> dict[int, float]:
        try:
            with contextlib.closing(socket.socket(socket.AF_UNIX)) as connection:
                connection.settimeout(PATIENCE_S)
                connection.connect(str(self._control))
                with connection.makefile("rwb") as stream:
                    stream.write(b'{"do": "truth"}\n')
                    stream.flush()
                    answer: dict[str, Any] = json.loads(stream.readline())
        except (OSError, ValueError) as wrong:
            raise LinkError(
                f"{self._control}: no virtual bus tells where its servos stand: {wrong}; remedy: start "
                "python -m sim_backends.dynamixel_bus first; its control socket is its --link with .control"
            ) from wrong
        return {entry["id"]: entry["output_rad"] for entry in answer["ok"]}
