"""One operator holds control; the door lets nobody in without the token; no message but ours is heard."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from ori_deploy.errors import InputError
from ori_deploy.page.channel import STOP, Asked, Wish, asked_for
from ori_deploy.page.control import Control
from ori_deploy.page.door import Door, part_of

WHO = st.sampled_from("abcd")


class Operators(RuleBasedStateMachine):
    """People who come, go, claim, take and release, in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.control = Control()
        self.here: set[str] = set()
        self.holder: str | None = None

    @rule(who=WHO)
    def comes(self, who: str) -> None:
        self.control = self.control.came(who)
        self.here.add(who)

    @rule(who=WHO)
    def goes(self, who: str) -> None:
        self.control = self.control.gone(who)
        self.here.discard(who)
        self.holder = None if self.holder == who else self.holder

    @rule(who=WHO)
    def claims(self, who: str) -> None:
        self.control = self.control.claim(who)
        if who in self.here and self.holder is None:
            self.holder = who

    @rule(who=WHO)
    def takes(self, who: str) -> None:
        self.control = self.control.take(who)
        if who in self.here:
            self.holder = who

    @rule(who=WHO)
    def releases(self, who: str) -> None:
        self.control = self.control.release(who)
        self.holder = None if self.holder == who else self.holder

    @invariant()
    def at_most_one_may_command_and_is_there(self) -> None:
        able = [who for who in "abcd" if self.control.may_command(who)]
        assert able == ([] if self.holder is None else [self.holder])
        assert set(able) <= self.here


TestOperators = Operators.TestCase


def test_looking_gives_no_control() -> None:
    assert Control().came("a").holder is None


@pytest.mark.parametrize(
    ("path", "host", "origin", "let_in"),
    [
        ("/secret", "127.0.0.1:8080", None, True),
        ("/secret/", "localhost:8080", None, True),
        ("/secret/operate", "127.0.0.1:8080", "http://127.0.0.1:8080", True),
        ("/secret?fixedDpr=0.6", "127.0.0.1:8080", None, True),
        ("/", "127.0.0.1:8080", None, False),
        ("/secre", "127.0.0.1:8080", None, False),
        ("/secret2", "127.0.0.1:8080", None, False),
        ("/?secret", "127.0.0.1:8080", None, False),
        ("/secret", "127.0.0.1:8080", "http://evil.example", False),
        ("/secret", "127.0.0.1:8080", "null", False),
        ("/secret", "evil.example:8080", None, False),
        ("/secret", None, None, False),
    ],
)
def test_the_door_opens_to_the_token_on_its_own_page_alone(
    path: str, host: str | None, origin: str | None, let_in: bool
) -> None:
    assert (Door("secret", "127.0.0.1").refuses(path, host, origin) is None) is let_in


@given(st.text(max_size=40))
def test_no_other_path_opens_it(path: str) -> None:
    door = Door("secret", "127.0.0.1")
    if path.split("?")[0].split("#")[0].strip("/").split("/")[0] != "secret":
        assert door.refuses("/" + path, "127.0.0.1", None) is not None


def test_beyond_loopback_has_to_be_said_and_tokens_are_new_each_time() -> None:
    with pytest.raises(InputError, match="--beyond-loopback"):
        Door.on("0.0.0.0")
    one, other = Door.on("0.0.0.0", beyond_loopback=True), Door.on("127.0.0.1")
    assert one.token != other.token
    assert len(one.token) >= 20
    assert other.address(80) == f"http://127.0.0.1:80/{other.token}"
    assert one.refuses(f"/{one.token}", "a.lan:1", "http://a.lan:1") is None
    assert part_of("/secret/operate") == "operate"


@given(st.text(max_size=60) | st.binary(max_size=60))
def test_what_is_no_message_of_ours_is_not_heard(words: str | bytes) -> None:
    asked = asked_for(words)
    assert asked is None or asked.do == STOP or asked.do in set(Wish)


def test_only_what_the_bar_can_ask_is_heard() -> None:
    assert asked_for(json.dumps({"do": "stop"})) == Asked("stop")
    assert asked_for(json.dumps({"do": "stop", "id": 7, "again": True})) == Asked("stop", id=7, again=True)
    assert asked_for(json.dumps({"do": "deploy", "seen": 3, "span_unfolded": True})) == Asked(
        "deploy", seen=3, span_unfolded=True
    )
    assert asked_for(json.dumps({"do": "deploy", "seen": "3", "span_unfolded": "yes"})) == Asked("deploy")
    assert asked_for(json.dumps({"do": "estop"})) is None
    assert asked_for(json.dumps({"do": "stop", "pad": "x" * 300})) is None
    assert asked_for("[]") is None
