"""A vehicle's network, as a session has it: the bridge in the loop, and the process that speaks."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Self

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.result import CycleRecord, MotionResult
from ori_deploy.mav.bridge import Bridge, Tunable
from ori_deploy.mav.interlock import VehicleInterlock
from ori_deploy.mav.settings import Settings
from ori_deploy.mav.speaker import Speaker
from ori_deploy.operate.desk import Desk


class Network:
    """An observer of the cycles, and looked at in each; for `with`.

    Parameters
    ----------
    settings
        Of the network.
    desk, controller, interlock, rig, now
        As for `Bridge`.

    Raises
    ------
    LinksFailed
        A link cannot be opened.
    """

    def __init__(
        self,
        settings: Settings,
        desk: Desk,
        controller: Tunable,
        interlock: VehicleInterlock,
        rig: ResolvedRig,
        now: Callable[[], float],
    ) -> None:
        self._desk = desk
        self._speaker = Speaker(settings)
        self._bridge = Bridge(desk, controller, interlock, rig, self._speaker.say, now)
        self._cut_off = False

    def __call__(self, record: CycleRecord) -> None:
        """Remember a cycle."""
        self._bridge(record)

    def poll(self) -> None:
        """Do what has been asked for, and tell how things are."""
        for word in self._speaker.words():
            self._bridge.attend(word)
        self._bridge.cycle()
        if self._speaker.lost and not self._cut_off:
            self._bridge.cut_off()
        self._cut_off = self._speaker.lost
        if self._cut_off and self._desk.at_rest:
            self._speaker.restart()

    def ended(self, result: MotionResult) -> None:
        """An order has ended."""
        self._bridge.ended(result)

    @property
    def pid(self) -> int:
        """Of the process that speaks."""
        return self._speaker.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._speaker.close()
