"""A run of 120 aMussels over ROS, as a client of Foxglove's protocol sees it that shares no code with its server."""

from __future__ import annotations

import csv
import json
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any
from xmlrpc.client import ServerProxy

import pytest
import websocket
from patient import PATIENCE_S
from programs import MUSSELBED, begun, code_here, wait_until
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scenario_files import write_scenario

pytestmark = pytest.mark.system
IDS = range(1, 121)
LOOKS_S = 600.0
"""A viewer gives up then, however many messages come."""
TICKS = 600
NODE = "/musselbed_foxglove"
BATTERY = "/amussel{}/battery_state"
MESSAGE, TIME = 1, 2


class Viewer:
    """Keeps the channels that are offered, and hands on the messages of those that it looks at."""

    def __init__(self, url: str, looks_s: float = LOOKS_S, page: str | None = None) -> None:
        """`page` is the origin of a page in a browser; None for another program."""
        protocols = ["foxglove.sdk.v1"]
        self.link = websocket.create_connection(
            url, PATIENCE_S, subprotocols=protocols, origin=page, suppress_origin=page is None
        )
        self.channels: dict[str, dict[str, Any]] = {}
        self.refusals: list[str] = []
        self.time_ns = 0
        self._subscribed: dict[int, str] = {}
        self._until_s = time.monotonic() + looks_s

    def read(self) -> tuple[str, int, bytes] | None:
        """The next message as (topic, stamp in ns, bytes); None where something else came."""
        assert time.monotonic() < self._until_s, "what is waited for did not come"
        opcode, data = self.link.recv_data()
        if opcode == websocket.ABNF.OPCODE_TEXT:
            told = json.loads(data)
            if told["op"] == "advertise":
                self.channels |= {it["topic"]: it for it in told["channels"]}
            elif told["op"] in ("status", "serviceCallFailure"):
                self.refusals.append(told["message"])
        elif data[0] == TIME:
            (self.time_ns,) = struct.unpack_from("<Q", data, 1)
        elif data[0] == MESSAGE:
            number, at_ns = struct.unpack_from("<IQ", data, 1)
            return self._subscribed[number], at_ns, data[13:]
        return None

    def read_until(self, holds: Callable[[], object]) -> None:
        while not holds():
            self.read()

    def look_at(self, *topics: str) -> None:
        asked = []
        for topic in topics:
            number = len(self._subscribed) + 1
            self._subscribed[number] = topic
            asked.append({"id": number, "channelId": self.channels[topic]["id"]})
        self.send({"op": "subscribe", "subscriptions": asked})

    def send(self, told: dict[str, Any]) -> None:
        self.link.send(json.dumps(told))


def decoder(channel: dict[str, Any]) -> Callable[[bytes], Any]:
    """Reads messages by the definition that the server offers."""
    assert (channel["encoding"], channel["schemaEncoding"]) == ("ros1", "ros1msg")
    kind = channel["schemaName"].replace("/", "/msg/")
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(channel["schema"], kind))
    return lambda data: store.deserialize_ros1(data, kind)


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The run, and the address of its server."""
    fleet = {"count": 120, "hosting": "one_process", "start": {"charge": [0.5, 1.0]}}
    scenario = write_scenario(tmp_path / "seen.yaml", fleet=fleet)
    with begun(
        *MUSSELBED, "run", scenario, "--foxglove", 0, "--out", tmp_path / "run", stdout=None
    ) as process:
        assert process.stderr is not None
        line = next((it for it in process.stderr if "ws://" in it), "")
        yield process, line[line.find("ws://") :].strip()
    assert process.returncode == 130


def nodes_of(uri: str, role: int, topic: str | None = None) -> list[str]:
    """Our server's nodes that publish (role 0) or subscribe to (1) a topic, or to any."""
    with ServerProxy(uri) as master:
        _, _, state = master.getSystemState("/observer")  # type: ignore[misc]
    found = {name: nodes for name, nodes in state[role] if topic in (None, name)}  # type: ignore[index, union-attr]
    return [it for nodes in found.values() for it in nodes if it.startswith(NODE)]


def test_120_aMussels_are_seen_each_second_and_a_viewer_orders_nothing(
    flight: tuple[subprocess.Popen[str], str], tmp_path: Path
) -> None:
    process, url = flight
    assert url.startswith("ws://127.0.0.1:")
    viewer = Viewer(url)
    wanted = {"/clock", "/musselbed/markers", "/tf_static", *map(BATTERY.format, IDS)}
    viewer.read_until(lambda: wanted <= viewer.channels.keys())
    uri = json.loads((tmp_path / "run" / "run.json").read_text())["master_uri"]
    # Nobody looks: the flight sends it the clock and nothing else.
    assert nodes_of(uri, 1, BATTERY.format(1)) == []

    viewer.look_at(*wanted)
    came: dict[str, list[tuple[int, bytes]]] = {it: [] for it in wanted}
    decode = decoder(viewer.channels[BATTERY.format(1)])
    while min(len(came[it]) for it in ("/clock", *map(BATTERY.format, IDS))) < 5:
        if (message := viewer.read()) is not None:
            came[message[0]].append(message[1:])
    charges = {it: decode(came[BATTERY.format(it)][-1][1]).percentage for it in IDS}
    with (tmp_path / "run" / "starts.csv").open() as file:
        started = {int(row["id"]): float(row["battery"]) for row in csv.DictReader(file)}
    assert charges == pytest.approx(started, abs=0.05)
    # A tick a second, by the time of the mission, which the server tells as its own.
    ticks = [came[BATTERY.format(it)] for it in IDS]
    assert all(0.5e9 <= b - a <= 1.5e9 for each in ticks for (a, _), (b, _) in pairwise(each))
    assert viewer.time_ns == pytest.approx(came["/musselbed/markers"][-1][0], abs=3e9)
    with pytest.raises(websocket.WebSocketBadStatusException, match="403"):
        Viewer(url.partition("/?token=")[0], page="https://evil.org")
    # A later viewer, here a page that was given the address, is told of what came once, before it looked.
    later = Viewer(url, page="https://viewer.example.org")
    later.read_until(lambda: "/tf_static" in later.channels)
    later.look_at("/tf_static")
    assert next(filter(None, iter(later.read, ...)))[0] == "/tf_static"
    later.link.close()

    viewer.send(
        {"op": "advertise", "channels": [{"id": 1, "topic": "/x", "encoding": "ros1", "schemaName": "a/B"}]}
    )
    viewer.send({"op": "setParameters", "parameters": [{"name": "/x", "value": 1}]})
    viewer.link.send_binary(struct.pack("<BIII", 2, 1, 1, 4) + b"ros1")
    viewer.read_until(lambda: len(viewer.refusals) == 3)
    assert [it.startswith("Server does not support ") for it in viewer.refusals] == [True] * 3
    assert nodes_of(uri, 0) == []

    viewer.link.close()
    wait_until(lambda: nodes_of(uri, 1, BATTERY.format(1)) == [], process)


@pytest.mark.viewers
def test_no_tick_of_ten_minutes_comes_late(flight: tuple[subprocess.Popen[str], str]) -> None:
    """Each of the 120 states each of 600 ticks, in order, and before the next tick.

    By the stamps in the messages' own headers, and by the viewer's clock against its earliest message.
    """
    viewer = Viewer(flight[1], TICKS + LOOKS_S)
    topics = list(map(BATTERY.format, IDS))
    viewer.read_until(lambda: set(topics) <= viewer.channels.keys())
    viewer.look_at(*topics)
    came: dict[str, list[tuple[float, float]]] = {it: [] for it in topics}
    while min(map(len, came.values())) < TICKS:
        if (message := viewer.read()) is not None:
            topic, _, data = message
            _, seconds, nanoseconds = struct.unpack_from("<III", data)
            came[topic].append((seconds + nanoseconds / 1e9, time.monotonic()))
    viewer.link.close()
    steps_s = {round(b - a, 3) for ticks in came.values() for (a, _), (b, _) in pairwise(ticks)}
    offsets_s = sorted(at_s - stamp_s for ticks in came.values() for stamp_s, at_s in ticks)
    late_s = [it - offsets_s[0] for it in offsets_s]
    print(
        f"{len(late_s)} messages; late by {late_s[len(late_s) // 2]:.3f} s in the median, at most {late_s[-1]:.3f} s"
    )
    assert steps_s == {1.0}
    assert late_s[-1] < 1.0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("run", "pool-12", "--foxglove", 8765, "--time", "asap"), "--time asap flies without it"),
        (("run", "pool-12", "--foxglove", 65536), "0 to 65535"),
        (("foxglove", ".", "--port", 0), "no run: it has no scenario.yaml"),
        (
            ("foxglove", ".", "--host", "192.0.2.1"),
            "cannot listen on 192.0.2.1 port 8765: Cannot assign requested address",
        ),
    ],
)
def test_mistakes_are_told_in_a_line(
    words: tuple[object, ...], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_here(*words) == 2
    assert told in capsys.readouterr().err
