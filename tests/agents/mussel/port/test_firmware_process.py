"""Firmware in a process of its own: our C board decides as ours does, and a program that misbehaves is a stated failure."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from native_boards import bench, compiled, script

from agents.mussel.firmware_failure import FirmwareFailed
from agents.mussel.port.firmware_process import _is_long
from agents.mussel.port.port_firmware import PortFirmware
from firmware_model.actions import Action, StateChanged, StateReported
from firmware_model.bench import Bench
from firmware_model.packets import Beacon, CommandPacket, Kind, StatusPacket
from firmware_model.port_frames import Frame, FromBoard, OutputPin
from firmware_model.power.charge import Battery
from firmware_model.states import State
from firmware_model.stimuli import PacketHeard, ResetCause, WifiReceived
from firmware_model.table_one import worst_case_board

CONFIG = replace(
    worst_case_board(), surfacing_timeout_ms=90_000, float_timeout_ms=1_800_000, motor_run=10**12
)
STATUS = StatusPacket(1, 0, State.ACTIVE, 0.5, 0.5, 0.0, 0.0, 0.0, 0)
PACKETS = [
    b"",
    b"\1\2\3",
    STATUS.encode(),
    Beacon(1, 7).encode(),
    CommandPacket(Kind.PERMISSION, 1).encode()[:-1] + b"\0",
    *(
        CommandPacket(kind, agent_id).encode()
        for kind in (Kind.PERMISSION, Kind.RELEASE)
        for agent_id in (0, 1, 9)
    ),
    *(CommandPacket(kind, 1).encode() for kind in (Kind.PING, Kind.SINK, Kind.HOVER, Kind.BACK_UP_LOG)),
    CommandPacket(Kind.PING, 0).encode(),
]
STEPS = st.one_of(
    st.tuples(st.just("sound"), st.sampled_from(PACKETS)),
    st.tuples(st.just("wifi"), st.sampled_from(PACKETS)),
    st.tuples(st.just("rises"), st.booleans()),
    st.tuples(st.just("falls"), st.booleans()),
    st.tuples(st.just("reset"), st.sampled_from(ResetCause)),
)
WAITS_MS = st.one_of(st.integers(0, 120), st.integers(0, 3000), st.integers(0, 7_200_000))


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory)


def seen(actions: list[Action]) -> list[Action]:
    """The actions without triggers, which are inside the firmware; a state that is reported again is no change."""
    changes = (
        StateReported(it.at_ms, it.old, it.new) if isinstance(it, StateChanged) else it for it in actions
    )
    # On the way out of OFF the port shows BOOTING as soon as the board has power.
    return [
        it for it in changes if not isinstance(it, StateReported) or State.OFF is not it.old is not it.new
    ]


def act(on: Bench, what: str, value: object) -> None:
    match what, value:
        case "sound", bytes(data):
            on.tell(PacketHeard(data))
        case "wifi", bytes(data):
            on.tell(WifiReceived(data))
        case "rises", bool(noticed):
            on.charge_pin_rises(noticed=noticed)
        case "falls", bool(noticed):
            on.charge_pin_falls(noticed=noticed)
        case "reset", ResetCause() as cause:
            on.reset(cause)


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(STEPS, WAITS_MS), max_size=14),
    st.sampled_from([0.0, 0.02, 0.9]),
    st.sampled_from([0.0, 0.01, 1.0]),
    st.lists(st.integers(1, 900_000), max_size=4),
)
def test_the_c_board_does_what_ours_does(
    board: Path,
    steps: list[tuple[tuple[str, object], int]],
    charge: float,
    backup: float,
    cuts: list[int],
) -> None:
    """Any stimuli at any times, and for the C board any further cuts of time between them."""
    ours = Bench(CONFIG, primary=charge, secondary=backup)
    theirs = bench(CONFIG, board, charge, secondary=backup)
    for (what, value), wait_ms in steps:
        act(ours, what, value)
        act(theirs, what, value)
        end_ms = ours.now_ms + wait_ms
        ours.run_until(end_ms)
        for cut_ms in cuts:
            theirs.run_until(min(end_ms, theirs.now_ms + cut_ms))
        theirs.run_until(end_ms)
    assert seen(theirs.trace) == seen(ours.trace) and theirs.state is ours.state
    assert (theirs.board.primary, theirs.board.secondary) == (ours.board.primary, ours.board.secondary)


def encoded(*sent: tuple[int, int, bytes]) -> bytes:
    return b"".join(Frame(kind, port, 0, n, payload).encode() for n, (kind, port, payload) in enumerate(sent))


def frames(*sent: tuple[int, int, bytes]) -> str:
    return f"port.sendall({encoded(*sent)!r}); time.sleep(60)"


HELLO = (FromBoard.HELLO, 0, b"\1\0board")
GAP = Frame(FromBoard.HELLO, 0, 0, 0, b"\1\0").encode() + Frame(FromBoard.SLEEP, 0, 0, 2).encode()
ALARMS = """import struct, binascii
def frame(kind, port, n, payload):
    body = struct.pack('<BBHII', kind, port, len(payload), 0, n) + payload
    body += struct.pack('<H', binascii.crc_hqx(body, 0xFFFF))
    return b''.join(bytes([len(it) + 1]) + it for it in body.split(b'\\0')) + b'\\0'
port.sendall(frame(65, 0, 0, b'\\1\\0board'))
n = 1
while port.recv(4096):
    port.sendall(frame(66, 1, n, bytes(4)))
    n += 1
"""
"""An alarm at 0 rings at once, for ever."""
FAILURES: dict[str, tuple[str, str]] = {
    "ends": ("sys.exit(3)", "it ended with exit status 3"),
    "is killed": ("os.kill(os.getpid(), 11)", "it was killed by SIGSEGV"),
    "speaks nonsense": ("port.sendall(b'hello\\0'); time.sleep(60)", "it sent "),
    "never ends a frame": ("port.sendall(b'x' * 5000); time.sleep(60)", "without an end"),
    "sends zeros": ("while True: port.sendall(bytes(65536))", "zeros without an end"),
    "only writes to its stderr, so it hangs": (
        "while True: os.write(2, bytes(65536))",
        "did not end its turn within 0.5 s",
    ),
    "hangs": ("time.sleep(60)", "did not end its turn within 0.5 s"),
    "hangs after a part of a frame": ("port.sendall(b'\\x05abc'); time.sleep(60)", "did not end its turn"),
    "is of another version": (frames((FromBoard.HELLO, 0, b"\x09\0")), "speaks version 9"),
    "sends a type that there is not": (frames(HELLO, (200, 0, b"")), "type 200, port 0"),
    "sends a pin that there is not": (frames(HELLO, (FromBoard.PIN, 77, b"\1")), "type 67, port 77"),
    "sends a state that there is not": (frames(HELLO, (FromBoard.STATE, 0, b"\xfe")), "type 70, port 0"),
    "sends a frame too long": (frames(HELLO, (FromBoard.SLEEP, 1, b"\0")), "a SLEEP of another length"),
    "reads a converter that there is not": (frames(HELLO, (FromBoard.ADC_READ, 5, b"")), "type 69, port 5"),
    "leaves a frame out": (f"port.sendall({GAP!r}); time.sleep(60)", "frame 2 came where 1 was due"),
    "floods, and the watchdog ends it": (
        frames(HELLO, *((FromBoard.LOG, 0, b"again") for _ in range(10_001))),
        "10000 frames at one time",
    ),
    # Its answers fill the link after some hundred, and the bench goes on counting.
    "floods and never reads, and the watchdog ends it": (
        frames(HELLO, *((FromBoard.ADC_READ, 0, b"") for _ in range(10_001))),
        "10000 frames at one time",
    ),
    "lets no time pass, and the watchdog ends it": (ALARMS, "10000 frames at one time"),
}


@pytest.mark.parametrize("name", FAILURES)
def test_a_program_that_misbehaves_is_a_stated_failure(tmp_path: Path, name: str) -> None:
    text, reason = FAILURES[name]
    on = bench(CONFIG, script(tmp_path, text), timeout_s=0.5 if "hangs" in name else 30.0)
    with pytest.raises(FirmwareFailed, match=reason) as failed:
        on.run(ms=1)
    assert failed.value.hung == ("hangs" in name) and failed.value.by_watchdog >= ("watchdog" in name)


def test_a_program_has_ended_though_a_child_of_its_holds_its_port(tmp_path: Path) -> None:
    left = tmp_path / "left"
    text = f"child = os.fork() or time.sleep(60)\nopen({str(left)!r}, 'w').write(str(child))\nsys.exit(3)"
    on = bench(CONFIG, script(tmp_path, text))
    try:
        with pytest.raises(FirmwareFailed, match="it ended with exit status 3") as failed:
            on.run(ms=1)
        assert not failed.value.hung
    finally:
        if left.exists():
            os.kill(int(left.read_text()), signal.SIGKILL)


def test_what_a_program_says_is_passed_on_up_to_a_bound(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    says = "os.write(2, b'\\x1b[2Jready\\n'); os.write(2, b'.' * 1_000_000)"
    answer = encoded(HELLO, (FromBoard.SLEEP, 0, b""))
    bench(CONFIG, script(tmp_path, f"{says}; port.sendall({answer!r}); time.sleep(60)")).run(ms=1)
    told = capfd.readouterr().err
    assert told.startswith("\\x1b[2Jready\n....") and len(told) < 70_000
    assert told.endswith(".\nthe rest of what this program writes to its stderr is left out\n")


def test_a_long_log_takes_nothing_more(tmp_path: Path) -> None:
    with (tmp_path / "nursery.log").open("wb") as log:
        assert not _is_long(log.fileno())
        log.truncate(17 << 20)
        assert _is_long(log.fileno())


def test_a_board_draws_its_load_after_its_boot_though_its_program_never_sets_a_pin(tmp_path: Path) -> None:
    answer = encoded(HELLO, (FromBoard.SLEEP, 0, b""))
    on = bench(CONFIG, script(tmp_path, f"port.recv(9999); port.sendall({answer!r}); time.sleep(60)"))
    before = on.primary
    on.run(hours=1)
    assert on.primary == before - on.config.charge.discharge * (3_600_000 - CONFIG.boot_ms - 1)


def test_a_board_that_leaves_its_charger_on_gains_nothing_without_a_contact(tmp_path: Path) -> None:
    """The pin's check and its chatter are the longest that our own board needs: 62 s of 20 hours."""
    begins = (HELLO, (FromBoard.PIN, OutputPin.CHARGE, b"\1"), (FromBoard.SLEEP, 0, b""))
    answers = [encoded(*begins), *(Frame(FromBoard.SLEEP, 0, 0, n).encode() for n in (3, 4))]
    text = "".join(f"port.recv(9999); port.sendall({answer!r})\n" for answer in answers)
    on = bench(CONFIG, script(tmp_path, f"{text}time.sleep(60)"), primary=0.5)
    on.run(minutes=1)
    on.charge_pin_rises()
    on.charge_pin_falls()
    at_contact = on.primary
    on.run(hours=1)
    gained = on.config.charge.segments[1][1] * 62_000
    lost = on.config.charge.discharge * (3_600_000 - 62_000)
    assert on.primary == at_contact + gained - lost


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def pid_of(on: Bench) -> int:
    firmware = on.board.firmware
    assert isinstance(firmware, PortFirmware)
    pid = firmware.pid
    assert pid is not None
    return pid


ENDS: dict[str, Callable[[Bench], object]] = {
    "a reset": lambda it: it.reset(ResetCause.BROWN_OUT),
    "close": lambda it: it.board.firmware.close() if isinstance(it.board.firmware, PortFirmware) else None,
}


@pytest.mark.parametrize("name", ENDS)
def test_its_process_ends_and_is_reaped(board: Path, name: str) -> None:
    on = bench(CONFIG, board)
    on.run(hours=1)
    pid = pid_of(on)
    assert alive(pid)
    ENDS[name](on)
    assert not alive(pid)


def test_a_process_killed_between_two_turns_fails_in_the_next(board: Path) -> None:
    on = bench(CONFIG, board)
    on.run(minutes=1)
    before: Battery = on.board.primary
    os.kill(pid_of(on), signal.SIGKILL)
    with pytest.raises(FirmwareFailed, match="killed by SIGKILL"):
        on.run(hours=1)
    assert on.board.primary == before


def test_a_program_that_is_none_fails(tmp_path: Path) -> None:
    on = bench(CONFIG, tmp_path / "nothing")
    with pytest.raises(FirmwareFailed, match="exit status 127"):
        on.run(ms=1)
