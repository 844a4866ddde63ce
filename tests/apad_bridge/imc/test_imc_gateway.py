"""What a gateway sends, read by an independent codec: the packets on a socket, and its LSF log."""

from __future__ import annotations

import json
import math
import re
import shutil
import socket
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from imc_codec import Codec, header_of, name_of
from journals import lines_in

from apad_bridge.commands import main
from apad_bridge.imc import imc_messages
from apad_bridge.imc.imc_gateway import GatewaySettings, ImcGateway
from apad_bridge.imc.protocol import packed, unpacked
from apad_bridge.imc.systems import Systems
from apad_bridge.imc.wire import ImcConsole, ReceivedMessage
from apad_bridge.records.sample_file import KeptSample
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.loader import load


def apad_and_amussels(gateway: ImcGateway) -> tuple[int, int]:
    """The ids of `apad1` and of an aMussel 0. Another run on this machine, such as another test's, may have the first."""
    block, within = divmod(gateway.apad.imc_id - 0x2A00, 0x10)
    assert within == 1
    return gateway.apad.imc_id, 0x9A00 + 0x40 * block


def suffix(gateway: ImcGateway) -> str:
    return gateway.apad.name.removeprefix("apad1")


def gateway_of(
    run: Path, *console: Any, port: int | None = 0, tell: Callable[[str], None] = lambda _: None
) -> ImcGateway:
    """One for a console's address and id, which are a closed port's by default; it chooses its own port with None."""
    asked = GatewaySettings(("127.0.0.1", port), (ImcConsole(*(console or (("127.0.0.1", 9),))),))
    return ImcGateway(run, load(run / "scenario.yaml"), asked, tell)


def packets_at(console: socket.socket) -> list[bytes]:
    """All that have come."""
    console.setblocking(False)
    packets: list[bytes] = []
    with suppress(BlockingIOError):
        while True:
            packets.append(console.recv(65_535))
    return packets


def local_socket() -> socket.socket:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", 0))
    return link


def show(run_dir: Path) -> tuple[ImcGateway, list[bytes]]:
    """Shows an ended run to a console; the gateway and the packets that reached the console."""
    with local_socket() as console:
        console.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        gateway = gateway_of(run_dir, console.getsockname(), 0x4001)
        assert gateway.run(lambda: False) == "mission time"
        return gateway, packets_at(console)


@pytest.fixture(scope="module")
def shown(flown: Path) -> tuple[ImcGateway, list[bytes]]:
    return show(flown)


def by_kind(said: list[Any]) -> dict[tuple[int, str], list[Any]]:
    found: dict[tuple[int, str], list[Any]] = defaultdict(list)
    for message in said:
        found[header_of(message).src, name_of(message)].append(message)
    return found


def test_an_independent_codec_reads_every_packet_and_the_log_has_them_all(
    shown: tuple[ImcGateway, list[bytes]], codec: Codec
) -> None:
    gateway, packets = shown
    folder, sent = gateway.log_folder, b"".join(packets)
    logged = (folder / "Data.lsf").read_bytes()
    begun, *said = codec.read_log(logged)
    name = f"{folder.parent.name}/{folder.name}"
    assert (name_of(begun), begun.op, begun.name) == ("LoggingControl", 1, name)
    assert [name_of(codec.read(it)) for it in packets] == [name_of(it) for it in said[1:]]
    assert sent == logged[-len(sent) :]


def test_times_are_unix_time_also_at_theta_30(shown: tuple[ImcGateway, list[bytes]], codec: Codec) -> None:
    times_s = [header_of(codec.read(it)).timestamp for it in shown[1]]
    assert time.time() - 600 < min(times_s) and max(times_s) <= time.time()


def test_the_systems_are_announced_where_the_journal_says_that_they_are(
    flown: Path, shown: tuple[ImcGateway, list[bytes]], codec: Codec
) -> None:
    frame = LocalFrame.about(load(flown / "scenario.yaml").area.origin)
    apad, amussels = apad_and_amussels(shown[0])
    lines = [it for it in lines_in(flown / "journal.jsonl") if it["kind"] in ("belief", "apad")]
    newest = {amussels + it["id"] if it["kind"] == "belief" else apad: it for it in lines}
    docked = {amussels + it for it in newest[apad]["docks"] if it >= 0}
    said = by_kind([codec.read(it) for it in shown[1]])
    assert {src for src, _ in said} == newest.keys() and len(newest) == 7
    for src, line in newest.items():
        place = newest[apad] if src in docked else line
        (announced,), state = said[src, "Announce"], said[src, "EstimatedState"][-1]
        at_m, origin = (place["north_m"], place["east_m"]), (frame.latitude_deg, frame.longitude_deg)
        charge = line["battery"] if src == apad else line["charge"]
        volts = line["voltage_v"] if src == apad else 3.6 + 0.6 * charge
        told = [announced.lat, announced.lon, state.lat, state.lon]
        assert told == pytest.approx([*map(math.radians, (*frame.to_geographic(*at_m), *origin))], abs=1e-12)
        assert (state.x, state.y) == pytest.approx(at_m, abs=1e-4)
        battery = [said[src, it][-1].value for it in ("FuelLevel", "Voltage")]
        assert battery == [pytest.approx(100 * charge, abs=1e-4), pytest.approx(volts, abs=1e-3)]
        assert said[src, "Heartbeat"] != [] and announced.services.startswith("imc+udp://127.0.0.1:")
        if src != apad:
            assert said[src, "EntityState"][-1].description == line["state"].lower().replace("_", " ")
    assert {said[src, "Announce"][0].sys_name: said[src, "Announce"][0].sys_type for src in newest} == {
        f"apad1{suffix(shown[0])}": 3,
        **{f"amussel{n}{suffix(shown[0])}": 7 for n in range(1, 7)},
    }
    assert said[apad, "PlanControlState"][-1].state == 0  # blocked: the run has ended


def test_a_large_fleet_is_reported_by_the_apad_alone(
    flown: Path, codec: Codec, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(imc_messages, "MOST_ANNOUNCED", 5)
    gateway, packets = show(flown)
    apad, _ = apad_and_amussels(gateway)
    said = by_kind([codec.read(it) for it in packets])
    assert {src for src, _ in said} == {apad}
    assert {it.sid for it in said[apad, "ReportedState"]} == {
        f"amussel{n}{suffix(gateway)}" for n in range(1, 7)
    }
    sensor = said[apad, "RemoteSensorInfo"][-1]
    assert sensor.id == f"amussel6{suffix(gateway)}" and "fuel=" in sensor.data
    assert abs(sensor.lat - said[apad, "Announce"][0].lat) < 1e-5


def test_samples_are_told_in_the_units_of_imc(codec: Codec) -> None:
    sample = {
        "id": 3,
        "oxygen_mg_l": 8.0,
        "turbidity_ntu": 5.0,
        "temperature_c": 18.5,
        "pressure_mbar": 1313.0,
        "saturated": ["turbidity"],
    }
    told = imc_messages.of_sample(KeptSample(3, 0, sample))
    stamped = [imc_messages.stamped(it, Systems().amussel(3), 1e9) for it in told]
    assert {name_of(it): it.value for it in map(codec.read, map(packed, stamped))} == {
        "DissolvedOxygen": 250.0,
        "Temperature": 18.5,
        "Pressure": 1313.0,
    }


@pytest.mark.parametrize("place", [(math.nan, 0.0), (0.0, math.inf)])
def test_a_place_that_is_no_number_is_never_told(place: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="no place"):
        imc_messages.place_rad(LocalFrame(43.9, 15.4), *place)


def test_the_command_serves_an_ended_run_once_and_says_why_it_ended(
    flown: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["imc", str(flown), "--port", "0", "--neptus", "127.0.0.1:9", "--json"]) == 0
    begun, *_, ended = map(json.loads, capsys.readouterr().out.splitlines())
    assert Path(begun["log"]).is_relative_to(flown / "imc") and ended == {"ended_by": "mission time"}


ROOT = Path(__file__).parents[3]
POOL = ROOT / "launch_scripts/scenarios/pool-12.yaml"
RUN = ["run", str(POOL), "--time", "asap", "--out", "OUT"]


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["imc", "FLOWN", "--neptus", "nonsense"], r"a console is \[ID@\]HOST:PORT"),
        (["imc", "FLOWN", "--neptus", "0x1ffff@127.0.0.1:6001"], "an IMC id 0 to 0xfffe"),
        (["imc", "FLOWN", "--host", "0.0.0.0"], "name the address of one interface"),
        (["imc", "FLOWN", "--host", "224.0.75.69"], "name the address of one interface"),
        (["imc", "FLOWN", "--port", "70000"], "--port must be 0 to 65535"),
        (["imc", "FLOWN", "--host", "203.0.113.1"], "cannot listen on"),
        (["imc", "EMPTY"], "no run: it has no scenario.yaml"),
        ([*RUN, "--neptus", "0x4001@127.0.0.1:6001"], "need --imc"),
        ([*RUN, "--imc-port", "6002"], "need --imc"),
        ([*RUN, "--imc-multicast"], "need --imc"),
        (["run", "TWO", "--time", "asap", "--imc", "--out", "OUT"], "--imc shows one aPad"),
    ],
)
def test_a_mistake_is_one_line_and_begins_no_run(
    flown: Path, tmp_path: Path, arguments: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    data = yaml.safe_load(POOL.read_text())
    data["fleet"]["start"] = {"charge": [0.5, 0.75]}
    data["apads"] = [{"name": "apad2", "start_m": [5, 5]}]
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(data))
    paths = {"FLOWN": flown, "EMPTY": tmp_path, "TWO": tmp_path / "two.yaml", "OUT": tmp_path / "run"}
    assert main.main([str(paths.get(it, it)) for it in arguments]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and re.search(why, told) and not paths["OUT"].exists()


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
    with local_socket() as console, local_socket() as stranger:
        gateway = gateway_of(flown, console.getsockname())
        apad, amussels = apad_and_amussels(gateway)
        for link, asked in (
            (console, apad),
            (console, amussels + 3),
            (console, amussels + 7),
            (stranger, amussels + 4),
        ):
            link.sendto(codec.pack(codec.make("EntityList", op=1), 0x4001, asked), gateway.address)
        # The run has ended, and the gateway with it: what it hears is given to it by hand.
        for _ in range(4):
            for received in gateway._wire.receive(1.0):
                gateway._take(received)
        for part in (gateway._wire, gateway._log, gateway._number):
            part.close()
        read = [codec.read(it) for it in packets_at(console)]
    answers = [(header_of(it).src, header_of(it).dst, it.list) for it in read if name_of(it) == "EntityList"]
    assert answers == [(apad, 0x4001, imc_messages.ENTITIES), (amussels + 3, 0x4001, imc_messages.ENTITIES)]


@pytest.fixture
def copy_of_run(flown: Path, tmp_path: Path) -> Callable[[str], Path]:
    return lambda name: Path(shutil.copytree(flown, tmp_path / name, ignore=shutil.ignore_patterns("imc")))


def rewrite(file: Path, block: str, **changes: Any) -> None:
    """Changes keys of a block of a scenario's file."""
    scenario = yaml.safe_load(file.read_text())
    scenario[block] |= changes
    file.write_text(yaml.safe_dump(scenario))


@contextmanager
def opened(run: Path) -> Iterator[ImcGateway]:
    """A gateway at the port that it chooses by itself."""
    gateway = gateway_of(run, port=None, tell=pytest.fail)
    try:
        yield gateway
    finally:
        gateway.run(lambda: True)


def announced_by(run: Path, codec: Codec, tell: Callable[[str], None] = pytest.fail) -> dict[str, int]:
    """The ids by name of the systems that a gateway of the run announces from its beginning to its end."""
    gateway = gateway_of(run, port=None, tell=tell)
    gateway.run(lambda: False)
    said = codec.read_log((gateway.log_folder / "Data.lsf").read_bytes())
    return {it.sys_name: header_of(it).src for it in said if name_of(it) == "Announce"}


def test_runs_that_a_machine_shows_at_once_share_no_id_name_or_port(
    copy_of_run: Callable[[str], Path], codec: Codec
) -> None:
    with opened(copy_of_run("a")) as first, opened(copy_of_run("b")) as second:
        third = announced_by(copy_of_run("c"), codec)
        systems = [first.systems, second.systems, {number: name for name, number in third.items()}]
        ids, names = ({it for one in systems for it in part(one)} for part in (dict.keys, dict.values))
        assert ([len(it) for it in systems], len(ids), len(names)) == ([7, 7, 7], 21, 21)
        assert first.address != second.address


def test_a_run_that_is_shown_again_has_the_systems_that_it_had(
    copy_of_run: Callable[[str], Path], codec: Codec
) -> None:
    with opened(copy_of_run("a")):
        second = copy_of_run("b")
        had = announced_by(second, codec)
    assert announced_by(second, codec) == had  # the lower ids are free by now, and not taken


def test_a_run_whose_systems_another_run_has_by_now_takes_others_and_says_so(
    copy_of_run: Callable[[str], Path], codec: Codec
) -> None:
    first, second, told = copy_of_run("a"), copy_of_run("b"), list[str]()
    had = announced_by(first, codec)
    (second / "imc").mkdir()
    shutil.copy(first / "imc" / "number", second / "imc" / "number")
    with opened(second):
        now = announced_by(first, codec, told.append)
    assert not set(now.values()) & set(had.values()) and not set(now) & set(had)
    assert told == ["another run has the IMC ids and names that this run had: it has others now"]


def test_gateways_of_one_run_of_several_apads_share_its_ids(copy_of_run: Callable[[str], Path]) -> None:
    whole = copy_of_run("whole")
    for name in ("apad1", "apad2"):
        shutil.copytree(whole, whole / name, ignore=shutil.ignore_patterns("imc", "apad*"))
        rewrite(whole / name / "scenario.yaml", "apad", name=name)
    with opened(whole / "apad1") as first, opened(whole / "apad2") as second:
        numbers = [(it.apad.imc_id, it.address[1]) for it in (first, second)]
        assert numbers[1] == tuple(it + 1 for it in numbers[0])
        assert apad_and_amussels(first)[1] == second.apad.imc_id // 0x10 * 0x40 - 0x2A0 * 0x40 + 0x9A00


def test_no_ids_left_is_one_line(
    copy_of_run: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    large = copy_of_run("large")
    rewrite(large / "scenario.yaml", "fleet", first_id=1500)
    with opened(copy_of_run("a")):
        assert main.main(["imc", str(large)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    clock_s=st.lists(st.floats(1e9, 2e9), min_size=1, max_size=20),
    consoles_s=st.lists(st.floats(1e9, 2e9), max_size=5),
)
def test_a_log_never_goes_back_in_time(
    flown: Path, codec: Codec, clock_s: list[float], consoles_s: list[float]
) -> None:
    """Whatever the clock of a console, and wherever this machine's clock is set while the gateway serves."""
    readings = iter(clock_s)
    with pytest.MonkeyPatch.context() as patch, local_socket() as console:
        gateway = gateway_of(flown, console.getsockname(), 0x4001)
        patch.setattr(time, "time", lambda: next(readings, clock_s[-1]))
        for sent_s in consoles_s:
            store = codec.make("PlanDB", op=6)
            message = unpacked(codec.pack(store, 0x4001, gateway.apad.imc_id))
            message.timestamp = sent_s
            gateway._take(ReceivedMessage(message, console.getsockname(), by_multicast=False))
            gateway._send(gateway.apad, [imc_messages.entity_list()])
        gateway.run(lambda: True)
    said = codec.read_log((gateway.log_folder / "Data.lsf").read_bytes())
    times_s = [header_of(it).timestamp for it in said]
    assert times_s == sorted(times_s)
    assert sum(header_of(it).src == 0x4001 for it in said) == len(set(consoles_s))
