"""A session that stays and takes orders, instead of being started for one command."""

from __future__ import annotations

from collections.abc import Callable

from ori_deploy.clock import Clock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import ENDED, MotionResult
from ori_deploy.deploy.states import State


class StandingOrders:
    """Carries orders out for as long as the session lasts.

    Nothing is powered before the first order comes: arming is part of it. A link to the actuators that was lost
    is opened again by the next order, and not by itself.

    Parameters
    ----------
    controller
        Connected.
    clock
        The controller's.
    period_s
        Of its cycles.
    vouch
        Called before torque goes on; raises where nobody knows where the structure stands.
    span_unfolded
        Somebody's word that a span in segments is unfolded, for the whole session.
    """

    def __init__(
        self,
        controller: Controller,
        clock: Clock,
        period_s: float,
        vouch: Callable[[], None],
        *,
        span_unfolded: bool = False,
    ) -> None:
        self._controller, self._clock, self._period_s = controller, clock, period_s
        self._vouch = vouch
        self._span_unfolded = span_unfolded
        self._running = False

    @property
    def running(self) -> bool:
        """Whether an order is being carried out, or is held."""
        return self._running

    def arm(self) -> None:
        """Hold where measured, and nothing more. Raises what the controller raises."""
        state = self._controller.state
        self._prepare()
        if self._controller.state is state:  # nothing was left to do: the controller says what it allows
            self._controller.arm()

    def deploy(self) -> None:
        """Begin to deploy, or turn round, or go on. Raises what the controller raises."""
        self._prepare()
        self._controller.deploy(span_unfolded=self._span_unfolded)
        self._running = True

    def stow(self) -> None:
        """Begin to stow, as `deploy`."""
        self._prepare()
        self._controller.stow()
        self._running = True

    def clear_fault(self) -> None:
        """Forget the latched fault; nothing moves and nothing is powered."""
        self._controller.clear_fault()

    def step(self) -> MotionResult | None:
        """One cycle; the result of an order when it has ended in it. Without a link, only time passes."""
        controller = self._controller
        if controller.state is State.DISCONNECTED:
            self._clock.sleep_until(self._clock.now() + self._period_s)
            return None
        controller.step()
        # What is held can be gone on with.
        ended = not controller.under_way and controller.state in ENDED and controller.state is not State.HOLD
        if not (self._running and ended):
            return None
        self._running = False
        return controller.result()

    def _prepare(self) -> None:
        if self._controller.state is State.DISCONNECTED:
            self._controller.connect()
        if self._controller.state is State.READY:
            self._vouch()
            self._controller.arm()
