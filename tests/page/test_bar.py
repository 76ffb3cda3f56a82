"""The bar in a real Chromium, with a page's program that is made up: whatever that does, a stop tells the truth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

import pytest
from playwright.sync_api import Browser
from playwright.sync_api import Page as Tab

from tests.page.browser import CHROMIUM, DESKTOP, PHONE, browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
]

_SOCKET = """
  window.made = []; window.opens = true; window.answers = true; window.number = 0;
  window.WebSocket = class {
    static CONNECTING = 0; static OPEN = 1; static CLOSED = 3;
    constructor(url) {
      this.url = url; this.readyState = 0; this.sent = []; window.made.push(this);
      if (window.opens) setTimeout(() => { this.readyState = 1; this.onopen && this.onopen(); }, 1);
    }
    send(text) {
      const what = JSON.parse(text);
      this.sent.push(what);
      if (what.do !== "stop" || !window.answers) return;
      tell({ answer: { do: "stop", took: true, why: null, id: what.id } }, this);
    }
    close() { this.readyState = 3; this.onclose && this.onclose(); }
  };
  window.here = () => window.made[window.made.length - 1];
  window.tell = (told, to) => setTimeout(() => {
    const s = to || here();
    if (s.onmessage) s.onmessage({ data: JSON.stringify(told) });
  }, 0);
  window.sent = () => window.made.flatMap((s) => s.sent);
  window.news = (more, age) => tell({ number: ++window.number, age_s: age || 0,
    now: { link: "ok", state: "armed", stage: null, at_rest: true, fold: 0, takes_orders: true,
      facts: [], alarms: [], ...more } });
"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as one:
        yield one


@pytest.fixture
def tab(chromium: Browser) -> Iterator[Tab]:
    """The bar, connected, in control, of a controller that is armed."""
    one = chromium.new_page(viewport=DESKTOP)  # type: ignore[arg-type]
    bar = (files("ori_deploy.page") / "static" / "bar.html").read_text(encoding="utf-8")
    html = f"<!doctype html><script>{_SOCKET}</script><div id=root></div>{bar}"
    one.route("http://bar.test/*", lambda route: route.fulfill(body=html, content_type="text/html"))
    one.goto("http://bar.test/token")
    one.wait_for_function("window.here().readyState === 1")
    one.evaluate("tell({ control: 'you' }); window.live = setInterval(() => news(window.how || {}), 50)")
    one.wait_for_selector("#ori-state:has-text('armed')")
    yield one
    one.close()


def how(tab: Tab, **news: Any) -> None:
    """What the news tell from now on."""
    tab.evaluate("how => { window.how = how }", news)
    if "state" in news:
        tab.wait_for_selector(f"#ori-state:has-text('{news['state']}')")


def sent(tab: Tab) -> list[dict[str, Any]]:
    told: list[dict[str, Any]] = tab.evaluate("window.sent()")
    return told


def alarm(tab: Tab) -> str:
    return tab.inner_text("#ori-alarms")


def test_a_stop_that_is_confirmed_says_nothing(tab: Tab) -> None:
    tab.keyboard.press("Space")
    tab.wait_for_timeout(800)
    assert alarm(tab) == ""
    assert [one["do"] for one in sent(tab)] == ["stop"]


def test_a_stop_that_reaches_nobody_says_so_until_it_is_confirmed_and_is_sent_again(tab: Tab) -> None:
    """Reproduced with the page's program frozen: the colour of "sent" went away, and nothing else was to be seen."""
    tab.evaluate("clearInterval(live); window.answers = false; window.opens = false")
    tab.wait_for_timeout(600)
    tab.keyboard.press("Space")
    tab.wait_for_timeout(450)
    assert "STOP NOT CONFIRMED" in alarm(tab)
    assert "ori-deploy estop" in alarm(tab)
    tab.wait_for_timeout(600)
    assert tab.evaluate("made.length") == 2  # another connection is tried
    tab.wait_for_timeout(7000)
    assert "STOP NOT CONFIRMED" in alarm(tab)
    tab.evaluate("window.answers = window.opens = true")
    tab.wait_for_function("document.getElementById('ori-alarms').textContent.indexOf('NOT CONFIRMED') < 0")
    last = tab.evaluate("here().sent")
    assert last[0] == {"do": "stop", "id": 1, "again": True}


def test_a_busy_browser_does_not_throw_away_what_has_come_meanwhile(tab: Tab) -> None:
    for _ in range(3):
        tab.evaluate("{ const end = performance.now() + 2000; while (performance.now() < end); }")
        tab.wait_for_timeout(50)
    assert tab.evaluate("made.length") == 1


def test_a_stop_of_which_nobody_knows_or_that_answers_an_older_one_is_not_confirmed(tab: Tab) -> None:
    tab.evaluate("window.answers = false")
    tab.keyboard.press("Escape")
    tab.keyboard.press("Escape")
    tab.evaluate("tell({ answer: { do: 'stop', took: true, why: null, id: 1 } })")
    tab.evaluate("tell({ answer: { do: 'stop', took: null, why: 'silent', id: 2 } })")
    tab.wait_for_timeout(500)
    assert "STOP NOT CONFIRMED" in alarm(tab)
    assert tab.evaluate("made.length") == 1  # news come: the connection is as good as any
    tab.wait_for_timeout(1100)
    assert {"do": "stop", "id": 2, "again": True} in sent(tab)
    tab.evaluate("tell({ answer: { do: 'stop', took: true, why: null, id: 2 } })")
    tab.wait_for_timeout(200)
    assert alarm(tab) == ""


def test_a_stop_without_a_connection_says_so_at_once(tab: Tab) -> None:
    tab.evaluate("window.opens = false; here().close()")
    tab.keyboard.press("Space")
    assert "STOP NOT CONFIRMED" in alarm(tab)
    tab.evaluate("window.opens = true")
    tab.wait_for_function("document.getElementById('ori-alarms').textContent.indexOf('NOT CONFIRMED') < 0")
    assert [one["do"] for one in sent(tab)] == ["stop"]


def test_to_pause_twice_does_not_go_on(tab: Tab) -> None:
    """Reproduced: the same button became Resume between two presses of a nervous hand."""
    how(tab, state="moving")
    pause = tab.locator("#ori button", has_text="Pause")
    box = pause.bounding_box()
    assert box is not None
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    tab.mouse.click(x, y)
    how(tab, state="hold")
    tab.wait_for_timeout(400)
    tab.mouse.click(x, y)
    tab.wait_for_timeout(100)
    assert [one["do"] for one in sent(tab)] == ["pause"]
    assert pause.is_disabled()
    tab.locator("#ori button", has_text="Resume").click()
    assert [one["do"] for one in sent(tab)] == ["pause", "resume"]


@pytest.mark.parametrize("size", [DESKTOP, PHONE, {"width": 320, "height": 640}])
def test_every_button_is_on_the_screen_and_its_words_fit(tab: Tab, size: dict[str, int]) -> None:
    tab.set_viewport_size(size)  # type: ignore[arg-type]
    bar = tab.locator("#ori").bounding_box()
    assert bar is not None
    for k in range(tab.locator("#ori button").count()):
        one = tab.locator("#ori button").nth(k)
        box = one.bounding_box()
        assert box is not None
        assert box["x"] >= 0.0
        assert box["x"] + box["width"] <= size["width"]
        assert box["y"] + box["height"] <= bar["y"] + bar["height"]
        assert one.evaluate("e => e.scrollWidth <= e.clientWidth")


def test_an_order_tells_the_news_that_were_seen(tab: Tab) -> None:
    tab.locator("#ori button", has_text="Deploy").click()
    order = sent(tab)[-1]
    assert order["do"] == "deploy"
    assert 0 < order["seen"] <= tab.evaluate("number")


def test_old_news_are_none_and_after_a_while_there_is_another_connection(tab: Tab) -> None:
    """Reproduced: how things were 40 s ago, told again to all, looked like now."""
    tab.evaluate("clearInterval(live)")
    old = tab.evaluate("number")
    for _ in range(9):
        tab.evaluate(
            "n => tell({ number: n, age_s: 0, now: { link: 'ok', state: 'armed', facts: [], alarms: [] } })", old
        )
        tab.wait_for_timeout(200)
    assert "No news" in alarm(tab)
    assert tab.locator("#ori button", has_text="Deploy").is_disabled()
    tab.wait_for_function("made.length > 1")
    tab.evaluate("news({}, 40)")  # what a newcomer is told
    tab.wait_for_timeout(100)
    assert tab.locator("#ori button", has_text="Deploy").is_disabled()
    tab.evaluate("window.live = setInterval(() => news({}), 50)")
    tab.wait_for_function("!document.querySelector('[data-do=deploy]').disabled")
    keys = tab.evaluate("made.map((s) => s.url)")
    assert len(set(keys)) == 1
    assert "/token/operate?tab=" in keys[0]


def test_who_lost_control_to_somebody_else_does_not_claim_it_again(tab: Tab) -> None:
    tab.evaluate("tell({ control: 'nobody' })")
    tab.wait_for_selector("#ori >> text=Take control")
    tab.click("#ori-control")
    tab.evaluate("tell({ control: 'you' })")
    tab.wait_for_selector("#ori >> text=Give control")
    tab.evaluate("here().close()")
    tab.wait_for_function("made.length > 1 && here().readyState === 1")
    tab.wait_for_timeout(50)
    assert [one["do"] for one in sent(tab)] == ["claim", "claim"]
    tab.evaluate("tell({ control: 'other' })")
    tab.wait_for_selector("#ori >> text=Take control")
    tab.evaluate("here().close()")
    tab.wait_for_function("made.length > 2 && here().readyState === 1")
    tab.wait_for_timeout(50)
    assert [one["do"] for one in sent(tab)] == ["claim", "claim"]


def test_an_order_of_which_nobody_knows_is_not_called_refused(tab: Tab) -> None:
    tab.evaluate("tell({ answer: { do: 'deploy', took: null, why: 'see the state', id: 0 } })")
    tab.wait_for_selector("#ori-alarms:has-text('deploy: unknown')")


def test_the_word_that_the_span_is_unfolded_is_asked_for_and_given_once(tab: Tab) -> None:
    assert tab.locator("#ori-span").is_hidden()
    tab.locator("#ori button", has_text="Deploy").click()
    tab.evaluate(
        "tell({ answer: { do: 'deploy', took: false, why: 'the span may be folded', code: 'span_word', id: 0 } })"
    )
    tab.locator("#ori-span").click()
    assert json.dumps(sent(tab)[-1]).endswith('"span_unfolded": true}')
    assert sent(tab)[-1]["do"] == "deploy"
    tab.wait_for_selector("#ori-span", state="hidden")


def test_a_clean_end_is_no_alarm(tab: Tab) -> None:
    how(tab, link="ended: deployed", alarms=[])
    tab.wait_for_selector("#ori-state:has-text('ended: deployed')")
    assert tab.locator("#ori-alarm").is_hidden()
