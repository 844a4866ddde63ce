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
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial, reduce
from operator import xor
from pathlib import Path
from typing import Any

import pytest
import serial
from doc_blocks import install_template
from programs import MUSSELBED, ROOT, Begin, code_here, line_of

from apad_bridge.acoustics.serial.table_modems import TableModems
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.modem import check_modem
from apad_bridge.records.run_directory import RunDirectory
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


def checked(line: bytes) -> bytes:
    """The line with the template's check, by hand: the exclusive or of what stands between $ and *, as digits."""
    return line + b"%02X" % reduce(xor, line[1:-1])


LINE = b"$STATUS,7,0,FLOATING,0.50000,1.00000,12.50,3.00,0.00,60000*"
"""The same status in the template's codec, without its check."""
PERMISSION = b"$COMMAND,PERMISSION,7*"
PACKET = b"\xb2\x07\x00" + CommandPacket(Kind.PERMISSION, 7).encode()
LINES_DROPPED = [
    (b"raise", "the codec raised RuntimeError: no such line"),
    (LINE + b"00", "damaged"),
    (checked(LINE.replace(b"S,7", b"S,9")), "aMussel 9 is none of --ids"),
    (checked(LINE.replace(b"12.50", b"nan")), "north_m is outside"),
]
PACKETS_DROPPED = [
    (b"\xb1\x07\x00" + STATUS[:-1] + b"\x00", "damaged"),
    (b"\xb1\x08\x00" + STATUS, "names another aMussel"),
    (b"\xb1\x09\x00" + STATUS, "none of --ids"),
    (b"hello", "without an aMussel's id"),
]


@dataclass(frozen=True)
class Road:
    """Between the node and the bridge: what is told and dropped on it, with the reason, and the packet that is heard."""

    way: str
    told: bytes
    dropped: list[tuple[bytes, str]] = field(default_factory=lambda: LINES_DROPPED)
    good: bytes = checked(LINE)
    codec: tuple[str, ...] = ("--codec", "lines")


ROADS = {
    "our modem": Road(
        "modem", b"#B001%02d" % len(PACKET) + PACKET, PACKETS_DROPPED, b"\xb1\x07\x00" + STATUS, ()
    ),
    "lines by our modem": Road("modem", b"#B00124" + checked(PERMISSION)),
    "lines by Wi-Fi": Road("wifi", checked(PERMISSION)),
    "lines by a topic": Road("topic", checked(PERMISSION)),
}
ROADS["a stranger's modem, of a run that names the master"] = ROADS["our modem"]


def broadcast(modem: serial.Serial, payload: bytes) -> None:
    modem.write(b"$B%02d" % len(payload) + payload)
    assert modem.read_until(b"\r\n") == b"$B%02d\r\n" % len(payload)


def say(mission: subprocess.Popen[str], *words: object) -> None:
    assert mission.stdin is not None
    mission.stdin.write(json.dumps(words) + "\n")
    mission.stdin.flush()


def run_on(master_uri: str, path: Path) -> Path:
    """A run's directory, which names the master in place of the shell."""
    directory, scenario = RunDirectory.create("pool", datetime.now(UTC), path), load(POOL_FILE)
    directory.write_inputs(scenario, starts_of(scenario))
    options = RunOptions(BenchPart.WHOLE, APadKind.SIM, TimeSource.WALL, 1.0, OnDeath.WAIT)
    replace(options, master_uri=master_uri, owns_master=True).save(directory.path)
    return path


@pytest.mark.parametrize("name", ROADS)
def test_a_real_amussels_packets_reach_the_mission_and_the_missions_reach_it(
    name: str,
    modems: TableModems,
    tmp_path: Path,
    shell: dict[str, str],
    begin: Begin,
) -> None:
    """The mission speaks the built-in codec. To a node with lines of its own the bridge translates, both ways."""
    road, of_stranger = ROADS[name], name.startswith("a stranger")
    install_template(tmp_path, "codec")
    first = '        if not data.startswith(b"$"):\n'
    raising = f'        if data == b"raise":\n            raise RuntimeError("no such\\nline")\n{first}'
    codec = tmp_path / "lab_codec.py"
    codec.write_text(codec.read_text().replace(first, raising))
    inside = shell | {"PYTHONPATH": f"{ROOT}:{tmp_path}"}
    named, bowl = POOL_FILE, StrangersModems(tmp_path / "theirs", begin) if of_stranger else modems
    if of_stranger:
        named = run_on(inside["ROS_MASTER_URI"], tmp_path / "run")
    beside = Path(__file__).with_name("beside_a_bridge.py")
    mission = begin(sys.executable, beside, env=inside, stdin=subprocess.PIPE)
    until(mission, lambda it: it == ["ready"])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        address = free.getsockname()
    ports = {
        "modem": bowl.path(1),
        "wifi": f"udp:{address[1]}",
        "topic": ROOT / "launch_scripts/interfaces/nodes.yaml",
    }
    its_shell = {key: it for key, it in inside.items() if key != "ROS_MASTER_URI" or not of_stranger}
    words = ("bridge", named, ports[road.way], "--ids", 2, 7, 8, *road.codec, "--json")
    bridge = begin(*MUSSELBED, *words, env=its_shell, ends_by=signal.SIGKILL)

    def drops(*reasons: str) -> None:
        until(bridge, lambda it: all(why in it.get("dropped", "") for why in reasons))

    claim = until(mission, lambda it: it[0] == "claim")
    assert claim == ["claim", "/musselbed_bridge_2", True, [2, 7, 8]]
    until(bridge, lambda it: ("modem" if road.way == "modem" else "ready") in it)
    with (
        closing(serial.Serial(bowl.path(2), 9600, timeout=PATIENCE_S)) as modem,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wifi,
    ):
        send, hears = {
            "modem": (partial(broadcast, modem), lambda: modem.read_until(road.told)[-len(road.told) :]),
            "wifi": (lambda data: wifi.sendto(data, address), lambda: wifi.recv(100)),
            "topic": (
                lambda data: say(mission, 0, "modem", data.hex()),
                lambda: bytes.fromhex(until(mission, lambda it: it[:3] == ["request", 7, 1])[3]),
            ),
        }[road.way]
        say(mission, 7, "contact", "00")
        drops("a contact")
        # What must be dropped comes first: nothing of it may be heard before the good packet.
        for data, reason in road.dropped:
            send(data)
            drops(reason)
        say(mission, 2, "connected", "")
        until(mission, lambda it: it == ["connected"])
        send(road.good)
        *packet, mission_time_ms, late_s = until(mission, lambda it: it[0] == "heard")
        assert packet == ["heard", 7, "wifi" if road.way == "wifi" else "sound", STATUS.hex()]
        # A bridge that is started anew would else say that its packets are older than those before.
        assert mission_time_ms == 0 and abs(late_s) < PATIENCE_S
        # In the bowl there is no modem with address 7.
        say(mission, 7, "range", "")
        drops("a ping", "not answered" if road.way == "modem" else "measures ranges")
        if road.way == "modem":
            # Modem 2 answers, though its aMussel never said a word.
            say(mission, 2, "range", "")
            _, agent_id, medium, metres, *_ = until(mission, lambda it: it[0] == "heard")
            assert (agent_id, medium) == (2, "range") and float(bytes.fromhex(metres)) > 0
            assert not of_stranger or float(bytes.fromhex(metres)) == pytest.approx(60, abs=1)
        # The mission's medium for it, whatever way there is.
        say(mission, 7, "sound", CommandPacket(Kind.PERMISSION, 7).encode().hex())
        assert hears() == road.told
    bridge.send_signal(signal.SIGINT)
    counts = until(bridge, lambda it: "counts" in it)["counts"]
    assert bridge.wait(PATIENCE_S) == 130 and counts["heard from aMussels"] == 1


def test_a_strangers_modems_answer_with_their_distance(tmp_path: Path, begin: Begin) -> None:
    status, echo = check_modem(Path(StrangersModems(tmp_path / "theirs", begin).path(1)), 2)
    assert (status.status, echo.status) == (CheckStatus.OK, CheckStatus.OK) and "address 1" in status.found
    metres = re.search(r"address 2 answers, ([0-9.]+) m away", echo.found)
    assert metres is not None and float(metres[1]) == pytest.approx(60, abs=1)


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
    words: list[str], says: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    assert code_here("bridge", POOL_FILE, *words) == 2
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1) and says in told.err
