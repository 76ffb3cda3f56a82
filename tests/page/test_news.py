"""What the bar says of a controller, and what is shown while a reading is missing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from ori_deploy.deploy.states import State
from ori_deploy.motion import Collision
from ori_deploy.operate.messages import Answer, Do, Status
from ori_deploy.page.judging import Verdict
from ori_deploy.page.line import LineLost, Lines
from ori_deploy.page.live import alarms_of, folds_of, lost, news
from tests.deploy.synthetic import synthetic_plan
from tests.operate.served import Served, served

STATUS = Status(
    pid=1, plan="p", rig="r", log=None, ports=(), uptime_s=1.0, state=State.MOVING, stage="open", command="deploy",
    at_rest=False, fold=0.5, rate=1.0, progress_percent=50.0, remaining_s=2.0, fault=None, worst_tracking_rad=0.0,
    worst_tracking_hinge=None, lost_replies=0, overruns=0, cycles=10, latches=(), folds=(0.5, 0.51),
)  # fmt: skip
FINE = Verdict((), 1.5e-3, ("c1.ac", "c2.bd"))


def test_progress_clearance_and_orders_are_told() -> None:
    told = news(Answer(True, State.MOVING), STATUS, FINE, synthetic_plan(), np.array([0.5, 0.51]))
    assert told["state"] == "moving"
    assert told["facts"][:3] == ["50.0 % open", "2.0 s left", "clearance 1.50 mm"]
    assert not told["takes_orders"]
    assert told["alarms"] == []


def test_faults_interference_and_cells_out_of_step_are_alarms() -> None:
    plan = synthetic_plan()
    deep = Verdict((Collision(("c1.ac", "c2.bd"), (0.5, 0.5), 2e-3),), 0.0, ("c1.ac", "c2.bd"))
    told = alarms_of(replace(STATUS, fault="hot"), deep, plan, np.array([0.0, 0.9]))
    assert told[0] == "Fault: hot"
    assert "2.00 mm" in told[1]
    assert "out of step" in told[2]


def test_a_missing_reading_keeps_its_place_and_an_old_controller_tells_what_it_commands() -> None:
    before = np.array([0.2, 0.3])
    assert folds_of(replace(STATUS, folds=(None, 1.002)), before).tolist() == [0.2, 1.0]
    assert folds_of(replace(STATUS, folds=()), before).tolist() == [0.5, 0.5]
    assert folds_of(replace(STATUS, folds=(), fold=None), before).tolist() == [0.2, 0.3]


def test_nobody_who_answers_is_told_apart_from_nobody_yet() -> None:
    assert lost(False)["alarms"] == []
    assert "hangs" in lost(True)["alarms"][0]


@contextmanager
def stepping(one: Served) -> Iterator[None]:
    """The loop runs by itself."""
    ended = threading.Event()

    def run() -> None:
        while not ended.is_set():
            one.cycles()
            ended.wait(0.001)

    loop = threading.Thread(target=run)
    loop.start()
    try:
        yield
    finally:
        ended.set()
        loop.join()


@pytest.mark.usefixtures("runtime_folder")
def test_lines_ask_order_and_stop_and_survive_being_dropped() -> None:
    with served() as one:
        lines = Lines(one.socket.path)
        with stepping(one):
            first = lines.status()
            assert first.status is not None
            assert first.status.takes_orders is False
            lines.keep_stop_open()
        for client in list(one.socket._clients.values()):
            one.socket._drop(client)
        with stepping(one):
            assert lines.status().status is not None
            one.bench.controller.deploy()
            assert lines.order(Do.PAUSE).took
            assert lines.stop().took
            assert lines.stop().state is State.FAULT  # pressed twice is pressed once
        lines.close()
    with pytest.raises(LineLost):
        lines.status()
