"""Looking for a way back into step, from where the cells are measured."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from pathlib import Path

import numpy as np

from ori_deploy.cli.frame import nothing_moved
from ori_deploy.cli.given import held
from ori_deploy.cli.live import Live
from ori_deploy.deploy.controller import Controller
from ori_deploy.deploy.result import StartRefused
from ori_deploy.deploy.states import State
from ori_deploy.errors import InputError, MotionError
from ori_deploy.files import load_design
from ori_deploy.files.text import HeldFile
from ori_deploy.motion import Interference, Plan
from ori_deploy.motion.mechanism_of import mechanism_of
from ori_deploy.motion.recovery import Recovery, find_recovery
from ori_deploy.profiles.profile import Reals
from ori_deploy.telemetry.channel import HELD_OFF

LOOKS = 10
"""Cycles whose readings are averaged: a way begins where the cells stand, not where one reading says."""

Start = Callable[[Controller, Callable[[], bool], Live], None]


@contextmanager
def recovering(design_file: Path | None, plan: Plan) -> Iterator[Start]:
    """What finds a way for an armed controller and starts it on that way; it is told whether somebody says stop.

    Another process looks for the way, as that takes up to a second: the loop goes on, and no watchdog trips.

    Raises
    ------
    InputError
        The design is not the plan's.
    """
    if design_file is None:
        raise InputError("--design: needed to look for a way", remedy="give the design file that was planned")
    design_file = held(design_file)
    design = load_design(design_file)
    if plan.design_sha256 and design.sha256 != plan.design_sha256:
        raise InputError(
            f"{design_file}: not the design of this plan",
            value=design.sha256[:12],
            limit=f"{plan.design_sha256[:12]}, the plan's",
            remedy="give the design file that was planned",
        )
    with _signals_held():  # of its own: what is begun here to clean up after the worker unblocks some signals again
        pool = ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_end_with_parent)
    with pool as others:
        with _signals_held(), nothing_moved(), _alive():
            ready = others.submit(_ready)
        with nothing_moved(), _alive():
            ready.result()  # loaded before the loop begins
        yield lambda controller, stopping, live: _start(controller, stopping, live, others, design_file, plan)


@contextmanager
def _signals_held() -> Iterator[None]:
    """A process that begins here is deaf to what ends a session: it goes with the pool, and not before the loop."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, HELD_OFF)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _alive() -> Iterator[None]:
    """Say so in one line where the process that looks has ended."""
    try:
        yield
    except BrokenProcessPool as ended:
        raise StartRefused("the process that looks for a way has ended; remedy: give the command again") from ended


def _start(
    controller: Controller,
    stopping: Callable[[], bool],
    live: Live,
    others: Executor,
    design_file: HeldFile,
    plan: Plan,
) -> None:
    measured = np.array([controller.step().folds for _ in range(LOOKS)])
    folds = np.nanmean(measured, axis=0)
    with _alive():
        looking = others.submit(_look, str(design_file), design_file.data, folds, plan.step_tolerance.seating_depth_m)
    while not looking.done():
        controller.step()
        if stopping():
            raise KeyboardInterrupt
        if controller.state is not State.ARMED:
            raise StartRefused(f"a way was looked for, and then: {controller.fault}")
    with _alive():
        found = looking.result()
    if isinstance(found, str):
        raise StartRefused(found)
    stands = ", ".join(f"{name} {fold:.3f}" for name, fold in zip(plan.cell_ids, folds, strict=True))
    live.line(f"cells stand at fold {stands}; all go to {found.target:.3f}, {found.n_poses} poses checked")
    controller.recover(found)


def _ready() -> None:
    """A process that has loaded this module."""


def _end_with_parent() -> None:
    """A process that is deaf has to see for itself when nobody is left to end it."""
    parent = parent_process()
    assert parent is not None

    def end() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def _look(name: str, data: bytes, folds: Reals, contact_m: float) -> Recovery | str:
    """A way, or in words why there is none; in the design that was read before, and no later one of its name."""
    design = load_design(HeldFile.of(name, data))
    interference = Interference(mechanism_of(design.structure, design.r_max_m))
    try:
        return find_recovery(interference, folds, contact_m=contact_m)
    except MotionError as none:
        return str(none)
