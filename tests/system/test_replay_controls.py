"""The replay page under a person's hand, from disk in a browser without a network: controls, figures and damaged runs."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from browsers import cells, errors, load_page
from programs import ROOT, code_here, wait_until
from scenario_files import write_scenario
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from apad_bridge.analysis.replay.build import build_comparison, build_replay

pytestmark = pytest.mark.system
HOSTILE = "<script>window.hurt = 1</script>"
Act = Callable[[webdriver.Chrome], Any]

HELPERS = """
const said = (id) => $(id).textContent.replace(/\\s+/g, " ").trim();
const listed = () => [...document.querySelectorAll("#events span")].map((it) => it.textContent);
const same = (one, other) => JSON.stringify(one) === JSON.stringify(other);
const near = (value, wanted, by) => Math.abs(value - wanted) <= by;
const spansMs = [...charts.values()].map(({plot}) => [plot.scales.x.min, plot.scales.x.max]);
const spans = spansMs.map((it) => it.map((ms) => Math.round(ms / 1000)));
const isWhole = spans.every((it) => same(it, [0, 1800]));
"""
SLOTS = """
const painted = () => {
  const slots = $("slots"), count = data.timeslots.frame_ms / data.timeslots.slot_ms, found = new Set();
  const paint = document.createElement("canvas").getContext("2d");
  paint.fillStyle = PAINT.received;
  paint.fillRect(0, 0, 1, 1);
  const [r, g, b] = paint.getImageData(0, 0, 1, 1).data;
  const {data: pixels} = slots.getContext("2d").getImageData(0, 0, slots.width, slots.height);
  for (let i = 0; i < pixels.length; i += 4) {
    if (pixels[i] !== r || pixels[i + 1] !== g || pixels[i + 2] !== b) continue;
    found.add(Math.floor(count * (i / 4 % slots.width + 0.5 - 84) / (slots.width - 94)));
  }
  return [...found];
};
const rows = Object.fromEntries(rowsOf(data.agents[1]).map((it) => [it.name, it.spans.length]));
const named = ["state", "mu asleep", "mu active", "pi", "modem transmitting", "sampled", "sent"].every((it) => it in rows);
const sent = data.packets.filter((it) => it[2] === 2 && it[5] === null), late = painted();
const own = data.packets.filter((it) => isOf(it, 2)).map((it) => it[8]);
show(0);
return [named, sent.length > 2, sent.length - rows.sent, late.includes(1), late.every((it) => own.includes(it)), painted()];
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


def test_the_figures_are_those_of_the_summary(browser: webdriver.Chrome, flown: Path) -> None:
    open_page(browser, build_replay(flown), "#t=1800")
    summary = json.loads((flown / "summary.json").read_text())
    assert dict(cells(browser, "#figures div")) == {
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


def click(selector: str) -> Act:
    return lambda browser: browser.find_element(By.CSS_SELECTOR, selector).click()


def keys(*pressed: str) -> Act:
    return lambda browser: ActionChains(browser).send_keys(*pressed).perform()


def script(text: str) -> Act:
    return lambda browser: browser.execute_script(HELPERS + text)


def pointer(selector: str, drag_part: float = 0.0) -> Act:
    """A click in an element's middle, or a drag from there over this part of its width."""

    def act(browser: webdriver.Chrome) -> None:
        over = browser.find_element(By.CSS_SELECTOR, selector)
        hand = ActionChains(browser).move_to_element(over).click_and_hold()
        hand.move_by_offset(round(over.size["width"] * drag_part), 0).release().perform()

    return act


def third_on_the_map(browser: webdriver.Chrome) -> None:
    x, y = browser.execute_script(
        "const to = mapScale($('map').clientWidth, $('map').clientHeight), [n, e] = viewAt(nowMs, data).agents[2].place;"
        "return [to.x(e) - $('map').clientWidth / 2, to.y(n) - $('map').clientHeight / 2].map(Math.round)"
    )
    ActionChains(browser).move_to_element_with_offset(
        browser.find_element(By.ID, "map"), x, y
    ).click().perform()


CONTROLS: list[tuple[Act, str]] = [
    # One aMussel, by its chip, by the map, and by none.
    (
        click("#agents [data-agent='2']"),
        "said('one-now').startsWith('2: ') && location.hash.includes('aMussel=2')",
    ),
    (third_on_the_map, "said('one-now').startsWith('3: ')"),
    (keys(Keys.ESCAPE), "$('one-card').offsetParent === null"),
    # The time, by the keys and by a click in a chart.
    (keys(Keys.END), "nowMs === 1800000"),
    (keys(Keys.HOME), "nowMs === 0"),
    (keys(Keys.ARROW_RIGHT), "nowMs === data.times_ms[1]"),
    (pointer("#cost .u-over"), "near(nowMs, 900000, 5000)"),
    # The zoom of all charts: dragged, by its buttons, and in the address.
    (
        pointer("#cost .u-over", 0.25),
        "spans.every(([low, high]) => near(low, 900, 10) && near(high, 1350, 10)) && near(nowMs, 900000, 5000)",
    ),
    (click("#whole"), "isWhole"),
    (click("#nearer"), "!isWhole && location.hash.includes('zoom=')"),
    (click("#wider"), "isWhole"),
    # The events, by words and by kinds; a click goes to the time.
    (script("window.all = listed()"), "window.all.length > 0"),
    (
        lambda browser: browser.find_element(By.ID, "search").send_keys("closed around"),
        "listed().length > 0 && same(listed(), window.all.filter((it) => it.includes('closed around')))",
    ),
    (click("#events button"), "nowMs === Number(document.querySelector('#events li').dataset.ms)"),
    (
        script("""
          window.docked = listed()[0].split(" ").pop();
          $("search").value = ""; $("search").dispatchEvent(new Event("input"));
          $("kinds").value = "selected"; $("kinds").dispatchEvent(new Event("change"));
        """),
        "listed().length === 0",
    ),
    (
        script("document.querySelector(`#agents [data-agent='${window.docked}']`).click()"),
        "same(listed(), window.all.filter((it) => it.includes(`aMussel ${window.docked}`)))",
    ),
    # Playing, contrast and reasons.
    (script("window.begunMs = nowMs; $('play').click()"), "nowMs > window.begunMs"),
    (script("$('play').click(); document.activeElement.blur()"), "playing === null"),
    (keys("c", "w"), "document.documentElement.dataset.theme === 'contrast' && $('why').open"),
]
"""What a hand does, and what then holds in the page."""


def test_each_control_does_what_it_says(browser: webdriver.Chrome, flown: Path) -> None:
    open_page(browser, build_replay(flown), "#t=900")
    for act, holds in CONTROLS:
        act(browser)
        wait_until(lambda holds=holds: browser.execute_script(f"{HELPERS} return {holds}"), why=holds)


def test_timeslots_and_modules_are_those_of_the_boards(browser: webdriver.Chrome, flown: Path) -> None:
    """A board transmits as often as its packets say, and in its own timeslot."""
    open_page(browser, build_replay(flown), "#t=1800&aMussel=2")
    assert browser.execute_script(SLOTS) == [True, True, 0, True, True, []]


def test_two_runs_stand_side_by_side_with_what_differs(browser: webdriver.Chrome, flown: Path) -> None:
    other = flown.with_name("other")
    shutil.copytree(flown, other)
    scenario = (other / "scenario.yaml").read_text()
    (other / "scenario.yaml").write_text(scenario.replace("speed_m_s: 0.5", "speed_m_s: 0.25", 1))
    summary = json.loads((other / "summary.json").read_text())
    (other / "summary.json").write_text(json.dumps({**summary, "cost_m": summary["cost_m"] + 10}))
    build_comparison(flown, other)
    open_page(browser, flown / "compared-with-other.html", "#t=900&run=other")
    rows = cells(browser, "#differences tr")
    titles = [row[0] for row in rows if row[1:] == ["run", "other", "change"]]
    assert titles == ["At 00:15:00", "At the end, where they differ", "Settings that differ"]
    begun = rows.index([titles[1], "run", "other", "change"])
    costs = [f"{summary['cost_m'] + it:.2f}".rstrip("0").rstrip(".") for it in (0, 10)]
    assert rows[begun + 1] == ["cost m", *costs, "+10"]
    assert rows[begun + 3 :] == [["mission.speed_m_s", "0.5", "0.25", ""]]
    look = """
      return [said("map-name"), said("other-name"), $("other-map").offsetParent !== null, data.run_name,
        charts.get("cost").plot.series.length];
    """
    assert browser.execute_script(HELPERS + look) == ["run", "other", True, "other", 3]


REMARK = json.dumps({"t": 1_800_000, "kind": "remark", "text": HOSTILE, "by": HOSTILE})
DAMAGED: dict[str, tuple[Callable[[str], str], str, Act, str]] = {
    "torn": (
        lambda it: it[: len(it) // 200 * 100].replace('{"t":', '{"t:', 2).replace('{"t:', '{"t":', 1),
        "",
        keys(Keys.END),
        """
          said("warning").includes("could not be read") && said("about").includes("has not ended")
          && 0 < nowMs && nowMs < 1800000
        """,
    ),
    "empty": (
        lambda it: it[: it.index("\n") + 1],
        "#t=5",
        click("#play"),
        "playing === null && nowMs === 0 && said('mission-clock') === '00:00:00' && said('phase') === 'waiting'",
    ),
    "hostile": (
        lambda it: it.replace('"cautious"', json.dumps(HOSTILE)) + REMARK + "\n",
        "#t=1800&why=1",
        script("window.hostile = '<scr' + 'ipt>window.hurt = 1</scr' + 'ipt>'"),
        """
          said("about").includes(window.hostile) && said("reasons").includes(window.hostile)
          && listed().includes(`${window.hostile}: ${window.hostile}`) && window.hurt === undefined
        """,
    ),
}
"""What became of the journal, an address, what a hand does there, and what then holds."""


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_an_empty_and_a_hostile_run_are_shown(
    name: str, browser: webdriver.Chrome, flown: Path, tmp_path: Path
) -> None:
    damage, at, act, holds = DAMAGED[name]
    run = shutil.copytree(flown, tmp_path / "run")
    (run / "summary.json").unlink()
    scenario = yaml.safe_load((run / "scenario.yaml").read_text())
    (run / "scenario.yaml").write_text(yaml.safe_dump({**scenario, "description": HOSTILE}))
    (run / "journal.jsonl").write_text(damage((run / "journal.jsonl").read_text()))
    open_page(browser, build_replay(run), at)
    act(browser)
    wait_until(lambda: browser.execute_script(f"{HELPERS} return {holds.strip()}"), why=holds)
