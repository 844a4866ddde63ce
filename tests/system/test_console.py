"""The live console in a real browser, beside a run that flies: what it shows, what it orders, and whom it refuses."""

from __future__ import annotations

import http.server
import json
import re
import shlex
import signal
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import pytest
from browsers import errors, load_page, text
from killing import kill_9, pid_of_supervisor, standing_still
from patient import PATIENCE_S
from programs import MUSSELBED, begun, code_here, line_of, lines_of, parent_of, wait_until
from scenario_files import write_scenario
from selenium import webdriver
from selenium.webdriver.common.by import By
from stalled import stalled_s

from apad_bridge.analysis.invariants import check_run
from apad_bridge.commands.look.console import console_service
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.scenario.errors import UserError
from apad_bridge.supervisor.control_protocol import listens

pytestmark = pytest.mark.system
WATCH_WARNINGS = """
window.warned = [];
new MutationObserver(() => {
  const text = document.getElementById("warning").textContent, last = window.warned[window.warned.length - 1];
  if (text === (last ? last[0] : "")) return;
  setTimeout(() => window.warned.push([text, !document.getElementById("stop").disabled, Date.now()]));
}).observe(document.getElementById("warning"), {childList: true});
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Six aMussels close together, flown over ROS ten times faster than real time, for longer than these tests last.

    The last test of this file ends it.
    """
    folder = tmp_path_factory.mktemp("live")
    path, out = folder / "live.yaml", folder / "run"
    write_scenario(
        path,
        description="<script>window.hurt = 1</script>",
        duration_s=14_400,
        fleet={"count": 6, "start": {"charge": [0.5, 0.75]}},
    )
    fly = ("run", path, "--speed", 10, "--out", out, "--json", "--on-supervisor-death", "resume")
    with begun(*MUSSELBED, *fly) as process:
        wait_until(lambda: out.is_dir() and listens(out), process)
        yield out
    assert check_run(RunDirectory.open(out)) == []


def press(browser: webdriver.Chrome, selector: str) -> None:
    """Clicks a visible button as soon as the page lets it: on a busy machine it may be disabled for a while."""
    script = """
        const button = document.querySelector(arguments[0]);
        if (button.disabled || button.offsetParent === null) return false;
        button.click();
        return true;
    """
    wait_until(lambda: browser.execute_script(script, selector))


def confirm(browser: webdriver.Chrome, selector: str, answer: str = "yes") -> None:
    """Clicks a button of an act that is asked about, and answers."""
    press(browser, selector)
    press(browser, f"#sure button[value={answer}]")


def is_aborted(browser: webdriver.Chrome) -> bool:
    """Orders the end. A supervisor that did not answer in time is asked again, as a person would."""
    if not text(browser, "warning").startswith("The run has ended"):
        confirm(browser, "#abort")
        wait_until(lambda: text(browser, "answer").startswith("abort: "))
    return text(browser, "answer") == "abort: done" or text(browser, "warning").startswith(
        "The run has ended"
    )


def warned(browser: webdriver.Chrome, beginning: str) -> list[tuple[str, bool, float]]:
    """(warning, a button takes orders, at s) of each warning since WATCH_WARNINGS that begins so."""
    rows = browser.execute_script("return window.warned")
    return [(said, can_stop, at_ms / 1000) for said, can_stop, at_ms in rows if said.startswith(beginning)]


def wait_until_it_moves(browser: webdriver.Chrome, by_s: float = 0.0) -> None:
    """Until the page shows a later time."""
    until_s = seconds(browser) + by_s
    wait_until(lambda: seconds(browser) > until_s)


def seconds(browser: webdriver.Chrome) -> float:
    return float(browser.execute_script("return document.body.dataset.timeMs")) / 1000


def test_a_person_orders_about_one_amussel(browser: webdriver.Chrome, run: Path) -> None:
    cause = "[data-act='cause a fault']"
    with console_service().beside(run) as url:
        load_page(browser, url)
        browser.find_element(By.CSS_SELECTOR, "#agents [data-agent='6']").click()
        # The pool has no water to ping by; the aPad is simulated, so there are faults.
        assert text(browser, "whose") == "simulated aPad"
        assert re.fullmatch(
            r".+ · no aMussel empty, lost or suspect · aPad \d+(\.\d)? %", text(browser, "now")
        )
        assert not browser.find_element(By.CSS_SELECTOR, "[data-act=ping]").is_displayed()
        browser.execute_script("document.getElementById('fault').value = 'watchdog'")
        press(browser, cause)
        # "No", and the same question again before the browser tells the page that the dialog has closed.
        browser.execute_script(
            "for (const selector of arguments) document.querySelector(selector).click()",
            "#sure button[value=no]",
            cause,
        )
        press(browser, "#sure button[value=yes]")
        wait_until(lambda: text(browser, "answer") == "cause a fault (aMussel 6): done")
        (fault,) = wait_until(lambda: lines_of(run, "fault"))
        assert (fault["id"], fault["fault"]) == (6, "watchdog")
        # It is among the events, and its effect on the page: the board begins anew, and works again.
        wait_until(lambda: "fault of aMussel 6: watchdog" in text(browser, "events"))
        wait_until(
            lambda: {it["state"] for it in lines_of(run, "truth") if it["id"] == 6} >= {"BOOTING", "ACTIVE"}
        )
        wait_until(lambda: text(browser, "one-now").startswith("6: active"))
        confirm(browser, "[data-act='hand over']")
        (presence,) = wait_until(lambda: lines_of(run, "presence"))
        assert (presence["id"], presence["is"], presence["by"]) == (6, "real", "console")
        # The roster refuses from a page what it refuses from a service.
        confirm(browser, cause)
        wait_until(lambda: "is real: faults are for simulated ones" in text(browser, "answer"))
        assert len(lines_of(run, "fault")) == 1


ABORT = b'{"act": "abort", "by": "Mallory"}'
OF_PAGE = {"Origin": "BASE", "Sec-Fetch-Site": "same-origin"}
TOKEN = {"X-Musselbed-Token": "TOKEN"}
REFUSED: list[tuple[str, dict[str, str], bytes | None, int, str]] = [
    ("/", {}, None, 403, ""),
    ("/", TOKEN, None, 403, ""),
    ("/?token=guess", {}, None, 403, ""),
    ("/?token=%C3%BC", {}, None, 403, ""),
    ("/live?counts=0,0,0,0,0", {}, None, 403, ""),
    ("/live?token=guess&counts=0,0,0,0,0", {"Cookie": "token=TOKEN"}, None, 403, ""),
    ("/orders", OF_PAGE, ABORT, 403, ""),
    ("/orders?token=TOKEN", OF_PAGE, ABORT, 403, ""),
    ("/orders", {**OF_PAGE, "Cookie": "token=TOKEN"}, ABORT, 403, ""),
    ("/orders", {**OF_PAGE, "X-Musselbed-Token": "guess"}, ABORT, 403, ""),
    ("/orders", TOKEN, ABORT, 403, ""),
    ("/orders", {**TOKEN, "Origin": "http://127.0.0.1:1"}, ABORT, 403, ""),
    ("/orders", {**TOKEN, "Origin": "null"}, ABORT, 403, ""),
    ("/orders", {**TOKEN, "Origin": "http://[::1"}, ABORT, 403, ""),
    ("/orders", {**TOKEN, **OF_PAGE, "Sec-Fetch-Site": "same-site"}, ABORT, 403, ""),
    # Another host, to whose name a stranger's name service gave this machine's address.
    ("/orders", {**TOKEN, "Origin": "http://evil.org", "Host": "evil.org"}, ABORT, 403, ""),
    ("/?token=TOKEN", {"Host": "evil.org"}, None, 403, ""),
    ("/live?token=TOKEN&counts=0,0,0,0,0", {"Host": "evil.org:80"}, None, 403, ""),
    ("/orders", {**TOKEN, **OF_PAGE}, b'{"act": "stop"}', 400, '"message":"by: Field required'),
    (
        "/orders",
        {**TOKEN, **OF_PAGE},
        b'{"act": "halt", "by": "Anna"}',
        400,
        '"message":"act: Input should be',
    ),
    ("/orders", {**TOKEN, **OF_PAGE}, b"stop", 400, '"message":"Invalid JSON'),
]
"""Path, headers and body of a request, the code of its refusal, and words of that."""


def test_without_its_token_a_console_shows_and_orders_nothing(run: Path) -> None:
    ordered = lines_of(run, "operator")
    with console_service().beside(run) as url:
        base, token = url.split("/?token=")
        for path, headers, body, code, words in REFUSED:
            filled = {name: it.replace("TOKEN", token).replace("BASE", base) for name, it in headers.items()}
            request = urllib.request.Request(base + path.replace("TOKEN", token), body, filled)
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(request, timeout=PATIENCE_S)
            told = refused.value.read().decode()
            assert refused.value.code == code and words in told.replace('": "', '":"') and token not in told
    assert lines_of(run, "operator") == ordered


class Stranger(http.server.BaseHTTPRequestHandler):
    """A page on another port of this machine; keeps the cookies that browsers send it."""

    cookies: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        self.cookies += self.headers.get_all("Cookie") or []
        self.send_response(200)
        self.end_headers()
        self.wfile.write(b"<!doctype html><p>a stranger")

    def log_message(self, *_: object) -> None:
        pass


ORDER_FROM_ANOTHER_PORT = """
const done = arguments[arguments.length - 1], [order, token] = arguments;
const body = JSON.stringify({act: "abort", by: "Mallory"});
const ask = (more) => fetch(order, {method: "POST", credentials: "include", body, ...more})
  .then((it) => it.status, () => "blocked");
Promise.all([ask({mode: "no-cors"}), ask({}), ask({headers: {"X-Musselbed-Token": token}})]).then(done);
"""


def test_a_page_of_another_port_gets_no_cookie_and_gives_no_order(
    browser: webdriver.Chrome, run: Path
) -> None:
    """Cookies ignore ports, and so does SameSite: a page of another port sent a person's cookie along with its order."""
    ordered = lines_of(run, "operator")
    with (
        console_service().beside(run) as url,
        http.server.ThreadingHTTPServer(("127.0.0.1", 0), Stranger) as stranger,
    ):
        serving = threading.Thread(target=stranger.serve_forever)
        serving.start()
        try:
            load_page(browser, url)
            wait_until_it_moves(browser)
            browser.get(f"http://127.0.0.1:{stranger.server_port}/")
            base, token = url.split("/?token=")
            # Even one that has learned the token, which its own page is not asked for.
            answers = browser.execute_async_script(ORDER_FROM_ANOTHER_PORT, f"{base}/orders", token)
            assert answers == [0, "blocked", "blocked"]
            # What the browser sends with a request of its own to that port, that port's server can use.
            cookies = [{"Cookie": it} for it in Stranger.cookies]
            assert cookies == []
            # The person's own tab still has its token when it comes back.
            browser.get(f"{base}/")
            wait_until(lambda: browser.execute_script("return document.body.dataset.timeMs !== undefined"))
            assert "token" not in browser.current_url
            wait_until_it_moves(browser)
            errors(browser)
        finally:
            stranger.shutdown()
            serving.join()
    assert lines_of(run, "operator") == ordered


def test_a_page_whose_console_stands_still_says_so_within_3_s(browser: webdriver.Chrome, run: Path) -> None:
    with begun(*MUSSELBED, "console", run, "--json", ends_by=signal.SIGKILL) as console:
        load_page(browser, json.loads(line_of(console))["url"])
        wait_until_it_moves(browser)
        browser.execute_script(WATCH_WARNINGS)
        stopped_s, others_s = time.time(), stalled_s()
        console.send_signal(signal.SIGSTOP)
        silence = "The console does not answer: what is shown is old."
        wait_until(lambda: text(browser, "warning") == silence)
        _, can_stop, said_s = wait_until(lambda: warned(browser, silence))[-1]
        assert not can_stop
        assert said_s - stopped_s - (stalled_s() - others_s) < 3.0


def test_the_line_that_the_console_prints_gives_an_order_from_a_program(run: Path) -> None:
    with begun(*MUSSELBED, "console", run, "--json") as console:
        program, *words, url = shlex.split(json.loads(line_of(console))["order"])
        assert (program, words[-2:]) == ("curl", ["-d", '{"act": "stop", "by": "NAME"}'])
        # The run is shared: a remark in place of the stop.
        remark = json.dumps({"act": "remark", "text": "by a program", "by": "NAME"}).encode()
        headers = dict(it.split(": ") for flag, it in pairwise(words) if flag == "-H")
        request = urllib.request.Request(url, remark, headers)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            assert json.load(answer)["accepted"] is True
    assert "by a program" in [it["text"] for it in lines_of(run, "remark")]


def test_a_console_of_what_is_no_run_does_not_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with (
        pytest.raises(UserError, match=r"no run: it has no scenario\.yaml"),
        console_service().beside(tmp_path),
    ):
        pytest.fail("it started")
    assert code_here("console", tmp_path / "gone") == 2
    assert capsys.readouterr().err.count("\n") == 1


CHOOSE = "const it = document.getElementById('flight-speed'); it.value = arguments[0]; it.onchange()"
STEPS_PALE = """
  const of = (it) => getComputedStyle(it).color, steps = [...document.querySelectorAll("#plan span")];
  return steps.length > 0 && steps.every((it) => of(it) === of(document.querySelector("h2")));
"""


def test_a_person_follows_a_run_stops_it_lets_it_go_on_and_ends_it(
    browser: webdriver.Chrome, run: Path
) -> None:
    def orders() -> list[str]:
        return [line["order"] for line in lines_of(run, "operator")]

    with console_service().beside(run) as url:
        load_page(browser, url)
        wait_until_it_moves(browser, 30)
        errors(browser)  # of the consoles before, which have ended
        assert "token" not in browser.current_url and browser.execute_script(
            "return window.hurt === undefined"
        )
        press(browser, "#stop")
        # Done is what the hull obeys; `test_stops_on_page.py` has what the page shows of a stop.
        wait_until(lambda: text(browser, "answer").startswith("stop: obeyed after"))
        wait_until(lambda: browser.execute_script(STEPS_PALE))
        # An order is answered in its tick, and its line is in the file when the tick ends.
        wait_until(lambda: orders() == ["stop"])
        browser.find_element(By.ID, "remark-text").send_keys("<b>gulls</b>\n")
        wait_until(lambda: "<b>gulls</b>" in text(browser, "events"))
        # Another speed, and time that stands still, with a step.
        browser.execute_script(CHOOSE, "0")
        wait_until(lambda: "time stands still" in text(browser, "about"))
        press(browser, "#step")
        wait_until(lambda: len(lines_of(run, "speed")) == 2)
        browser.execute_script(CHOOSE, "20")
        wait_until(lambda: "flying at 20 times real time" in text(browser, "about"))
        assert [line["times"] for line in lines_of(run, "speed")] == [0.0, 0.0, 20.0]
        # An act that moves something asks first, and "no" orders nothing.
        confirm(browser, "#continue", "no")
        confirm(browser, "#continue")
        wait_until(lambda: text(browser, "answer") == "continue: done; the mission steers")
        wait_until(lambda: browser.find_element(By.ID, "stop").is_enabled())
        assert not browser.execute_script(STEPS_PALE)
        wait_until(lambda: orders() == ["stop", "continue"])
        # A person who looks back is left there until "Live".
        browser.execute_script("document.querySelector('#events button').click()")
        looked_s, shown = seconds(browser), text(browser, "event-count")
        assert looked_s == lines_of(run, "plan")[0]["t"] / 1000  # the first event that the page lists
        wait_until(lambda: text(browser, "event-count") != shown)
        assert seconds(browser) == looked_s
        browser.find_element(By.ID, "follow").click()
        assert seconds(browser) > looked_s
        # The page says that a supervisor has died, and follows the next one.
        browser.execute_script(WATCH_WARNINGS)
        supervisor = pid_of_supervisor(run)
        # The next one is not started before the page has said so: it could be there sooner than a busy browser looks.
        with standing_still(parent_of(supervisor)):
            killed_s, others_s = time.time(), stalled_s()
            kill_9(supervisor)
            _, could_stop, said_s = wait_until(lambda: warned(browser, "No supervisor takes orders"))[0]
        assert not could_stop and said_s - killed_s - (stalled_s() - others_s) < 3.0
        wait_until(
            lambda: text(browser, "warning") == "" and browser.find_element(By.ID, "stop").is_enabled()
        )
        wait_until_it_moves(browser, 10)
        wait_until(lambda: is_aborted(browser))
        ended = f"The run has ended: a call: abort by console. .* Replay: musselbed replay {run}"
        wait_until(lambda: re.fullmatch(ended, text(browser, "warning")))
        # The journal's last line comes before the summary.
        wait_until((run / "summary.json").exists)
        summary = json.loads((run / "summary.json").read_text())
        wait_until(lambda: f"{summary['cost_m']:.0f} m" in text(browser, "figures"))
        assert f"{summary['uptime_paper']['mean']:.2f} %" in text(browser, "figures")
        assert errors(browser) == []
