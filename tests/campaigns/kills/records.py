"""The records of a run, read by hand: JSON lines, bags by `rosbags`, YAML. It imports nothing of what is judged."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import ReaderError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

Line = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Charge:
    """The charge of both batteries of an aMussel at a time of its own, in batteries, and if a dock holds it."""

    agent_ms: int
    held: float
    primary: float
    docked: bool


@dataclass(slots=True)
class Records:
    lines: list[Line] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    """Files, or lines of the journal, that could not be read."""
    scenario: dict[str, Any] = field(default_factory=dict)
    summary: Line | None = None
    epoch: int = 1
    """The number of supervisors, as the run's options count them."""
    in_bags: list[Line] = field(default_factory=list)
    """The mission's events in the bags, in the form of the journal's lines."""
    bags: int = 0
    unclosed: int = 0
    """Those of them that have no index."""
    charges: dict[int, list[Charge]] = field(default_factory=dict)
    """Truths of the bags, by aMussel."""
    places: list[tuple[int, float, float]] = field(default_factory=list)
    """The aPad's places in the bags and the journal: mission ms, north and east in m, in the order of time."""
    sounds: int = 0
    """Messages of sound in the bags, one for each listener of a packet."""
    samples: list[Line] = field(default_factory=list)
    faults: list[Line] = field(default_factory=list)
    """The faults of this run, and those of other aPads' aMussels, which it may serve."""

    def of_kind(self, *kinds: str) -> list[Line]:
        return [it for it in self.lines if it["kind"] in kinds]


def records_of(run: Path) -> Records:
    """All records of a run's directory, as far as they can be read."""
    found = Records()
    found.lines = list(_json_lines(run / "journal.jsonl", found.unread))
    if (run / "samples.jsonl").exists():
        found.samples = list(_json_lines(run / "samples.jsonl", found.unread))
    found.scenario = yaml.safe_load((run / "scenario.yaml").read_text())
    options = json.loads((run / "run.json").read_text())
    found.epoch = options.get("epoch", 1)
    found.faults = found.of_kind("fault")
    for name in set(options.get("apads", ())) - {run.name}:
        theirs = _json_lines(run.with_name(name) / "journal.jsonl", [])
        found.faults += [it for it in theirs if it["kind"] == "fault" and "id" in it]
    if (run / "summary.json").exists():
        found.summary = json.loads((run / "summary.json").read_text())
    for path in sorted(run.glob("*.bag"), key=lambda it: (len(it.name), it.name)):
        found.bags += 1
        try:
            _read_bag(path, found)
        except (ReaderError, OSError, AssertionError, struct.error) as error:
            if "not indexed" in str(error):
                found.unclosed += 1
            else:
                found.unread.append(f"{path.name}: {error}")
    places = {it["t"]: (it["t"], it["north_m"], it["east_m"]) for it in found.of_kind("apad")}
    found.places = sorted((places | {it[0]: it for it in found.places}).values())
    return found


def _json_lines(path: Path, unread: list[str]) -> Iterator[Line]:
    for number, text in enumerate(path.read_bytes().splitlines(), 1):
        try:
            yield json.loads(text)
        except ValueError:
            unread.append(f"{path.name}, line {number}: {text[:80]!r}")


def _read_bag(path: Path, found: Records) -> None:
    types = get_typestore(Stores.EMPTY)
    with Reader(path) as bag:
        for it in bag.connections:
            types.register(get_types_from_msg(it.msgdef.data, it.msgtype))
        for connection, _, raw in bag.messages():
            message: Any = types.deserialize_ros1(raw, connection.msgtype)
            match connection.topic.rpartition("/")[2]:
                case "mission":
                    line = {"t": int(message.mission_time_ms), "kind": message.kind}
                    found.in_bags.append(line | json.loads(message.data))
                case "apad":
                    found.places.append((int(message.mission_time_ms), message.north, message.east))
                case "truth":
                    _keep_truths(message, found.charges)
                case "sound":
                    found.sounds += 1


def _keep_truths(message: Any, charges: dict[int, list[Charge]]) -> None:
    for it in message.agents:
        held = float(it.primary) + float(it.secondary)
        found = Charge(int(it.agent_time_ms), held, float(it.primary), bool(it.docked))
        charges.setdefault(int(it.id), []).append(found)
