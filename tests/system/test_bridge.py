"""Real aMussels at one modem, and a mission on ROS at the other: two modems on a table, with ptys for their cables."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import serial
from doc_blocks import install_template
from programs import MUSSELBED, ROOT, Begin, code_here, line_of, lines_of, wait_until
from scenario_files import SOUND_FILE, write_scenario

from apad_bridge.acoustics.serial.table_modems import TableModems
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.modem import check_modem
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.ros.system.master import Master
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.starts import starts_of
from firmware_model.packets import CommandPacket, Kind, StatusPacket
from firmware_model.states import State

pytestmark = pytest.mark.system
POOL_FILE = ROOT / "launch_scripts" / "scenarios" / "pool-12.yaml"
PATIENCE_S = 120.0

# Built by hand from docs/packets.md: version 1, kind 1, id 7, sequence 0, FLOATING, half, full, 12.5 m, 3 m, 0 m, 60 s.
STATUS = bytes.fromhex(
    "01010700000004 0080 ffff e2040000 2c010000 0000 60ea000000000000 9ce3".replace(" ", "")
)


def until(process: subprocess.Popen[str], holds: Callable[[Any], bool]) -> Any:
    """The first of its lines, which are JSON, for which it holds."""
    while not holds(found := json.loads(line_of(process))):
        pass
    return found


@pytest.fixture
def modems(tmp_path: Path) -> Iterator[TableModems]:
    with closing(TableModems(tmp_path / "dev", 2, 1)) as made:
        yield made


class StrangersModems:
    """Modems with the addresses 1 and 2, 60 m apart, by an author who knew the published facts alone."""

    def __init__(self, folder: Path, begin: Begin) -> None:
        program = ROOT / "tests" / "counterparts" / "nanomodem" / "nanomodem.py"
        self._folder = folder
        folder.mkdir()
        assert line_of(begin(sys.executable, program, folder, "1:0:0:3", "2:60:0:3")).strip() == "ready"

    def path(self, address: int) -> str:
        return str(self._folder / f"modem{address}")


def broadcast(modem: serial.Serial, payload: bytes) -> None:
    modem.write(b"$B%02d" % len(payload) + payload)
    assert modem.read_until(b"\r\n") == b"$B%02d\r\n" % len(payload)


def test_a_strangers_modems_answer_with_their_distance(tmp_path: Path, begin: Begin) -> None:
    status, echo = check_modem(Path(StrangersModems(tmp_path / "theirs", begin).path(1)), 2)
    assert (status.status, echo.status) == (CheckStatus.OK, CheckStatus.OK) and "address 1" in status.found
    metres = re.search(r"address 2 answers, ([0-9.]+) m away", echo.found)
    assert metres is not None and float(metres[1]) == pytest.approx(60, abs=1)


@pytest.mark.parametrize(("by_run", "whose"), [(True, "ours"), (False, "a stranger's")])
def test_a_real_amussels_packets_reach_the_mission_and_the_missions_reach_it(
    tmp_path: Path,
    shell: dict[str, str],
    request: pytest.FixtureRequest,
    begin: Begin,
    by_run: bool,
    whose: str,
) -> None:
    modems: TableModems | StrangersModems = (
        request.getfixturevalue("modems") if whose == "ours" else StrangersModems(tmp_path / "theirs", begin)
    )
    inside = shell | {"PYTHONPATH": str(ROOT)}
    named, its_shell = POOL_FILE, inside
    if by_run:
        # The run's directory names the master, and the shell does not.
        named = tmp_path / "run"
        directory = RunDirectory.create("pool", datetime.now(UTC), named)
        scenario = load(POOL_FILE)
        directory.write_inputs(scenario, starts_of(scenario))
        options = RunOptions(BenchPart.WHOLE, APadKind.SIM, TimeSource.WALL, 1.0, OnDeath.WAIT)
        replace(options, master_uri=inside["ROS_MASTER_URI"], owns_master=True).save(directory.path)
        its_shell = {key: it for key, it in inside.items() if key != "ROS_MASTER_URI"}
    mission = begin(
        sys.executable, Path(__file__).with_name("beside_a_bridge.py"), env=inside, stdin=subprocess.PIPE
    )
    until(mission, lambda it: it == ["ready"])
    words = ("bridge", named, modems.path(1), "--ids", 7, 8, "--json")
    bridge = begin(*MUSSELBED, *words, env=its_shell, ends_by=signal.SIGKILL)
    claim = until(mission, lambda it: it[0] == "claim")
    assert claim == ["claim", "/musselbed_bridge_7", True, [7, 8]]
    until(bridge, lambda it: "modem" in it)

    node = serial.Serial(modems.path(2), 9600, timeout=PATIENCE_S)
    # What must be dropped comes first: nothing of it may be heard before the good packet.
    broadcast(node, b"\xb1\x07\x00" + STATUS[:-1] + b"\x00")  # its check is wrong
    until(bridge, lambda it: "damaged" in it.get("dropped", ""))
    broadcast(node, b"\xb1\x08\x00" + STATUS)
    until(bridge, lambda it: "names another aMussel" in it.get("dropped", ""))
    broadcast(node, b"\xb1\x09\x00" + STATUS)
    until(bridge, lambda it: "none of --ids" in it.get("dropped", ""))
    broadcast(node, b"hello")
    until(bridge, lambda it: "without an aMussel's id" in it.get("dropped", ""))
    broadcast(node, b"\xb1\x07\x00" + STATUS)
    *packet, mission_time_ms, late_s = until(mission, lambda it: it[0] == "heard")
    assert packet == ["heard", 7, "sound", STATUS.hex()]
    # A bridge that is started anew would else say that its packets are older than those before.
    assert mission_time_ms == 0 and abs(late_s) < PATIENCE_S

    permission = CommandPacket(Kind.PERMISSION, 7).encode()
    assert mission.stdin is not None
    mission.stdin.write(json.dumps([7, "sound", permission.hex()]) + "\n")
    mission.stdin.flush()
    size = 3 + len(permission)
    printed = node.read_until(b"\xb2\x07\x00" + permission)
    assert printed.endswith(b"#B001%02d\xb2\x07\x00" % size + permission)

    bridge.send_signal(signal.SIGINT)
    counts = until(bridge, lambda it: "counts" in it)["counts"]
    assert bridge.wait(PATIENCE_S) == 130
    node.close()
    assert counts["heard from aMussels"] == 1


def test_a_real_node_that_sends_nothing_is_ranged_by_a_strangers_modem(tmp_path: Path, begin: Begin) -> None:
    """Modem 2 is aMussel 2's, at 60 m, which is more than the pool."""
    modems = StrangersModems(tmp_path / "theirs", begin)
    scenario = write_scenario(
        tmp_path / "bowl.yaml",
        SOUND_FILE,
        theta=1,
        fleet={"count": 3, "start": {"charge": [0.9, 0.9]}},
        water={"sound": {"sound_speed_m_s": 1500.0}, "talk": {"ping_period_s": 2, "waits": False}},
    )
    run = tmp_path / "run"
    flight = begin(*MUSSELBED, "run", scenario, "--speed", 1, "--out", run, "--json")
    wait_until((run / "journal.jsonl").exists, flight)
    bridge = begin(*MUSSELBED, "bridge", run, modems.path(1), "--ids", 2, "--json", ends_by=signal.SIGKILL)

    def ranges(*ids: int) -> set[float | None]:
        return {it["range_m"] for it in lines_of(run, "range") if it["id"] in ids}

    wait_until(lambda: ranges(2) - {None} and ranges(1, 3), flight, bridge)
    assert all(it == pytest.approx(60, abs=1) for it in ranges(2) if it is not None)
    assert all(it is None or it < 30 for it in ranges(1, 3))
    bridge.send_signal(signal.SIGINT)
    counts = until(bridge, lambda it: "counts" in it)["counts"]
    assert counts["ranges to aMussels"] >= 1 and "heard from aMussels" not in counts


LINE = b"$STATUS,7,0,FLOATING,0.50000,1.00000,12.50,3.00,0.00,60000*"
"""The same status in the template's codec, without its check."""
PERMISSION = b"$COMMAND,PERMISSION,7*"


@pytest.mark.parametrize("way", ["modem", "wifi", "topic"])
def test_nodes_with_bytes_of_their_own_are_heard_and_told_in_their_own_words(
    way: str, modems: TableModems, shell: dict[str, str], tmp_path: Path, begin: Begin
) -> None:
    """The mission speaks the built-in codec, and the node the template's: the bridge translates both ways."""
    install_template(tmp_path, "codec")
    first = '        if not data.startswith(b"$"):\n'
    raising = f'        if data == b"raise":\n            raise RuntimeError("no such\\nline")\n{first}'
    codec = tmp_path / "lab_codec.py"
    codec.write_text(codec.read_text().replace(first, raising))
    inside = shell | {"PYTHONPATH": f"{ROOT}:{tmp_path}"}
    mission = begin(
        sys.executable, Path(__file__).with_name("beside_a_bridge.py"), env=inside, stdin=subprocess.PIPE
    )
    until(mission, lambda it: it == ["ready"])
    assert mission.stdin is not None

    def say(*words: object) -> None:
        assert mission.stdin is not None
        mission.stdin.write(json.dumps(words) + "\n")
        mission.stdin.flush()

    wifi, modem = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), serial.Serial(modems.path(2), 9600)
    wifi.settimeout(PATIENCE_S)
    modem.timeout = PATIENCE_S
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    ports = {
        "modem": modems.path(1),
        "wifi": f"udp:{port}",
        "topic": ROOT / "launch_scripts/interfaces/nodes.yaml",
    }
    send: Callable[[bytes], Any] = {
        "modem": lambda data: broadcast(modem, data),
        "wifi": lambda data: wifi.sendto(data, ("127.0.0.1", port)),
        "topic": lambda data: say(0, "modem", data.hex()),
    }[way]
    words = ("bridge", POOL_FILE, ports[way], "--ids", 7, "--codec", "lines", "--json")
    bridge = begin(*MUSSELBED, *words, env=inside, ends_by=signal.SIGKILL)
    until(bridge, lambda it: "ready" in it)
    if way == "modem":
        until(bridge, lambda it: "modem" in it)

    medium = "wifi" if way == "wifi" else "sound"
    say(7, "contact", "00")
    until(bridge, lambda it: "a contact" in it.get("dropped", ""))
    send(b"raise")
    until(bridge, lambda it: it.get("dropped", "").endswith("the codec raised RuntimeError: no such line"))
    send(LINE + b"00")
    until(bridge, lambda it: "damaged" in it.get("dropped", ""))
    send(checked(LINE.replace(b"S,7", b"S,8")))
    until(bridge, lambda it: "aMussel 8 is none of --ids" in it.get("dropped", ""))
    send(checked(LINE.replace(b"12.50", b"nan")))
    until(bridge, lambda it: "north_m is outside" in it.get("dropped", ""))
    say(7, "connected", "")
    until(mission, lambda it: it == ["connected"])
    send(checked(LINE))
    *packet, _, _ = until(mission, lambda it: it[0] == "heard")
    assert packet == ["heard", 7, medium, STATUS.hex()]

    say(7, "range", "")
    # In the bowl there is no modem with address 7.
    why = "not answered" if way == "modem" else "measures ranges"
    until(bridge, lambda it: "a ping" in it.get("dropped", "") and why in it["dropped"])
    # The mission's medium for it, whatever way there is.
    say(7, "sound", CommandPacket(Kind.PERMISSION, 7).encode().hex())
    match way:
        case "modem":
            assert modem.read_until(PERMISSION).endswith(b"#B00124" + PERMISSION)
        case "wifi":
            assert wifi.recv(100) == checked(PERMISSION)
        case "topic":
            told = until(mission, lambda it: it[0] == "request")
            assert told == ["request", 7, 1, checked(PERMISSION).hex()]
    bridge.send_signal(signal.SIGINT)
    counts = until(bridge, lambda it: "counts" in it)["counts"]
    assert bridge.wait(PATIENCE_S) == 130
    modem.close()
    wifi.close()
    assert counts["heard from aMussels"] == 1


def checked(line: bytes) -> bytes:
    """The line with the template's check, by hand: the exclusive or of what stands between $ and *, as digits."""
    check = 0
    for byte in line[1:-1]:
        check ^= byte
    return line + b"%02X" % check


def test_the_status_of_the_page_is_what_a_board_sends() -> None:
    board = StatusPacket(7, 0, State.FLOATING, 0.5, 1.0, 12.5, 3.0, 0.0, 60_000)
    assert board.encode() == STATUS
    page = (ROOT / "docs" / "mixing.md").read_text()
    assert STATUS.hex(" ") in page
    assert f"That is `$B{3 + len(STATUS)}`" in page


def test_modems_on_a_table_answer_and_hear_each_other_until_ctrl_c(tmp_path: Path, begin: Begin) -> None:
    table = tmp_path / "table"
    command = begin(*MUSSELBED, "modems", table)
    names = [line_of(command) for _ in range(2)]
    assert names == [str(table / f"modem{n}") for n in (1, 2)]
    one, two = (serial.Serial(name, 9600, timeout=PATIENCE_S) for name in names)
    with one, two:
        broadcast(two, b"hello")
        assert one.read_until(b"hello") == b"#B00205hello"
        command.send_signal(signal.SIGINT)
        assert command.wait(PATIENCE_S) == 130
    assert list(table.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["/dev/no-such-modem"], "/dev/no-such-modem"),
        (["udp:5005", "--codec", "no-such"], "no codec is called 'no-such'; there are: musselbed-1"),
        (["udp:192.0.2.1:5005"], "udp:192.0.2.1:5005: nobody can listen there"),
        (["udp:0", "udp:0"], "a bridge has one port by wifi"),
        ([ROOT / "launch_scripts/interfaces/nodes.yaml"] * 2, "a bridge has one port by sound"),
        ([ROOT / "launch_scripts/interfaces/modem.yaml"], "a bridge hears packets and tells packets"),
        (["/dev/no-such-modem", "--ids", "99"], "--ids 99: the scenario's aMussels are 1 to 12"),
    ],
)
def test_a_mistake_is_one_line_before_anything_starts(
    words: list[str],
    says: str,
    master: Master,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", master.uri)
    assert code_here("bridge", POOL_FILE, *words) == 2
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1) and says in told.err
