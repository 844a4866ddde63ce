"""A lookout's phone: stops, their states, a drift and the alarm, on the live page of a run whose journal a test writes."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from browsers import errors, load_page, low_contrast, screen
from programs import wait_until
from scenario_files import POOL_FILE
from selenium import webdriver
from selenium.webdriver.common.by import By

from apad_bridge.commands.look.console import console_service
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import journal_start
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.control_protocol import SOCKET_NAME, short_path
from apad_bridge.supervisor.line_server import LineServer
from apad_bridge.vehicle.commands import PoseReported

pytestmark = pytest.mark.system
WIDTH = 390


@pytest.fixture(scope="module")
def phone(browser: webdriver.Chrome) -> webdriver.Chrome:
    screen(browser, WIDTH, 800, 2)
    return browser


class Story:
    """A run of the pool that has flown 100 s; the test is its supervisor."""

    def __init__(self, path: Path) -> None:
        scenario = load(POOL_FILE)
        directory = RunDirectory.create("pool", datetime(2026, 5, 4, tzinfo=UTC), path)
        starts = starts_of(scenario)
        directory.write_inputs(scenario, starts)
        RunOptions(BenchPart.WHOLE, APadKind.SIM, TimeSource.WALL, 1.0, OnDeath.WAIT).save(directory.path)
        recorder = Recorder(directory, scenario, {it.agent_id: (it.north_m, it.east_m) for it in starts})
        journal_start(recorder, scenario, starts)
        recorder.tick(0, [], PoseReported(0, 5.0, 5.0, 1.0), None, "", (None,) * 4)
        recorder.close()
        self.path = directory.path
        self.now_s = 100
        self.orders: list[dict[str, Any]] = []
        self.writes("tick")

    def answer(self, line: bytes) -> bytes:
        self.orders.append(json.loads(line))
        return b'{"accepted": true, "message": ""}'

    def writes(self, kind: str, passes_s: int = 1, **data: Any) -> None:
        """A line of the journal, after which so much time passes."""
        lines = [{"t": 1000 * self.now_s, "kind": kind, **data}]
        lines += [{"t": 1000 * (self.now_s + 1), "kind": "tick"}] * passes_s
        self.now_s += passes_s
        with (self.path / "journal.jsonl").open("a") as journal:
            journal.write("".join(json.dumps(it) + "\n" for it in lines))


@pytest.fixture
def story(tmp_path: Path) -> Iterator[Story]:
    told = Story(tmp_path / "run")
    with short_path(told.path) as path:
        server = LineServer(path, told.answer, lambda _: True)
    yield told
    server.close()
    os.unlink(told.path / SOCKET_NAME)


Act = Callable[[webdriver.Chrome, Story], Any]


def tap(*selectors: str, orders: bool = True) -> Act:
    """Taps by the browser itself, which count as a person's touch; they give an order, which comes."""

    def act(browser: webdriver.Chrome, story: Story) -> None:
        count = len(story.orders) + orders
        for it in selectors:
            wait_until(lambda it=it: browser.find_element(By.CSS_SELECTOR, it).is_enabled())
            browser.find_element(By.CSS_SELECTOR, it).click()
        wait_until(lambda: len(story.orders) == count)

    return act


def writes(kind: str, passes_s: int = 1, **data: Any) -> Act:
    return lambda _, story: story.writes(kind, passes_s, **data)


def stop(number: int, mode: str, by: str, state: str, passes_s: int = 1, **more: Any) -> Act:
    return writes("stop", passes_s, number=number, mode=mode, by=by, state=state, **more)


def contrast(browser: webdriver.Chrome, _: Story) -> None:
    assert low_contrast(browser) == []


HELPERS = """
const said = (id) => document.getElementById(id).innerText.replace(/\\s+/g, " ");
const seen = (id) => document.getElementById(id).offsetParent !== null;
const beeps = () => Number(document.body.dataset.beeps || 0);
const lengths = () => {
  const found = ["times_ms", "active", "cost", "apad", "docks", "stage"].map((it) => data[it].length);
  for (const agent of data.agents) for (const it of data.live.columns) if (agent[it]) found.push(agent[it].length);
  return new Set(found);
};
const rings = () => {
  // Somebody heard that the link was lost. When it is lost again, that is news.
  const stage = data.stages[data.stages.length - 1], found = [];
  for (const words of ["link lost", "", "link lost", ""]) {
    soundAlarm(stage, words);
    found.push(beeping !== null);
    if (words) calm();
  }
  delete document.body.dataset.beeps;
  return found.join();
};
"""
FITS = f"document.documentElement.scrollWidth === {WIDTH}"
DRIFTS = "Drifts 0.31 m/s to the south-west (241°), at 5.0 m north, 20.0 m east; at the fence in 75 s"
LOOKOUT: list[tuple[Act, str]] = [
    (lambda *_: None, f"!seen('stopped') && {FITS} && rings() === 'true,false,true,false'"),
    # The touch allows the sound, too.
    (tap("#stop"), "said('sound').includes('Sound on')"),
    (stop(1, "hold", "console", "ordered"), "true"),
    (
        stop(1, "hold", "console", "sent"),
        "said('stopped').includes('sent 00:01:42') && !said('stopped-states').includes('taken')",
    ),
    # Of no alarm: a person ordered it.
    (
        stop(1, "hold", "console", "taken"),
        """
          said("stopped").includes("STOPPED: the aPad holds its place") && document.title.includes("STOPPED")
          && said("stopped").includes("taken by the vehicle 00:01:43") && beeps() === 0
          && document.getElementById("stop").disabled && document.getElementById("off").ariaPressed === "false"
        """,
    ),
    (contrast, "true"),
    (tap("#continue", "#sure button[value=yes]"), "true"),
    (
        writes("continued", number=1, by="console"),
        "!seen('stopped') && !document.getElementById('stop').disabled",
    ),
    # A guard's stop without thrust: it drifts, and the alarm sounds until it was heard.
    (stop(2, "off", "guard: frozen", "ordered", reason="the position stands still"), "true"),
    (
        stop(2, "off", "guard: frozen", "taken"),
        "said('stopped').includes('MOTORS OFF: the aPad has no thrust') && beeps() >= 2",
    ),
    (contrast, "true"),
    (
        writes("drift", north_m=5.0, east_m=20.0, speed_m_s=0.31, towards_rad=4.2, fence_s=75.0),
        f"said('drift').includes('{DRIFTS}')",
    ),
    (tap("#heard", orders=False), "!seen('heard') && beeping === null"),
    # The next drift is news.
    (
        writes("drift", speed_m_s=0.31, towards_rad=4.2, fence_s=None),
        "seen('heard') && !said('drift').includes('fence') && said('primitive').includes('no thrust')",
    ),
    # Still water carries nothing away, and that alarms nobody.
    (tap("#heard", orders=False), "true"),
    (
        writes("drift", speed_m_s=0.004, towards_rad=4.2, fence_s=None),
        "said('drift').includes('No drift is seen') && !seen('heard')",
    ),
    (tap("#off"), "true"),
    (tap("#hands"), "true"),
    # A stop that the vehicle does not take may be ordered again.
    (stop(3, "off", "console", "ordered"), "true"),
    (
        stop(3, "off", "console", "not taken", reason="no answer within 3 s"),
        f"said('stopped').includes('STOP NOT TAKEN by the vehicle') && seen('stop') && {FITS}",
    ),
]
ENDS = "said('warning').includes('The run has ended: a call: abort by console.')"
IN_A_TICK: list[tuple[Act, str]] = [
    (writes("tick"), "document.body.dataset.timeMs === '102000' && lengths().size === 1"),
    (
        lambda browser, _: browser.execute_script(f"{HELPERS} window.samples = [...lengths()][0]"),
        "window.samples > 0",
    ),
    (
        stop(1, "hold", "guard: frozen", "taken", passes_s=0, reason="it stands still"),
        "said('stopped').includes('STOPPED: the aPad holds its place')",
    ),
    (
        writes("end", passes_s=0, reason="a call: abort by console", end_reason="a call"),
        f"{ENDS} && document.body.dataset.timeMs === '102000' && [...lengths()].join() === `${{window.samples}}`",
    ),
]
"""What happens, and what then holds in the page."""
ORDERED = [("stop", False, None), ("continue", False, 1), ("stop", True, None), ("hands", False, None)]


@pytest.mark.parametrize(
    ("told", "ordered"),
    [
        pytest.param(LOOKOUT, ORDERED, id="a lookout stops on a phone and hears what a stop comes to"),
        pytest.param(IN_A_TICK, [], id="what follows in a tick that the page has shown is shown"),
    ],
)
def test_on_a_phone(
    told: list[tuple[Act, str]], ordered: list[Any], phone: webdriver.Chrome, story: Story
) -> None:
    with console_service().beside(story.path) as page:
        load_page(phone, page)
        errors(phone)  # of the page before, whose console has ended
        for act, holds in told:
            act(phone, story)
            script = f"{HELPERS} return {holds.strip()}"
            wait_until(lambda script=script: phone.execute_script(script), why=holds)
        assert [(it["act"], bool(it.get("off")), it.get("stop")) for it in story.orders] == ordered
        assert errors(phone) == []
