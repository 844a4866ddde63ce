"""What a gateway sends, read by an independent codec: the packets on a socket, and its LSF log."""

from __future__ import annotations

import json
import math
import re
import socket
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
import yaml
from imc_codec import Codec, header_of, name_of

from apad_bridge.commands import main
from apad_bridge.imc import messages
from apad_bridge.imc.gateway import GatewaySettings, ImcGateway
from apad_bridge.imc.protocol import packed
from apad_bridge.imc.systems import amussel_system
from apad_bridge.imc.wire import Console
from apad_bridge.records.journal import read_journal
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.loader import load

APAD = 0x2A01


def show(run_dir: Path) -> tuple[ImcGateway, list[bytes]]:
    """Shows an ended run to a console; the gateway and the packets that reached the console."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as console:
        console.bind(("127.0.0.1", 0))
        console.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        settings = GatewaySettings(("127.0.0.1", 0), (Console(console.getsockname(), 0x4001),))
        gateway = ImcGateway(run_dir, load(run_dir / "scenario.yaml"), settings, pytest.fail)
        assert gateway.run(lambda: False) == "mission time"
        packets = []
        console.setblocking(False)
        while True:
            try:
                packets.append(console.recv(65_535))
            except BlockingIOError:
                return gateway, packets


@pytest.fixture(scope="module")
def shown(flown: Path) -> tuple[Path, list[bytes]]:
    gateway, packets = show(flown)
    return gateway.log_folder / "Data.lsf", packets


def by_kind(said: list[Any]) -> dict[tuple[int, str], list[Any]]:
    found: dict[tuple[int, str], list[Any]] = defaultdict(list)
    for message in said:
        found[header_of(message).src, name_of(message)].append(message)
    return found


def test_an_independent_codec_reads_every_packet_and_the_log_has_them_all(
    shown: tuple[Path, list[bytes]], codec: Codec
) -> None:
    log, packets = shown
    logged = log.read_bytes()
    said = codec.read_log(logged)
    assert name_of(said[0]) == "LoggingControl" and said[0].op == 1
    assert said[0].name == f"{log.parent.parent.name}/{log.parent.name}"
    assert [name_of(codec.read(it)) for it in packets] == [name_of(it) for it in said[2:]]
    assert b"".join(packets) == logged[-len(b"".join(packets)) :]


def test_times_are_unix_time_also_at_theta_30(shown: tuple[Path, list[bytes]], codec: Codec) -> None:
    now_s = time.time()
    for packet in shown[1]:
        assert now_s - 600 < header_of(codec.read(packet)).timestamp <= now_s


def test_the_systems_are_announced_where_the_journal_says_that_they_are(
    flown: Path, shown: tuple[Path, list[bytes]], codec: Codec
) -> None:
    frame = LocalFrame.about(load(flown / "scenario.yaml").area.origin)
    newest: dict[int, dict[str, Any]] = {}
    for line in read_journal(flown / "journal.jsonl").lines:
        if line["kind"] == "belief":
            newest[0x9A00 + line["id"]] = line
        elif line["kind"] == "apad":
            newest[APAD] = line
            docked = {0x9A00 + it for it in line["docks"] if it >= 0}
    said = by_kind([codec.read(it) for it in shown[1]])
    assert {src for src, _ in said} == newest.keys() and len(newest) == 7
    for src, line in newest.items():
        place = newest[APAD] if src in docked else line
        (announced,), state = said[src, "Announce"], said[src, "EstimatedState"][-1]
        latitude, longitude = map(math.radians, frame.to_geographic(place["north_m"], place["east_m"]))
        assert (announced.lat, announced.lon) == pytest.approx((latitude, longitude), abs=1e-12)
        assert (state.lat, state.lon) == pytest.approx(
            (math.radians(frame.latitude_deg), math.radians(frame.longitude_deg)), abs=1e-15
        )
        assert (state.x, state.y) == pytest.approx((place["north_m"], place["east_m"]), abs=1e-4)
        charge = line["battery"] if src == APAD else line["charge"]
        assert said[src, "FuelLevel"][-1].value == pytest.approx(100 * charge, abs=1e-4)
        volts = line["voltage_v"] if src == APAD else 3.6 + 0.6 * charge
        assert said[src, "Voltage"][-1].value == pytest.approx(volts, abs=1e-3)
        assert said[src, "Heartbeat"] != []
        assert announced.services.startswith("imc+udp://127.0.0.1:")
    names = {said[src, "Announce"][0].sys_name: said[src, "Announce"][0].sys_type for src in newest}
    assert names == {"apad1": 3, **{f"amussel{n}": 7 for n in range(1, 7)}}
    for src, line in newest.items():
        if src != APAD:
            assert said[src, "EntityState"][-1].description == line["state"].lower().replace("_", " ")
    assert said[APAD, "PlanControlState"][-1].state == 0  # blocked: the run has ended


def test_a_large_fleet_is_reported_by_the_apad_alone(
    flown: Path, codec: Codec, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(messages, "MOST_ANNOUNCED", 5)
    _, packets = show(flown)
    said = by_kind([codec.read(it) for it in packets])
    assert {src for src, _ in said} == {APAD}
    assert {it.sid for it in said[APAD, "ReportedState"]} == {f"amussel{n}" for n in range(1, 7)}
    sensor = said[APAD, "RemoteSensorInfo"][-1]
    assert sensor.id == "amussel6" and "fuel=" in sensor.data
    assert abs(sensor.lat - said[APAD, "Announce"][0].lat) < 1e-5


def test_samples_are_told_in_the_units_of_imc(codec: Codec) -> None:
    sample = {
        "id": 3,
        "oxygen_mg_l": 8.0,
        "turbidity_ntu": 5.0,
        "temperature_c": 18.5,
        "pressure_mbar": 1313.0,
        "saturated": ["turbidity"],
    }
    read = {}
    for message in messages.of_sample(sample):
        stamped = messages.stamped(message, amussel_system(3), 1e9)
        got = codec.read(packed(stamped))
        read[name_of(got)] = got.value
    assert read == {
        "DissolvedOxygen": 250.0,
        "Temperature": 18.5,
        "Pressure": 1313.0,
    }


@pytest.mark.parametrize("place", [(math.nan, 0.0), (0.0, math.inf)])
def test_a_place_that_is_no_number_is_never_told(place: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="no place"):
        messages.place_rad(LocalFrame(43.9, 15.4), *place)


def test_the_command_serves_an_ended_run_once_and_says_why_it_ended(
    flown: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["imc", str(flown), "--port", "0", "--neptus", "127.0.0.1:9", "--json"]) == 0
    begun, *_, ended = map(json.loads, capsys.readouterr().out.splitlines())
    assert Path(begun["log"]).is_relative_to(flown / "imc") and ended == {"ended_by": "mission time"}


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--neptus", "nonsense"], r"a console is \[ID@\]HOST:PORT"),
        (["--neptus", "0x1ffff@127.0.0.1:6001"], "an IMC id 0 to 0xfffe"),
        (["--host", "0.0.0.0"], "name the address of one interface"),
        (["--host", "224.0.75.69"], "name the address of one interface"),
        (["--port", "70000"], "--port must be 0 to 65535"),
        (["--host", "203.0.113.1"], "cannot listen on"),
    ],
)
def test_a_mistake_is_one_line(
    flown: Path, arguments: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["imc", str(flown), *arguments]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert re.search(why, told)


def test_what_is_no_run_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["imc", str(tmp_path)]) == 2
    assert "no run: there is no scenario.yaml in it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--neptus", "0x4001@127.0.0.1:6001"], "need --imc"),
        (["--imc-port", "6002"], "need --imc"),
        (["--imc-multicast"], "need --imc"),
    ],
)
def test_a_run_without_a_gateway_takes_none_of_its_options(
    arguments: list[str], why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = Path(__file__).parents[3] / "launch_scripts/scenarios/pool-12.yaml"
    out = tmp_path / "run"
    assert main.main(["run", str(scenario), "--time", "asap", "--out", str(out), *arguments]) == 2
    assert why in capsys.readouterr().err and not out.exists()


def test_a_gateway_beside_a_run_shows_one_apad_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = Path(__file__).parents[3]
    data = yaml.safe_load((root / "launch_scripts/scenarios/pool-12.yaml").read_text())
    data["fleet"]["start"] = {"charge": [0.5, 0.75]}
    data["apads"] = [{"name": "apad2", "start_m": [5, 5]}]
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(data))
    out = tmp_path / "run"
    asked = ["run", str(tmp_path / "two.yaml"), "--time", "asap", "--imc", "--out", str(out)]
    assert main.main(asked) == 2
    assert "--imc shows one aPad" in capsys.readouterr().err and not out.exists()


def test_a_run_in_virtual_time_has_its_log(tmp_path: Path, flown: Path, codec: Codec) -> None:
    """The gateway starts before the flight, and ends with it."""
    out = tmp_path / "run"
    asked = ["run", str(flown.parent / "imc.yaml"), "--time", "asap", "--imc", "--imc-port", "0"]
    assert main.main([*asked, "--neptus", "127.0.0.1:9", "--out", str(out), "--json"]) == 0
    (log,) = out.glob("imc/*/*/Data.lsf")
    said = codec.read_log(log.read_bytes())
    assert {name_of(it) for it in said} >= {"LoggingControl", "Announce", "EstimatedState", "FuelLevel"}
    assert (out / "imc.log").read_text() == ""


def test_each_shown_system_answers_for_its_entities_to_the_console_that_asked(
    flown: Path, codec: Codec
) -> None:
    """Neptus asks every system that it sees, by its own id, and again at each Announce until it is answered."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as console,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        for link in (console, stranger):
            link.bind(("127.0.0.1", 0))
        settings = GatewaySettings(("127.0.0.1", 0), (Console(console.getsockname()),))
        gateway = ImcGateway(flown, load(flown / "scenario.yaml"), settings, pytest.fail)
        for link, asked in ((console, APAD), (console, 0x9A03), (console, 0x9A63), (stranger, 0x9A04)):
            query = codec.make("EntityList", op=1)
            link.sendto(codec.pack(query, 0x4001, asked), gateway.address)
        # The run has ended, and the gateway with it: what it hears is given to it by hand.
        for _ in range(4):
            for received in gateway._wire.receive(1.0):
                gateway._take(received)
        gateway._wire.close()
        gateway._log.close()
        console.setblocking(False)
        answers = []
        while True:
            try:
                message = codec.read(console.recv(65_535))
            except BlockingIOError:
                break
            if name_of(message) == "EntityList":
                answers.append((header_of(message).src, header_of(message).dst, message.list))
    assert answers == [(APAD, 0x4001, messages.ENTITIES), (0x9A03, 0x4001, messages.ENTITIES)]
