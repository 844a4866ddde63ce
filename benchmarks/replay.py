"""The replay page: its size, the time to its first paint, and the time of a frame, with 24 and 120 aMussels.

The page of 24 aMussels is that of a flight of 40 minutes at theta 30, which are 20 hours of theirs. A page has at most
60 000 samples, 5000 points of a track and 20 000 packets however long the run is; so the page of 120 aMussels over 10 days
is made of the first one's data at those limits. Frames are those of the whole run played in some seconds: the page's own
work with its layout, without the browser's painting.

The floor is a page whose frame clears a canvas of the map's size, draws a line and sets a text, played in turn with the
other. Its p95 is what this machine and its other work add to any frame. `fps` counts the frames that the browser showed, by
its software's painting.
"""

from __future__ import annotations

import copy
import io
import json
import tempfile
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import yaml
from browsers import chromium
from rich.console import Console
from rich.table import Table

from apad_bridge.analysis.replay.build import build_replay, render
from apad_bridge.analysis.replay.series import COLUMNS, MAX_PACKETS, MAX_TRACE, MAX_VALUES
from apad_bridge.commands.main import main
from benchmarks.rows import told

SCENARIO = Path(__file__).parents[1] / "launch_scripts" / "scenarios" / "bay-24.yaml"
COPIES = 5
DAYS = 10
TRIES = 5
PLAYED_S, SHORT_PLAYED_S = 8, 2
CLOCK_MS = 0.1
"""The step of the browser's clock."""
KEYS = (
    "agents",
    "hours",
    "shell_kb",
    "data_mb",
    "first_paint_ms",
    "ready_ms",
    "frame_ms_p50",
    "frame_ms_p95",
    "floor_ms_p95",
    "ratio",
    "fps",
    "floor_fps",
)
FLOOR = """<!DOCTYPE html><canvas id="map" width="640" height="640"></canvas><b id="clock"></b><script>
let playing = null, nowMs = 0, endMs = 72e6;
const ctx = document.getElementById("map").getContext("2d");
function show(ms) {
  nowMs = Math.min(endMs, ms);
  ctx.clearRect(0, 0, 640, 640);
  ctx.fillRect(640 * nowMs / endMs, 0, 1, 640);
  document.getElementById("clock").textContent = nowMs;
}
function play() { playing = { since: performance.now(), speed: 1 }; requestAnimationFrame(frame); }
function frame() {
  show((performance.now() - playing.since) * playing.speed);
  if (nowMs >= endMs) playing = null; else requestAnimationFrame(frame);
}
</script>"""
_PLAYED = """
const [seconds, done] = arguments, took = [], shown = window.show;
window.show = (ms) => {
  const began = performance.now();
  shown(ms);
  document.body.offsetHeight;
  took.push(performance.now() - began);
};
show(0);
play(true);
playing.speed = endMs / 1000 / seconds;
const look = () => (playing ? setTimeout(look, 100) : done(took.slice(1)));
look();
"""
_PAINTED = """
const paint = performance.getEntriesByName("first-contentful-paint")[0];
const load = performance.getEntriesByType("navigation")[0];
return [paint ? paint.startTime : null, load.loadEventEnd];
"""


def measure(tries: int = TRIES, short: bool = False) -> dict[str, Any]:
    tries, played_s = (1, SHORT_PLAYED_S) if short else (tries, PLAYED_S)
    with tempfile.TemporaryDirectory(prefix="musselbed-") as home:
        folder = Path(home)
        data = _flown(folder)
        pages = ((data, 20.0), (_widened(data), 24.0 * DAYS))
        rows = [told(_row(folder, [it], hours, tries, played_s)) for it, hours in pages]
    first = rows[0]
    return {"rows": rows, **{key: first[key] for key in KEYS[2:]}, "frame_ms": first["frame_ms_p95"]}


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title="The replay page")
    for key in KEYS:
        table.add_column(key.replace("_", " "), justify="right")
    for row in result["rows"]:
        table.add_row(*(f"{row[key]:.4g}" for key in KEYS))
    console.print(table)


def _flown(folder: Path) -> dict[str, Any]:
    scenario = yaml.safe_load(SCENARIO.read_text())
    scenario["fleet"]["start"] = str(SCENARIO.parent / scenario["fleet"]["start"])
    path = folder / "flown.yaml"
    path.write_text(yaml.safe_dump(scenario))
    words = ["run", str(path), "--time", "asap", "--hosting", "one_process", "--out", str(folder / "run")]
    with redirect_stdout(io.StringIO()):
        assert main([*words, "--json"]) == 0
    page = build_replay(folder / "run").read_text()
    begin = page.index('id="data">') + len('id="data">')
    (data,) = json.loads(page[begin : page.index("</script>", begin)])
    assert isinstance(data, dict)
    return data


def _widened(data: dict[str, Any]) -> dict[str, Any]:
    """Five times the aMussels, at the limits of a page, over ten days of mission time."""
    wide = copy.deepcopy(data)
    count = COPIES * len(data["agents"])
    samples = MAX_VALUES // count
    picks = [len(data["times_ms"]) * n // samples for n in range(samples)]
    end_ms = DAYS * 86_400_000
    wide["times_ms"] = [end_ms * n // (samples - 1) for n in range(samples)]
    for name in ("active", "cost", "apad", "docks", "stage"):
        wide[name] = [data[name][n] for n in picks]
    wide["agents"], wide["homes"] = [], {}
    for part in range(COPIES):
        for agent in data["agents"]:
            agent_id = agent["id"] + part * len(data["agents"])
            columns = {
                name: None if agent[name] is None else [agent[name][n] for n in picks] for name in COLUMNS
            }
            columns["north"] = [None if it is None else it + 60 * part for it in columns["north"] or ()]
            wide["agents"].append({"id": agent_id, **columns})
            north_m, east_m = data["homes"][str(agent["id"])]
            wide["homes"][str(agent_id)] = [north_m + 60 * part, east_m]
    track = data["trace"]
    wide["trace"] = [
        [end_ms * n // MAX_TRACE, *track[n * len(track) // MAX_TRACE][1:]] for n in range(MAX_TRACE)
    ]
    wide["packets"] = [
        [end_ms * n // MAX_PACKETS, 868, n % count + 1, "unicast", 255, None, [[0, "received"]], 0]
        for n in range(MAX_PACKETS)
    ]
    return wide


def _row(folder: Path, runs: list[dict[str, Any]], hours: float, tries: int, played_s: int) -> dict[str, Any]:
    page, floor = folder / "page.html", folder / "floor.html"
    page.write_text(render(runs))
    floor.write_text(FLOOR)
    data_bytes = len(json.dumps(runs, separators=(",", ":")).encode())
    painted, ready, frames, least = [], [], [], []
    for _ in range(tries):
        with chromium() as browser:
            browser.get(page.as_uri())
            paint_ms, ready_ms = browser.execute_async_script(
                "const done = arguments[0]; requestAnimationFrame(() => setTimeout(() => done((() => {"
                + _PAINTED
                + "})()), 100));"
            )
            painted.append(paint_ms or ready_ms)
            ready.append(ready_ms)
            frames += browser.execute_async_script(_PLAYED, played_s)
            browser.get(floor.as_uri())
            least += browser.execute_async_script(_PLAYED, played_s)
    frames.sort()
    least.sort()
    frame_ms, floor_ms = frames[int(0.95 * len(frames))], least[int(0.95 * len(least))]
    return {
        "agents": len(runs[0]["agents"]),
        "hours": hours,
        "shell_kb": (page.stat().st_size - data_bytes) / 1e3,
        "data_mb": data_bytes / 1e6,
        "first_paint_ms": sorted(painted)[len(painted) // 2],
        "ready_ms": sorted(ready)[len(ready) // 2],
        "frame_ms_p50": frames[len(frames) // 2],
        "frame_ms_p95": frame_ms,
        "floor_ms_p95": floor_ms,
        "ratio": frame_ms / max(floor_ms, CLOCK_MS),
        "fps": len(frames) / (tries * played_s),
        "floor_fps": len(least) / (tries * played_s),
    }
