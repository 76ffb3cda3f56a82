"""A session that stays and takes orders, instead of being started for one command."""

from __future__ import annotations

from collections.abc import Callable

from ori_deploy.clock import Clock
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import ENDED, MotionResult
from ori_deploy.deploy.states import IN_MOTION, Event, IllegalCommand, State

_COVERED = IN_MOTION | {State.DEPLOYED}
"""States in which the span still is as it was when the deployment began: only the flat stack folds that way."""


class StandingOrders:
    """Carries orders out for as long as the session lasts.

    Nothing is powered before the first order comes: arming is part of it. A link to the actuators that was lost
    is opened again by the next order, and not by itself.

    A word that a span in segments is unfolded is good for one deployment. It is used up when that begins, or when
    the structure comes to be stowed: from then on somebody may fold the span again, and nothing measures that.

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
        Somebody's word that a span in segments is unfolded, for the first deployment.
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
        self._word = span_unfolded
        self._covered = False  # whether what is under way, or ended deployed, began with a word
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

    def deploy(self, *, span_unfolded: bool = False) -> None:
        """Begin to deploy, or turn round, or go on; `span_unfolded` is a word for this deployment alone.

        Raises what the controller raises.
        """
        given = span_unfolded or self._word or self._covered
        self._controller.require_unfolded(given)  # before anything is armed
        self._prepare()
        self._controller.deploy(span_unfolded=given)
        self._word, self._covered = False, given
        self._running = True

    def stow(self) -> None:
        """Begin to stow, as `deploy`."""
        self._prepare()
        self._controller.stow()
        self._running = True

    def clear_fault(self) -> None:
        """Forget the latched fault; nothing moves and nothing is powered.

        Raises
        ------
        IllegalCommand
            As the controller, and in the cycle of the fault itself: that the order has failed is told first.
        """
        failed = self._controller.state is State.FAULT and not self._controller.under_way
        if self._running and failed:
            because = "the order that failed is not over before the next cycle; remedy: give it again"
            raise IllegalCommand(self._controller.state, Event.CLEAR_FAULT, because)
        self._controller.clear_fault()

    def span_is_unfolded(self) -> None:
        """Somebody's word for it, for the next deployment."""
        self._word = True

    def step(self) -> MotionResult | None:
        """One cycle; the result of an order when it has ended in it. Without a link, only time passes."""
        controller = self._controller
        if controller.state is State.DISCONNECTED:
            self._covered = False
            self._clock.sleep_until(self._clock.now() + self._period_s)
            return None
        before = controller.state
        controller.step()
        self._use_up(before)
        # What is held can be gone on with.
        ended = not controller.under_way and controller.state in ENDED and controller.state is not State.HOLD
        if not (self._running and ended):
            return None
        self._running = False
        return controller.result()

    def _use_up(self, before: State) -> None:
        """Nobody's word outlasts the flat stack's coming about, nor the end of what it was given for."""
        state = self._controller.state
        if state is State.STOWED and before is not State.STOWED:
            self._word = False
        self._covered = self._covered and state in _COVERED

    def _prepare(self) -> None:
        if self._controller.state is State.DISCONNECTED:
            self._controller.connect()
        if self._controller.state is State.READY:
            self._vouch()
            self._controller.arm()
