"""The replay page under a person's hand, from disk in a browser without a network: controls, figures and damaged runs."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from browsers import cells, errors, load_page, text
from programs import ROOT, code_here, wait_until
from scenario_files import write_scenario
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

from apad_bridge.analysis.replay.build import build_comparison, build_replay

pytestmark = pytest.mark.system
HOSTILE = "<script>window.hurt = 1</script>"

PAINTED_SLOTS = """
const slots = $("slots"), count = data.timeslots.frame_ms / data.timeslots.slot_ms, painted = new Set();
const paint = document.createElement("canvas").getContext("2d");
paint.fillStyle = PAINT.received;
paint.fillRect(0, 0, 1, 1);
const [r, g, b] = paint.getImageData(0, 0, 1, 1).data;
const {data: pixels} = slots.getContext("2d").getImageData(0, 0, slots.width, slots.height);
for (let i = 0; i < pixels.length; i += 4) {
  if (pixels[i] !== r || pixels[i + 1] !== g || pixels[i + 2] !== b) continue;
  painted.add(Math.floor(count * (i / 4 % slots.width + 0.5 - 84) / (slots.width - 94)));
}
return [...painted];
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half an hour of three whole boards that speak by sound in timeslots."""
    folder = tmp_path_factory.mktemp("flown")
    sound = ROOT / "launch_scripts/scenarios/sound-12.yaml"
    fleet = {"count": 3, "start": {"charge": [0.5, 0.9]}, "hosting": "one_process"}
    path = write_scenario(folder / "sound.yaml", sound, duration_s=1800, fleet=fleet)
    assert code_here("run", path, "--time", "asap", "--json", "--out", folder / "run") == 0
    return folder / "run"


@pytest.fixture(autouse=True)
def no_errors(browser: webdriver.Chrome) -> Iterator[None]:
    yield
    assert errors(browser) == []


def open_page(browser: webdriver.Chrome, page: Path, at: str = "") -> None:
    load_page(browser, page.as_uri() + at)


def the(browser: webdriver.Chrome, element: str) -> WebElement:
    return browser.find_element(By.ID, element)


def now_s(browser: webdriver.Chrome) -> float:
    return float(browser.execute_script("return nowMs / 1000"))


def listed(browser: webdriver.Chrome) -> list[str]:
    found = browser.execute_script(
        "return [...document.querySelectorAll('#events span')].map((it) => it.textContent)"
    )
    return list(found)


def press(browser: webdriver.Chrome, *keys: str) -> None:
    ActionChains(browser).send_keys(*keys).perform()


def shown_span_s(browser: webdriver.Chrome) -> list[list[float]]:
    """The span of each chart over mission time, without doubles."""
    spans = browser.execute_script(
        "return [...charts.values()].map(({plot}) => [plot.scales.x.min / 1000, plot.scales.x.max / 1000])"
    )
    return [list(it) for it in dict.fromkeys(tuple(map(round, it)) for it in spans)]


def test_the_figures_are_those_of_the_summary(browser: webdriver.Chrome, flown: Path) -> None:
    open_page(browser, build_replay(flown), "#t=1800")
    summary = json.loads((flown / "summary.json").read_text())
    figures = dict(cells(browser, "#figures div"))
    assert figures == {
        "uptime at the end": f"{summary['uptime_paper']['mean']:.2f} %",
        "active": f"{summary['active_mean']:.2f}",
        "way flown": f"{summary['cost_m']:.0f} m",
        "way planned": f"{summary['planned_m']:.0f} m",
        "services": str(summary["services"]),
        "emptied": str(summary["emptied"]),
        "lost": str(summary["amussels_lost"]),
        "samples": str(summary["samples_taken"]),
        "at equal charge": f"{summary['uptime_equal_charge']:.2f} %",
        "charge gained": f"{100 * summary['charge_gain_mean']:.1f} %",
    }
    taken = browser.execute_script("return data.agents.map((it) => it.taken[it.taken.length - 1])")
    assert sum(taken) == summary["samples_taken"]


def test_each_control_does_what_it_says(browser: webdriver.Chrome, flown: Path) -> None:
    open_page(browser, build_replay(flown), "#t=900")
    # One aMussel, by its chip, by the map, and by none.
    browser.find_element(By.CSS_SELECTOR, "#agents [data-agent='2']").click()
    assert text(browser, "one-now").startswith("2: ") and "aMussel=2" in browser.current_url
    x, y = browser.execute_script(
        "const to = mapScale($('map').clientWidth, $('map').clientHeight), [n, e] = viewAt(nowMs, data).agents[2].place;"
        "return [to.x(e) - $('map').clientWidth / 2, to.y(n) - $('map').clientHeight / 2]"
    )
    ActionChains(browser).move_to_element_with_offset(
        the(browser, "map"), round(x), round(y)
    ).click().perform()
    assert text(browser, "one-now").startswith("3: ")
    press(browser, Keys.ESCAPE)
    assert not the(browser, "one-card").is_displayed()
    # The time, by the keys and by a click in a chart.
    press(browser, Keys.END)
    assert now_s(browser) == 1800
    press(browser, Keys.HOME)
    assert now_s(browser) == 0
    press(browser, Keys.ARROW_RIGHT)
    assert now_s(browser) == browser.execute_script("return data.times_ms[1] / 1000")
    over = browser.find_element(By.CSS_SELECTOR, "#cost .u-over")
    ActionChains(browser).move_to_element(over).click().perform()
    assert now_s(browser) == pytest.approx(900, abs=5)
    # The zoom of all charts: dragged, by its buttons, and in the address.
    ActionChains(browser).move_to_element(over).click_and_hold().move_by_offset(
        round(over.size["width"] / 4), 0
    ).release().perform()
    wait_until(lambda: shown_span_s(browser) != [[0, 1800]])
    ((low, high),) = shown_span_s(browser)
    assert (low, high) == (pytest.approx(900, abs=10), pytest.approx(1350, abs=10))
    assert now_s(browser) == pytest.approx(900, abs=5)
    the(browser, "whole").click()
    wait_until(lambda: shown_span_s(browser) == [[0, 1800]])
    the(browser, "nearer").click()
    wait_until(lambda: shown_span_s(browser) != [[0, 1800]])
    assert "zoom=" in browser.current_url
    the(browser, "wider").click()
    wait_until(lambda: shown_span_s(browser) == [[0, 1800]])
    # The events, by words and by kinds; a click goes to the time.
    everything = listed(browser)
    the(browser, "search").send_keys("closed around")
    found = listed(browser)
    assert found and found == [it for it in everything if "closed around" in it]
    browser.find_element(By.CSS_SELECTOR, "#events button").click()
    assert now_s(browser) * 1000 == float(
        browser.find_element(By.CSS_SELECTOR, "#events li").get_attribute("data-ms") or ""
    )
    browser.execute_script("$('search').value = ''; $('search').dispatchEvent(new Event('input'))")
    browser.execute_script("$('kinds').value = 'selected'; $('kinds').dispatchEvent(new Event('change'))")
    assert listed(browser) == []
    docked = found[0].rpartition(" ")[2]
    browser.find_element(By.CSS_SELECTOR, f"#agents [data-agent='{docked}']").click()
    assert listed(browser) == [it for it in everything if f"aMussel {docked}" in it]
    # Playing, contrast and reasons.
    begun_s = now_s(browser)
    the(browser, "play").click()
    wait_until(lambda: now_s(browser) > begun_s)
    the(browser, "play").click()
    browser.execute_script("document.activeElement.blur()")
    press(browser, "c", "w")
    assert browser.execute_script("return [document.documentElement.dataset.theme, $('why').open]") == [
        "contrast",
        True,
    ]


def test_timeslots_and_modules_are_those_of_the_boards(browser: webdriver.Chrome, flown: Path) -> None:
    open_page(browser, build_replay(flown), "#t=1800&aMussel=2")
    rows = browser.execute_script("return rowsOf(data.agents[1]).map((it) => [it.name, it.spans.length])")
    found = dict(rows)
    assert {"state", "mu asleep", "mu active", "pi", "modem transmitting", "sampled", "sent"} <= found.keys()
    # A board transmits as often as its packets say, and in its own timeslot.
    sent = browser.execute_script(
        "return data.packets.filter((it) => it[2] === 2 && it[5] === null).map((it) => it[8])"
    )
    assert len(sent) == found["sent"] > 2
    painted = set(browser.execute_script(PAINTED_SLOTS))
    own = browser.execute_script("return data.packets.filter((it) => isOf(it, 2)).map((it) => it[8])")
    assert 1 in painted <= set(own)
    browser.execute_script("show(0)")
    assert browser.execute_script(PAINTED_SLOTS) == []


def test_two_runs_stand_side_by_side_with_what_differs(browser: webdriver.Chrome, flown: Path) -> None:
    other = flown.with_name("other")
    shutil.copytree(flown, other, dirs_exist_ok=True)
    scenario = yaml.safe_load((other / "scenario.yaml").read_text())
    scenario["mission"]["speed_m_s"] = 0.25
    (other / "scenario.yaml").write_text(yaml.safe_dump(scenario))
    summary = json.loads((other / "summary.json").read_text())
    (other / "summary.json").write_text(json.dumps({**summary, "cost_m": summary["cost_m"] + 10}))
    page = build_comparison(flown, other)
    assert page == flown / "compared-with-other.html"
    open_page(browser, page, "#t=900&run=other")
    rows = cells(browser, "#differences tr")
    cost_m = summary["cost_m"]
    titles = [row[0] for row in rows if row[1:] == ["run", "other", "change"]]
    assert titles == ["At 00:15:00", "At the end, where they differ", "Settings that differ"]
    ended, settings = (rows.index([title, "run", "other", "change"]) for title in titles[1:])
    costs = [f"{it:.2f}".rstrip("0").rstrip(".") for it in (cost_m, cost_m + 10)]
    assert rows[ended + 1 : settings] == [["cost m", *costs, "+10"]]
    assert rows[settings + 1 :] == [["mission.speed_m_s", "0.5", "0.25", ""]]
    assert [text(browser, it) for it in ("map-name", "other-name")] == ["run", "other"]
    assert the(browser, "other-map").is_displayed()
    assert browser.execute_script("return [data.run_name, charts.get('cost').plot.series.length]") == [
        "other",
        3,
    ]


def test_a_damaged_an_empty_and_a_hostile_run_are_shown(browser: webdriver.Chrome, flown: Path) -> None:
    torn = flown.with_name("torn")
    shutil.copytree(flown, torn)
    (torn / "summary.json").unlink()
    journal = (torn / "journal.jsonl").read_text()
    half = journal[: len(journal) // 2 // 100 * 100]
    (torn / "journal.jsonl").write_text(half.replace('{"t":', '{"t:', 2).replace('{"t:', '{"t":', 1))
    open_page(browser, build_replay(torn))
    assert "could not be read" in text(browser, "warning") and "has not ended" in text(browser, "about")
    press(browser, Keys.END)
    assert 0 < now_s(browser) < 1800

    (torn / "journal.jsonl").write_text(journal[: journal.index("\n") + 1])
    open_page(browser, build_replay(torn), "#t=5")
    the(browser, "play").click()
    wait_until(lambda: browser.execute_script("return playing === null"))
    assert (now_s(browser), text(browser, "mission-clock"), text(browser, "phase")) == (
        0,
        "00:00:00",
        "not begun",
    )

    scenario = yaml.safe_load((torn / "scenario.yaml").read_text())
    (torn / "scenario.yaml").write_text(yaml.safe_dump({**scenario, "description": HOSTILE}))
    remark = json.dumps({"t": 1000, "kind": "remark", "text": HOSTILE, "by": HOSTILE})
    (torn / "journal.jsonl").write_text(journal.replace('"cautious"', json.dumps(HOSTILE)) + remark + "\n")
    open_page(browser, build_replay(torn), "#t=1800&why=1")
    assert HOSTILE in text(browser, "about") and HOSTILE in text(browser, "reasons")
    assert f"{HOSTILE}: {HOSTILE}" in listed(browser)
    assert browser.execute_script("return window.hurt === undefined")
