"""Requests and answers as lines."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ori_deploy.deploy.states import State
from ori_deploy.operate.messages import (
    Answer,
    BadRequest,
    Do,
    LatchStatus,
    Request,
    Status,
    answer_line,
    parse_answer,
    parse_request,
    request_line,
)

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | st.sampled_from(list(Do)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["do", "wait", "x"]), inner),
    max_leaves=8,
)


@given(st.sampled_from(Do), st.booleans())
def test_a_request_survives_the_way(do: Do, wait: bool) -> None:
    line = request_line(Request(do, wait))
    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1
    assert parse_request(line) == Request(do, wait)


@given(st.binary(max_size=600))
def test_bytes_are_a_request_or_a_bad_one(line: bytes) -> None:
    with suppress(BadRequest):  # and nothing else is ever raised
        assert isinstance(parse_request(line), Request)


@given(JSON)
def test_documents_are_what_they_say_or_bad(document: Any) -> None:
    """Against a slow reading of the rule: an object of these two keys, the first one of five words."""
    good = (
        isinstance(document, dict)
        and set(document) <= {"do", "wait"}
        and document.get("do") in list(Do)
        and isinstance(document.get("wait", False), bool)
    )
    line = json.dumps(document).encode()
    if good:
        assert parse_request(line) == Request(Do(document["do"]), document.get("wait", False))
    else:
        with pytest.raises(BadRequest):
            parse_request(line)


@pytest.mark.parametrize("depth", [100, 250, 10_000, 1_000_000])
def test_depth_is_no_danger(depth: int) -> None:
    with pytest.raises(BadRequest):
        parse_request(b'{"do":' + b"[" * depth)


STATUS = Status(
    pid=7,
    plan="/a/wing.plan.json",
    rig="/a/rig.toml",
    log=None,
    ports=("/dev/ttyUSB0",),
    uptime_s=1.5,
    state=State.MOVING,
    stage="open",
    command="deploy",
    at_rest=False,
    fold=0.25,
    rate=1.0,
    progress_percent=None,
    remaining_s=2.0,
    fault=None,
    worst_tracking_rad=0.01,
    worst_tracking_hinge="servo_1",
    lost_replies=0,
    overruns=1,
    cycles=99,
    latches=(LatchStatus("pin", True, None),),
)


@pytest.mark.parametrize(
    "answer",
    [
        Answer(True, State.HOLD, True, status=STATUS),
        Answer(False, State.ARMED, True, "not allowed in state armed", (Do.STATUS, Do.ESTOP), "a\nfault"),
        Answer(False, why="not a request"),
    ],
)
def test_an_answer_survives_the_way(answer: Answer) -> None:
    line = answer_line(answer)
    assert line.count(b"\n") == 1
    assert parse_answer(line) == answer


def test_what_is_no_answer_is_found_out() -> None:
    for line in (b"", b"{}", b"[]", b'{"took": true, "state": "flying"}'):
        with pytest.raises(ValueError, match="Answer"):
            parse_answer(line)
