"""The replay page of a small run, in a real browser without a network: what it says, and what it paints."""

from __future__ import annotations

import json
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from browsers import LEAST_CONTRAST, load_page, low_contrast, scheme, screen
from scenario_files import POOL_FILE
from selenium import webdriver

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from apad_bridge.analysis.replay.build import build_replay
from apad_bridge.beliefs.belief import Belief, CapacityLeft
from apad_bridge.beliefs.modes import Mode
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import (
    MissionChanged,
    MissionState,
    Phase,
    PlanMade,
    PrimitiveChanged,
    PrimitivePhase,
)
from apad_bridge.events.run_events import RunEnded
from apad_bridge.events.sound_events import PacketPassed
from apad_bridge.planning.solution import Step, StepKind
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import journal_start
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.starts_table import Start
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow, grains
from firmware_model.states import State

pytestmark = pytest.mark.system
PLACES = {1: (5.0, 5.0), 2: (5.0, 15.0), 3: (22.0, 5.0), 4: (22.0, 15.0)}
DOCKED_S, LOST_S, END_S = 60, 90, 120


def truth(at_s: int, agent_id: int, charge: float, *, docked: bool = False, secondary: float = 1.0) -> Truth:
    primary, backup = (Battery(30_000 * at_s, grains(it), Flow.RESTING) for it in (charge, secondary))
    north_um, east_um = (round(1e6 * it) for it in PLACES[agent_id])
    physical = Physical(primary, backup, north_um, east_um, 0, 3_000_000, Buoyancy.SINK, docked)
    return Truth(30_000 * at_s, agent_id, State.CHARGING if docked else State.ACTIVE, physical)


TOLD = {
    0: [truth(0, 1, 0.95), truth(0, 2, 0.6), truth(0, 3, 0.5), truth(0, 4, 0.0)],
    DOCKED_S: [truth(DOCKED_S, 2, 0.6, docked=True)],
    LOST_S: [truth(LOST_S, 4, 0.0, secondary=0.0)],
}
"""By the second."""
COLLECT = (Step(StepKind.COLLECT, 2, 0), Step(StepKind.COLLECT, 3, 1))


def packet(at_s: int, sender: int, unsent: str | None, *heard: tuple[int, str]) -> PacketPassed:
    return PacketPassed(
        from_=sender,
        address=255,
        what="unicast",
        bytes=45,
        began_ms=30 * (1000 * at_s - 500),
        lasted_ms=868,
        timeslot=0,
        unsent=unsent,
        heard=[(listener, outcome, 20.0, 30_000 * at_s, 5.0, 7.5) for listener, outcome in heard],
        data_="",
    )


HAPPENED: dict[int, list[Event]] = {
    10: [
        PlanMade(
            what="collect",
            strategy="cautious",
            steps=[{"agent": it.agent_id, "dock": it.dock_index} for it in COLLECT],
            costs={"distance_m": 22.5, "demand": 0.9, "distance_cost": 22.5, "energy_cost": 0.9},
            beliefs=[
                {"id": 2, "charge": 0.2, "north_m": 5.0, "east_m": 15.0, "reported": {"depth_m": 2.5}},
                *({"id": n, "charge": n / 10, "north_m": 5.0, "east_m": 15.0} for n in (3, 4)),
            ],
            options=[
                {"agents": agents, "cost": cost, "parts": {"charge": cost}}
                for agents, cost in (([2, 3], 1.5), ([2, 4], 1.75), ([3, 4], 2.0))
            ],
        ),
        MissionChanged(Phase.GO_COLLECT, MissionState(Phase.GO_COLLECT, plan=COLLECT, cost_m=7.5)),
        PrimitiveChanged("go to point", PrimitivePhase.STARTED, north_m=5.0, east_m=15.0),
    ],
    20: [packet(20, 3, None, (0, "received"), (4, "collided"), (1, "out_of_range"))],
    21: [packet(21, 1, "the modem is busy")],
}
"""By the second."""


def estimate(now_ms: int) -> Belief:
    """Of the first, which holds 0.95: 0.8 with a deviation of 0.05. From 30 s on its twin knows the batteries' age."""
    modes = tuple(float(mode is Mode.IDLE) for mode in Mode)
    capacity_left = None if now_ms < 30_000 else CapacityLeft(0.7149, 0.8611)
    return Belief(
        1,
        now_ms,
        State.ACTIVE,
        0.8,
        1.0,
        5.0,
        5.0,
        0,
        (0.0025, 0.0, 0.0),
        mode_probabilities=modes,
        capacity_left=capacity_left,
    )


SAMPLES = [
    {"id": n, "sequence": k, "mission_ms": 1000 * at_s, "oxygen_mg_l": oxygen, "pressure_mbar": 1314.8}
    for n, k, at_s, oxygen in ((1, 1, 60, 7.5), (1, 0, 30, 8.0), (2, 0, 30, 2.0))
]
STOPS = [
    {"t": 20_000, "kind": "operator", "order": "stop", "by": "Anna"},
    {"t": 40_000, "kind": "operator", "order": "continue", "by": "Anna"},
    {"t": 60_000, "kind": "override", "taken": True, "by": "vehicle"},
    {"t": 80_000, "kind": "override", "taken": False, "by": "person"},
]
"""A person's stop from 20 to 40 s, and a pilot from 60 to 80 s."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two minutes: 1 stays above the threshold, 2 is docked at 60 s, 3 is a candidate, 4 is lost at 90 s.

    Beside that run stand one with uploaded samples, one that was stopped, and one of two aPads.
    """
    folder, scenario = tmp_path_factory.mktemp("runs"), load(POOL_FILE)
    directory = RunDirectory.create("story", datetime(2026, 5, 4, tzinfo=UTC), folder / "story")
    directory.write_inputs(scenario, starts_of(scenario)[:4])
    recorder = Recorder(directory, scenario, PLACES)
    journal_start(recorder, scenario, [Start(n, *place, 1.0, 1.0) for n, place in PLACES.items()])
    for now_s in range(END_S + 1):
        now_ms = 1000 * now_s
        recorder.truths(TOLD.get(now_s, []))
        for it in HAPPENED.get(now_s, ()):
            recorder.event(now_ms, it)
        pose = PoseReported(now_ms, 14.0, 2.0 + min(now_s, DOCKED_S) / 10, 1.0)
        slots = (2 if now_s >= DOCKED_S else None, None, None, None)
        recorder.tick(
            now_ms, [estimate(now_ms)], pose, BatteryReported(now_ms, 15.0, 0.9), "go to point", slots
        )
    recorder.event(1000 * END_S, RunEnded("mission time"))
    recorder.close()
    journal = (folder / "story/journal.jsonl").read_text()
    for copy in ("measured", "stopped", "several/apad1", "several/apad2"):
        shutil.copytree(folder / "story", folder / copy)
    (folder / "measured/samples.jsonl").write_text("".join(json.dumps(it) + "\n" for it in SAMPLES))
    lines = sorted([*map(json.loads, journal.splitlines()), *STOPS], key=lambda line: line["t"])
    (folder / "stopped/journal.jsonl").write_text("".join(json.dumps(it) + "\n" for it in lines))
    greedy = journal.replace('"strategy":"cautious"', '"strategy":"greedy"')
    (folder / "several/apad2/journal.jsonl").write_text(greedy)
    for run in ("story", "measured", "stopped", "several"):
        build_replay(folder / run)
    return folder


def opened(browser: webdriver.Chrome, pages: Path, at: str, run: str = "story") -> webdriver.Chrome:
    """The browser with the page from disk."""
    load_page(browser, (pages / run / "replay.html").as_uri() + at)
    return browser


HELPERS = """
const squeezed = (words) => words.replace(/\\s+/g, " ").trim(), said = (id) => squeezed($(id).textContent);
const texts = (selector) => [...document.querySelectorAll(selector)].map((it) => squeezed(it.innerText));
const cells = (selector) =>
  [...document.querySelectorAll(selector)].map((it) => [...it.children].map((one) => one.textContent));
const plan = () => squeezed($("plan").innerHTML.replace(/<[^>]+>/g, " "));
const has = (words) => document.documentElement.outerHTML.includes(words);
const shown = () => Object.fromEntries([
  ...["mission-clock", "agent-clock", "primitive", "docks", "active-now", "cost-now"].map((it) => [it, said(it)]),
  ["plan", plan()],
  ...[...document.querySelectorAll("#agents li")].map((it) =>
    [it.dataset.agent, [it.dataset.status, it.querySelector("span").textContent].join(" ")]),
]);
const measured = () => {
  const card = $("measured-card");
  return [card.hidden, squeezed(card.querySelector("h2").innerText), cells("#measured-card figcaption"),
    charts.get("measured-0")?.plot.data.slice(1).map((it) => [...new Set(it)].filter((one) => one !== undefined))];
};
const painted = () => {
  const map = $("map"), ctx = map.getContext("2d"), to = mapScale(map.clientWidth, map.clientHeight);
  const pixels = ctx.getImageData(0, 0, map.width, map.height).data, found = {purple: 0};
  for (const [id, [n, e]] of Object.entries(data.homes))
    found[id] = [...ctx.getImageData(Math.round(to.x(e)) - 6, Math.round(to.y(n)), 1, 1).data].slice(0, 3).join();
  for (let i = 0; i < pixels.length; i += 4)
    found.purple += pixels[i] === 0x7b && pixels[i + 1] === 0x48 && pixels[i + 2] === 0xc8;
  return found;
};
const hover = (of, x, y) => {
  const element = document.querySelector(of), box = element.getBoundingClientRect();
  const place = {clientX: box.left + x, clientY: box.top + y, bubbles: true};
  element.dispatchEvent(new MouseEvent("mousemove", place));
  element.dispatchEvent(new PointerEvent("pointermove", place));
  return $("hover").hidden ? "" : $("hover").textContent;
};
const light = (colour) => {
  const probe = document.createElement("i"); probe.style.color = colour; document.body.append(probe);
  const parts = getComputedStyle(probe).color.match(/\\d+/g).map((it) => it / 255)
    .map((it) => it <= 0.03928 ? it / 12.92 : ((it + 0.055) / 1.055) ** 2.4);
  return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
};
const ratio = (one, other) => (Math.max(light(one), light(other)) + 0.05) / (Math.min(light(one), light(other)) + 0.05);
"""
"""Of WCAG 2.1 are `light` and `ratio`."""
DRAG = "$('scrub').value = '100'; $('scrub').dispatchEvent(new Event('input'));"
"""As a hand on the scrubber does it: its value changes and it says `input`."""
PLAY = """
  // A clock and frames of our own, so that how long the browser takes does not matter.
  let now = 0; const frames = [], seen = [], press = (id) => $(id).click();
  performance.now = () => now; window.requestAnimationFrame = (it) => frames.push(it);
  const pass = (ms) => { now += ms; for (const it of frames.splice(0)) it(); seen.push(document.body.dataset.timeMs); };
  $("speed").value = "20";
  press("play"); pass(1500); pass(500); press("play"); pass(500); press("play"); pass(1000); pass(5000); pass(5000);
  return [seen.join(" "), $("play").getAttribute("aria-label")];
"""
SHADES = """
  // What a chart leaves empty is not painted at all, but for the shades.
  const commonest = (values) => {
    const counts = new Map();
    for (const it of values) counts.set(it, (counts.get(it) || 0) + 1);
    return [...counts].sort((a, b) => b[1] - a[1])[0][0];
  };
  const opacity = ({ctx, bbox}, plot, ms) => {
    const pixels = ctx.getImageData(Math.round(plot.valToPos(ms, "x", true)), bbox.top, 1, bbox.height).data;
    return commonest([...pixels].filter((_, n) => n % 4 === 3));
  };
  const found = [...charts].filter(([, it]) => it.plot.bbox.height > 0)
    .map(([name, {plot}]) => [name, [15, 30, 50, 70, 110].map((s) => opacity(plot, plot, 1000 * s))]);
  return [found.length > 3, found.filter(([, [before, stopped, between, byHand, after]]) =>
    !(before === between && between === after && after < stopped && stopped === byHand))];
"""
BAND = """
  const {plot} = charts.get("charge");
  const at = (value) => [...plot.ctx.getImageData(200, Math.round(plot.valToPos(value, "y", true)), 1, 1).data];
  const [upper, lower, below, above] = [0.85, 0.75, 0.66, 0.92].map(at);
  return [said("charge-now"), `${upper}` === `${lower}`, `${below}` === `${above}`,
    `${upper.slice(0, 3)}` === `${below.slice(0, 3)}`];
"""
POINTED = """
  const map = mapScale($("map").clientWidth, $("map").clientHeight), [north, east] = data.homes[3];
  return [
    ["#charge .u-over", 20, charts.get("charge").plot.valToPos(0.5, "y"), "aMussel 3: 50.0 %"],
    ["#active .u-over", 0.5, 20, "00:00:00  3"],
    ["#apad .u-over", 30, 20, "90.0 %"],
    ["#uptime", 80, 60, "aMussel 1: 83.3 % so far, 100.0 % at the end"],
    ["#map", map.x(east), map.y(north), "aMussel 3: 50.0 %"],
  ].filter(([of, x, y, words]) => !hover(of, x, y).includes(words));
"""
SUSPECT = """
  data.suspects = [[50000, 3, "its charge rose in the water", 55000]];
  showLegend();
  const item = document.querySelector("[data-agent='3']"), seen = [49, 50, 55].map((s) => {
    show(1000 * s);
    return [item.classList.contains("suspect"),
      item.title.includes("suspect since 00:00:50: its charge rose in the water")].join();
  });
  return [...seen, texts("#legend li:not([hidden])").includes("suspect: its packets contradict physics")];
"""
IN_SIGHT = """
  addEvents(Array.from({length: 200}, (_, n) => [100000 + 100 * n, "remark", "event " + n, null]));
  endMs = 121000;
  return [119, 105].map((s) => {
    show(1000 * s);
    const list = $("events").getBoundingClientRect(), now = document.querySelector("#events .now");
    const box = now.getBoundingClientRect();
    return [now.textContent.match(/event \\d+/)[0], box.top >= list.top && box.bottom <= list.bottom];
  });
"""
CHOOSE = """
  document.querySelector("#agents [data-agent='3']").click();
  $("theme").click();
  document.querySelector("#events button").click();
  return location.hash;
"""
LEARNED = """
  const words = "71 to 86 % of its capacity left";
  const titles = [...document.querySelectorAll("#agents li")].map((it) => it.title.includes(words));
  return [...titles, said("one-now").includes(words)];
"""
CONTRASTS = """
  const of = ["ink", "soft", "accent", ...STATUSES.slice(0, 4), "received", "collided", "half-duplex", "missed", "bad"];
  return Math.min(...of.map((it) => ratio(colour(it), colour("card")))) >= 7;
"""
WATER = """
  data.agents[0].water = data.times_ms.map((ms) => (ms < 50000 ? [8.1, 1314.7, 18, 5] : null)); select(1);
"""
APADS = "[...document.querySelectorAll('option')].map((it) => it.value).filter((it) => /^apad\\d$/.test(it))"
MEASURED = ["Temperature, degrees Celsius", ""], ["Turbidity, NTU", ""]
GREEN, AMBER, GREY, WHITE = "43,154,87", "176,116,0", "139,146,155", "255,255,255"
PAINTED_AS = f"""
  const {{1: above, 2: second, 3: candidate, 4: fourth, purple}} = painted();
  return [above, second === "{AMBER}" ? second : "at the aPad", candidate, fourth, purple > 50, purple];
"""
PACKETS = [
    "00:00:20 1 unicast not sent: the modem is busy",
    "00:00:19 3 unicast received: aPad; collided: 4; out of range or too weak: 1",
]
LEGEND = [
    "above the pool's threshold",
    "candidate: below the threshold",
    "charging",
    "primary battery empty",
    "lost",
    "home",
    "aPad with its docks",
    "its way",
    "its plan",
    "packet received",
    "collided",
    "missed otherwise",
]
AT_5_S = {
    "mission-clock": "00:00:05",
    "agent-clock": "00:02:30",
    "primitive": "no order under way",
    "plan": "none yet",
    "docks": "free · free · free · free",
    "active-now": "3 of 4",
    "cost-now": "0 m",
    **{"1": "above 95 %", "2": "candidate 60 %", "3": "candidate 50 %", "4": "empty 0 %"},
}
AT_100_S = {
    "mission-clock": "00:01:40",
    "agent-clock": "00:50:00",
    "primitive": "go to point 5.0 m north, 15.0 m east",
    "plan": "collect (cautious): 2 3",
    "docks": "2 · free · free · free",
    "active-now": "2 of 4",
    "cost-now": "8 m",
    **{"1": "above 95 %", "2": "charging 60 %", "3": "candidate 50 %", "4": "lost 0 %"},
}
WHY = [
    [
        ["aMussel", "place in the plan", "charge", "second battery", "unserved", "north, east", "depth m"],
        ["2", "1", "20.0 %", "", "", "5.0, 15.0", "2.50"],
        ["3", "2", "30.0 %", "", "", "5.0, 15.0", ""],
        ["4", "", "40.0 %", "", "", "5.0, 15.0", ""],
    ],
    # The plan beside its runner-up and the others, as `musselbed explain` has them.
    [
        ["", "the plan", "runner-up", "3."],
        ["aMussels", "2, 3", "2, 4", "3, 4"],
        ["cost", "1.500", "1.750", "2.000"],
        ["charge", "1.500", "1.750", "2.000"],
    ],
    True,
    True,
]
HEADING = "Measured and uploaded; dashed: the water's true value there"
ROWS: dict[str, tuple[str, str, Any]] = {
    "a time by the address": ("#t=5", "return shown()", AT_5_S),
    "a time by the scrubber": ("#t=5", DRAG + "return shown()", AT_100_S),
    "uptime so far": ("#t=5", "return said('uptime-now')", "mean 3.1 %"),  # 5 of 120 ticks for three of four
    "playing": ("", PLAY, ["30000 40000 40000 60000 120000 120000", "Play"]),
    # An empty one is hollow: not in the colour of one that only has less than it could have.
    "the map before a docking": ("#t=5", PAINTED_AS, [GREEN, AMBER, AMBER, WHITE, False, 0]),
    "the band of a belief": (
        "#t=100&aMussel=1",
        BAND,
        ["1: 95.0 %, believed 80.0 % (70.2 to 89.8)", True, True, False],
    ),
    "one that was never heard": (
        "#t=100&aMussel=4",
        "return said('one-now')",
        "4: active; primary 0.0 %, secondary 0.0 %; never heard",
    ),
    "the mean of all": (
        "#t=100",
        "return [/^mean 51\\.\\d %, least 0\\.0 %$/.test(said('charge-now')), $('one-card').hidden]",
        [True, True],
    ),
    "why a plan was made": (
        "#t=15&why=1",
        """
          return [cells("#candidates tr").map((it) => it.slice(0, 7)), cells("#options tr"),
            has("way planned 22.5 m, demand 0.90 batteries; scaled 22.5 and 0.9"), has("the runner-up costs 0.250 more")];
        """,
        WHY,
    ),
    "nobody asked why": ("#t=15", "return has('<td>')", False),
    "under the pointer": ("#t=100", POINTED, []),
    "the legend": ("#t=100", "return texts('#legend li:not([hidden])')", LEGEND),
    "a suspect": ("#t=100", SUSPECT, ["false,false", "true,true", "false,false", True]),
    "the event in sight": ("#t=100", IN_SIGHT, [["event 190", True], ["event 50", True]]),
    "packets": ("#t=25", "return texts('#packets li')", PACKETS),
    "packets so far": ("#t=19.7", "return texts('#packets li')", PACKETS[1:]),
    "packets of a listener": ("#t=25&aMussel=4", "return texts('#packets li')", PACKETS[1:]),
    "packets of nobody": ("#t=25&aMussel=2", "return texts('#packets li')", []),
    "a battery's age before it is known": ("#t=29&aMussel=1", LEARNED, [False] * 5),
    "a battery's age": ("#t=31&aMussel=1", LEARNED, [True, False, False, False, True]),
    "clicks in the address": ("#t=5", CHOOSE, "#t=10&aMussel=3&theme=contrast"),
    "clicks of somebody else": (
        "#t=10&aMussel=3&theme=contrast",
        "return [document.documentElement.dataset.theme, said('mission-clock'), said('one-now').slice(0, 9)]",
        ["contrast", "00:00:10", "3: active"],
    ),
    # WCAG 2.1, 1.4.6, of texts and of the colours that carry a meaning, against the card.
    "high contrast is 7 to 1": ("#t=5&theme=contrast", CONTRASTS, True),
    "no samples": ("", "return $('measured-card').hidden", True),
    "measured: samples": (
        "#t=45&aMussel=1",
        "return measured()",
        [
            False,
            "Measured and uploaded 2 samples of aMussel 1, the newest of 00:00:30",
            [["Oxygen, mg/l", "8.00"], ["Pressure, mbar", "1314.80"], *MEASURED],
            [[8.0, 7.5]],
        ],
    ),
    "measured: the water's truth": (
        "#t=45&aMussel=1",
        f"{WATER} select(1); return measured()",
        [
            False,
            f"{HEADING} 2 samples of aMussel 1, the newest of 00:00:30",
            [
                ["Oxygen, mg/l", "8.00, true now 8.10"],
                ["Pressure, mbar", "1314.80, true now 1314.70"],
                ["Temperature, degrees Celsius", "true now 18.00"],
                ["Turbidity, NTU", "true now 5.00"],
            ],
            [[8.0, 7.5], [8.1, None]],
        ],
    ),
    "measured: all": (
        "#t=45&aMussel=1",
        f"{WATER} return measured()",
        [
            False,
            f"{HEADING} 3 samples",
            [["Oxygen, mg/l", ""], ["Pressure, mbar", ""], *MEASURED],
            [[8.0, 7.5], [8.1, None], [2.0], [], []],
        ],
    ),
    "stopped: times in which the mission was kept from the aPad": ("", SHADES, [True, []]),
    "several: one page": (
        "#t=100",
        f"return [plan(), {APADS}]",
        ["collect (cautious): 2 3", ["apad1", "apad2"]],
    ),
    "several: the other's plan": (
        "#t=100&aPad=apad2",
        f"return [plan(), {APADS}]",
        ["collect (greedy): 2 3", ["apad1", "apad2"]],
    ),
}
"""What a script finds in the page at an address. The run is the story, or the one before the colon."""


@pytest.mark.parametrize("name", ROWS)
def test_the_page_shows(name: str, pages: Path, browser: webdriver.Chrome) -> None:
    at, script, wanted = ROWS[name]
    run = name.partition(":")[0] if ":" in name else "story"
    assert opened(browser, pages, at, run).execute_script(HELPERS + script) == wanted


def test_the_docked_one_is_painted_at_the_apad_and_a_lost_one_grey(
    pages: Path, browser: webdriver.Chrome
) -> None:
    look = f"{HELPERS} return painted()"
    found = opened(browser, pages, "#t=100").execute_script(look)
    assert (found["1"], found["3"], found["4"]) == (GREEN, AMBER, GREY)
    assert found["2"] not in (AMBER, GREEN, GREY, "123,72,200") and found["purple"] > 50


FITS = """
  const page = document.documentElement, ctx = document.createElement("canvas").getContext("2d");
  const background = getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3).map(Number);
  ctx.font = FONT;
  const beyond = ({plot}) => plot.width - (plot.bbox.left + plot.bbox.width) / uPlot.pxRatio;
  // A chart's last time stands about the end of its axis, and half of it beyond.
  const room = Math.min(...[...charts.values()].map(beyond)), half = ctx.measureText("00:00:00").width / 2;
  return [page.scrollWidth - page.clientWidth, page.clientWidth > window.innerWidth - 20,
    Math.max(...background) < 64, Math.min(...background) > 192, room >= half && half > 10];
"""


@pytest.mark.parametrize(("width", "name"), [(390, "dark"), (800, "light"), (1400, "dark")])
def test_the_page_fits_a_screen_follows_the_system_and_cuts_no_time(
    pages: Path, browser: webdriver.Chrome, width: int, name: str
) -> None:
    screen(browser, width)
    scheme(browser, name)
    fits = opened(browser, pages, "").execute_script(FITS)
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert fits == [0, True, name == "dark", name == "light", True]


FAINT_INK = f"""
  const ctx = document.createElement("canvas").getContext("2d");
  return STATUS_COLOURS.filter((it) => {{
    ctx.fillStyle = it;
    return ratio(ctx.fillStyle, inkOn(ctx)) < {LEAST_CONTRAST};
  }});
"""


@pytest.mark.parametrize("at", ["#t=5", "#t=100&aMussel=3&why=1", "#t=100&theme=contrast"])
def test_every_text_stands_out_from_the_page(pages: Path, browser: webdriver.Chrome, at: str) -> None:
    assert low_contrast(opened(browser, pages, at)) == []
    for name in ("light", "dark"):
        scheme(browser, name)
        assert browser.execute_script(HELPERS + FAINT_INK) == []
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
