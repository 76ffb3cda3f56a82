"""The ground's side, where something else than this version's structure answers."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from ori_deploy.mav.ground import GroundStation, NoAnswer
from ori_deploy.mav.links import Links, parse_link
from ori_deploy.wire.vehicle import Message, Party, dialect

STRUCTURE = (0, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0, 0, 4, 2, 2)


def answers_to(message: Message) -> list[Message]:
    if isinstance(message, dialect.MAVLink_heartbeat_message):
        unknown, known = (
            dialect.MAVLink_ori_structure_message(*STRUCTURE, state, 255, b"", b"") for state in (77, 5)
        )
        return [unknown, known]
    if isinstance(message, dialect.MAVLink_command_long_message):
        return [dialect.MAVLink_command_ack_message(message.command, 7, 0, 0, 255, 190)]  # COMMAND_INT_ONLY or so
    return []


@pytest.fixture
def station() -> Iterator[GroundStation]:
    ended = threading.Event()
    with Links([parse_link("udpin:127.0.0.1:0")], Party(1, 140)) as other:

        def serve() -> None:
            while not ended.is_set():
                for heard in other.receive(0.05):
                    for answer in answers_to(heard.message):
                        other.send(answer, heard.peer)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            with GroundStation(f"udpout:127.0.0.1:{other.bound()[0].number}") as made:
                yield made
        finally:
            ended.set()
            thread.join()


def test_a_state_of_another_version_is_passed_over(station: GroundStation) -> None:
    assert station.status().locked is False


def test_a_result_that_no_structure_gives_is_told(station: GroundStation) -> None:
    with pytest.raises(NoAnswer, match="MAV_RESULT 7"):
        station.deploy(timeout_s=10.0)
