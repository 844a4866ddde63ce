"""A real board on a serial line: our C board behind real ptys decides as ours does, whatever the cable does to bytes."""

from __future__ import annotations

import random
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from serial_rigs import Cable, SerialRig, compiled_for_serial

from agents.mussel.firmware_failure import FirmwareFailed
from agents.mussel.port.board_link import serial_line
from agents.mussel.port.port_firmware import PortFirmware
from agents.mussel.port.serial_board import SerialBoard
from firmware_model.actions import Action, Dropped, RunBuoyancy, SendBytes
from firmware_model.bench import Bench
from firmware_model.packets import Kind
from firmware_model.states import State
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import worst_case_board

CONFIG = worst_case_board()
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled_for_serial(tmp_path_factory)


@pytest.fixture
def rig(program: Path, tmp_path: Path) -> Iterator[SerialRig]:
    rig = SerialRig(program, tmp_path / "ttyUSB0")
    yield rig
    rig.close()


def bench_on(rig: SerialRig, links: list[SerialBoard], timeout_s: float = PATIENCE_S) -> Bench:
    """A bench with the board on that line; each reset of it adds a link."""

    def connect() -> SerialBoard:
        for link in links:
            link.close()
        links.append(SerialBoard(str(rig.device), 115_200, timeout_s, repeat_s=0.05))
        return links[-1]

    return Bench(CONFIG, firmware=lambda hardware: PortFirmware(connect, CONFIG, hardware, seed=1))


def dive(on: Bench) -> None:
    """A permission, a dock and a release, with packets for others in between."""
    on.run(minutes=1)
    on.command(Kind.PERMISSION)
    on.run(hours=0.1)
    on.charge_pin_rises()
    for _ in range(20):
        on.command(Kind.PING)
        on.run(minutes=3)
    on.charge_pin_falls()
    on.command(Kind.RELEASE)
    on.run(hours=0.5)


def outside(actions: list[Action]) -> list[Action]:
    return [it for it in actions if isinstance(it, RunBuoyancy | SendBytes | Dropped)]


def ours() -> Bench:
    on = Bench(CONFIG)
    dive(on)
    return on


def assert_as_ours(on: Bench) -> None:
    expected = ours()
    assert len(expected.did(RunBuoyancy)) == 2
    assert outside(on.trace) == outside(expected.trace)
    assert (on.state, on.board.primary) == (expected.state, expected.board.primary)


def test_a_board_on_a_serial_line_does_what_ours_does(rig: SerialRig) -> None:
    links: list[SerialBoard] = []
    on = bench_on(rig, links)
    dive(on)
    assert_as_ours(on)
    assert [it.damaged for it in links] == [0]


def damaging(seed: int, share: float) -> Cable:
    """A cable that changes, loses and adds bytes."""
    rng = random.Random(seed)

    def carried(data: bytes) -> bytes:
        out = bytearray()
        for byte in data:
            if rng.random() >= share:
                out.append(byte)
                continue
            match rng.randrange(3):
                case 0:
                    out.append(byte ^ 1 << rng.randrange(8))
                case 1:
                    out += bytes([byte, rng.randrange(256)])
        return bytes(out)

    return carried


@pytest.mark.parametrize("side", ["to the board", "from the board", "both ways"])
@pytest.mark.parametrize("seed", [1, 2])
def test_corrupted_bytes_change_nothing(rig: SerialRig, side: str, seed: int) -> None:
    if side != "from the board":
        rig.to_board = damaging(seed, 0.004)
    if side != "to the board":
        rig.from_board = damaging(seed + 1, 0.004)
    links: list[SerialBoard] = []
    on = bench_on(rig, links)
    dive(on)
    assert_as_ours(on)
    assert links[0].repeats > 1


def test_a_cable_that_is_pulled_out_and_put_back_changes_nothing(rig: SerialRig) -> None:
    """It goes in the middle of an answer, and comes back while the bench waits."""
    links: list[SerialBoard] = []
    on = bench_on(rig, links)
    on.run(minutes=1)
    left = threading.Event()

    def last_bytes(data: bytes) -> bytes:
        left.set()
        return data[: len(data) // 2]

    def pull() -> None:
        assert left.wait(PATIENCE_S)
        rig.pull_out()
        rig.from_board = bytes
        rig.plug_in()

    rig.from_board = last_bytes
    puller = threading.Thread(target=pull)
    puller.start()
    on.command(Kind.PERMISSION)
    puller.join()
    before = len(on.did(RunBuoyancy))
    on.run(hours=0.1)
    assert (before, on.state) == (1, State.FLOATING)


def test_a_cable_that_stays_out_is_told_and_bounded(rig: SerialRig) -> None:
    on = bench_on(rig, [], timeout_s=0.5)
    on.run(minutes=1)
    rig.pull_out()
    with pytest.raises(FirmwareFailed, match=r"ttyUSB0 was not there for 0.5 s: .*No such file") as failed:
        on.command(Kind.PERMISSION)
    assert failed.value.hung


def test_a_board_that_resets_by_itself_is_noticed_and_boots_again(rig: SerialRig) -> None:
    links: list[SerialBoard] = []
    on = bench_on(rig, links)
    on.run(minutes=1)
    on.command(Kind.PERMISSION)
    before = on.board.primary
    rig.reset()
    with pytest.raises(FirmwareFailed, match="it was reset, and not by the bench") as failed:
        on.run(hours=1)
    assert not failed.value.hung
    on.reset(ResetCause.BROWN_OUT)
    on.run(minutes=5)
    assert on.state is not State.BOOTING and on.board.primary.anchor_ms >= before.anchor_ms


def test_a_line_without_a_board_is_told(program: Path, tmp_path: Path) -> None:
    rig = SerialRig(program, tmp_path / "ttyUSB0", from_board=lambda data: b"")
    on = bench_on(rig, [], timeout_s=0.3)
    with pytest.raises(FirmwareFailed, match=r"no board answered on .*ttyUSB0 within 0.3 s"):
        on.run(ms=1)
    rig.close()


def test_a_new_bench_restarts_a_board_that_was_in_the_middle_of_an_exchange(rig: SerialRig) -> None:
    """The former bench was killed: nobody told the board that it ended."""
    links: list[SerialBoard] = []
    bench_on(rig, links).run(minutes=1)
    links.pop().close()
    on = bench_on(rig, links)
    dive(on)
    assert_as_ours(on)


def test_the_name_of_a_line_has_a_device_and_a_rate() -> None:
    assert serial_line("serial:/dev/ttyUSB0") == ("/dev/ttyUSB0", 115_200)
    assert serial_line("serial:/dev/ttyUSB0@921600") == ("/dev/ttyUSB0", 921_600)
    assert serial_line("/home/me/board") is None
    for wrong in ("serial:", "serial:/dev/ttyUSB0@fast", "serial:/dev/ttyUSB0@0"):
        with pytest.raises(ValueError, match="serial:DEVICE"):
            serial_line(wrong)
