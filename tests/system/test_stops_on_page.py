"""A lookout's phone: stops, their states, a drift and the alarm, on the live page of a run whose journal a test writes."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
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
        self._lock = threading.Lock()
        self.passes()

    def answer(self, line: bytes) -> bytes:
        self.orders.append(json.loads(line))
        return b'{"accepted": true, "message": ""}'

    def ordered(self, number: int, act: str) -> dict[str, Any]:
        """The order of this number, counted from 1, once it has come."""
        wait_until(lambda: len(self.orders) == number)
        assert self.orders[-1]["act"] == act
        return self.orders[-1]

    def writes(self, kind: str, **data: Any) -> None:
        with self._lock, (self.path / "journal.jsonl").open("a") as journal:
            journal.write(json.dumps({"t": 1000 * self.now_s, "kind": kind, **data}) + "\n")

    def passes(self) -> None:
        """A second passes."""
        self.now_s += 1
        self.writes("tick")

    def stop(self, number: int, mode: str, by: str, state: str, **more: Any) -> None:
        self.writes("stop", number=number, mode=mode, by=by, state=state, **more)
        self.passes()


@pytest.fixture
def story(tmp_path: Path) -> Iterator[Story]:
    told = Story(tmp_path / "run")
    with short_path(told.path) as path:
        server = LineServer(path, told.answer, lambda _: True)
    yield told
    server.close()
    os.unlink(told.path / SOCKET_NAME)


def says(browser: webdriver.Chrome, element: str, words: str) -> None:
    wait_until(lambda: words in browser.find_element(By.ID, element).text)


def seen(browser: webdriver.Chrome, element: str) -> bool:
    return browser.find_element(By.ID, element).is_displayed()


def tap(browser: webdriver.Chrome, selector: str) -> None:
    """A tap by the browser itself, which counts as a person's touch."""
    wait_until(lambda: browser.find_element(By.CSS_SELECTOR, selector).is_enabled())
    browser.find_element(By.CSS_SELECTOR, selector).click()


def test_a_lookout_stops_on_a_phone_and_hears_what_a_stop_comes_to(
    phone: webdriver.Chrome, story: Story
) -> None:
    with console_service().beside(story.path) as page:
        load_page(phone, page)
        assert not seen(phone, "stopped")
        assert phone.execute_script("return document.documentElement.scrollWidth") == WIDTH

        # Somebody heard that the link was lost. When it is lost again, that is news.
        lost_twice = """
          const stage = data.stages[data.stages.length - 1], rings = [];
          for (const words of ["link lost", "", "link lost", ""]) {
            soundAlarm(stage, words);
            rings.push(beeping !== null);
            if (words) calm();
          }
          delete document.body.dataset.beeps;
          return rings;
        """
        assert phone.execute_script(lost_twice) == [True, False, True, False]

        tap(phone, "#stop")
        assert story.ordered(1, "stop")["off"] is False
        # The touch allowed the sound, too.
        says(phone, "sound", "Sound on")
        story.stop(1, "hold", "console", "ordered")
        story.stop(1, "hold", "console", "sent")
        says(phone, "stopped", "sent 00:01:42")
        assert "taken" not in phone.find_element(By.ID, "stopped-states").text
        story.stop(1, "hold", "console", "taken")
        says(phone, "stopped", "STOPPED: the aPad holds its place")
        says(phone, "stopped", "taken by the vehicle 00:01:43")
        stop, off = (phone.find_element(By.ID, it) for it in ("stop", "off"))
        assert (stop.is_enabled(), off.get_attribute("aria-pressed")) == (False, "false")
        assert "STOPPED" in phone.title
        assert low_contrast(phone) == []
        # Of no alarm: a person ordered it.
        assert phone.execute_script("return document.body.dataset.beeps") is None

        tap(phone, "#continue")
        tap(phone, "#sure button[value=yes]")
        assert story.ordered(2, "continue")["stop"] == 1
        story.writes("continued", number=1, by="console")
        story.passes()
        wait_until(lambda: not seen(phone, "stopped") and stop.is_enabled())

        # A guard's stop without thrust: it drifts, and the alarm sounds until it was heard.
        story.stop(2, "off", "guard: frozen", "ordered", reason="the position stands still")
        story.stop(2, "off", "guard: frozen", "taken")
        says(phone, "stopped", "MOTORS OFF: the aPad has no thrust")
        assert low_contrast(phone) == []
        wait_until(lambda: int(phone.execute_script("return document.body.dataset.beeps || 0")) >= 2)
        story.writes("drift", north_m=5.0, east_m=20.0, speed_m_s=0.31, towards_rad=4.2, fence_s=75.0)
        story.passes()
        says(
            phone,
            "drift",
            "Drifts 0.31 m/s to the south-west (241°), at 5.0 m north, 20.0 m east; at the fence in 75 s",
        )
        tap(phone, "#heard")
        assert not seen(phone, "heard")
        assert phone.execute_script("return beeping") is None
        # The next drift is news.
        story.writes("drift", speed_m_s=0.31, towards_rad=4.2, fence_s=None)
        story.passes()
        wait_until(lambda: seen(phone, "heard"))
        assert "fence" not in phone.find_element(By.ID, "drift").text
        says(phone, "primitive", "no thrust")
        # Still water carries nothing away, and that alarms nobody.
        tap(phone, "#heard")
        story.writes("drift", speed_m_s=0.004, towards_rad=4.2, fence_s=None)
        story.passes()
        says(phone, "drift", "No drift is seen")
        assert not seen(phone, "heard")

        tap(phone, "#off")
        assert story.ordered(3, "stop")["off"] is True
        tap(phone, "#hands")
        story.ordered(4, "hands")

        # A stop that the vehicle does not take may be ordered again.
        story.stop(3, "off", "console", "ordered")
        story.stop(3, "off", "console", "not taken", reason="no answer within 3 s")
        says(phone, "stopped", "STOP NOT TAKEN by the vehicle")
        assert seen(phone, "stop")
        assert phone.execute_script("return document.documentElement.scrollWidth") == WIDTH
    assert errors(phone) == []


def test_what_follows_in_a_tick_that_the_page_has_shown_is_shown(
    phone: webdriver.Chrome, story: Story
) -> None:
    columns = """
        const lengths = ["times_ms", "active", "cost", "apad", "docks", "stage"].map((it) => data[it].length);
        for (const agent of data.agents) for (const it of data.live.columns) if (agent[it]) lengths.push(agent[it].length);
        return [...new Set(lengths)];
    """
    with console_service().beside(story.path) as page:
        load_page(phone, page)
        story.passes()
        wait_until(lambda: phone.execute_script("return document.body.dataset.timeMs") == "102000")
        (samples,) = phone.execute_script(columns)
        story.writes(
            "stop", number=1, mode="hold", by="guard: frozen", state="taken", reason="it stands still"
        )
        says(phone, "stopped", "STOPPED: the aPad holds its place")
        story.writes("end", reason="a call: abort by console", end_reason="a call")
        says(phone, "warning", "The run has ended: a call: abort by console.")
        assert phone.execute_script(columns) == [samples]
        assert phone.execute_script("return document.body.dataset.timeMs") == "102000"
