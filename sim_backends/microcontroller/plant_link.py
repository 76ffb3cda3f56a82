"""Servos and structure for a world in another process: asked for every few milliseconds of its time."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading

import numpy as np
from numpy.typing import NDArray

from sim_backends.load import Load, shaft_rates
from sim_backends.microcontroller.spec import OUTPUTS, WorldSpec
from sim_backends.plant_spec import PlantSpec

FloatArray = NDArray[np.float64]

STEP_S = 4e-3
"""WORLD_PLANT_US of world.h."""

ASKED = struct.Struct(f"={2 * OUTPUTS}d4I")
"""Targets and shafts; bits of hinges that hold and that are jammed, and of latches that hold. As in world.c."""

TOLD = struct.Struct(f"={2 * OUTPUTS}d")
"""Shafts and creases."""


class PlantLink:
    """Answers a world until it ends.

    Parameters
    ----------
    world
        Whose servos drive the plant, all hinges of them.
    spec
        The plant.

    Attributes
    ----------
    load
        The plant. It moves in a thread of its own while the emulation's time passes.
    """

    def __init__(self, world: WorldSpec, spec: PlantSpec) -> None:
        self.load: Load = spec.make()
        hinges = world.hinges
        self._n = len(hinges)
        self._gain = np.array([(1.0 - np.exp(-STEP_S / hinge.time_constant_s)) / STEP_S for hinge in hinges])
        self._no_load = np.array([hinge.max_velocity_rad_s for hinge in hinges])
        self._stall = np.array(spec.torque_nm)
        self._lower = np.array([hinge.lower_rad for hinge in hinges])
        self._upper = np.array([hinge.upper_rad for hinge in hinges])
        self._latches = [(1 << i, latch.secures) for i, latch in enumerate(world.latches)]
        self._pull = np.zeros(self._n)
        self._near, self._far = socket.socketpair()
        self._thread = threading.Thread(target=self._serve, name="plant", daemon=True)

    @property
    def far_end(self) -> int:
        """File descriptor for the other process."""
        return self._far.fileno()

    def start(self) -> None:
        """Begin to answer; the other process has its end."""
        self._far.close()
        self._thread.start()

    def close(self) -> None:
        """Stop; the other process has ended."""
        with contextlib.suppress(OSError):
            self._near.shutdown(socket.SHUT_RDWR)
        if self._thread.is_alive():
            self._thread.join()
        self._near.close()
        self._far.close()

    def step(
        self, target: FloatArray, shaft: FloatArray, on: int, jammed: int, held: int
    ) -> tuple[FloatArray, FloatArray]:
        """One step: (n,) shafts and creases."""
        bits = 1 << np.arange(self._n)
        holds, stuck = (on & bits) != 0, (jammed & bits) != 0
        wish = np.clip(self._gain * (target - shaft), -self._no_load, self._no_load) * holds
        rate = shaft_rates(wish, self._pull, self._no_load, self._stall, self._stall * holds)
        reached = np.where(stuck, shaft, np.clip(shaft + STEP_S * rate, self._lower, self._upper))
        self.load.secure(name for bit, name in self._latches if held & bit)
        reaction = self.load.step(reached, STEP_S)
        self._pull = reaction.torque_nm
        return reached, reaction.output_rad

    def _serve(self) -> None:
        n, padding = self._n, (0.0,) * (OUTPUTS - self._n)
        with self._near.makefile("rb") as stream:
            while len(data := stream.read(ASKED.size)) == ASKED.size:
                words = ASKED.unpack(data)
                target, shaft = np.array(words[:n]), np.array(words[OUTPUTS : OUTPUTS + n])
                reached, crease = self.step(target, shaft, *words[2 * OUTPUTS : 2 * OUTPUTS + 3])
                with contextlib.suppress(OSError):  # it has ended in between
                    self._near.sendall(TOLD.pack(*reached, *padding, *crease, *padding))
