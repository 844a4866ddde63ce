"""The whole board in C, in a process of its own: an agent with it lives the life of ours, byte for byte."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from fleets import STILL
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st
from native_boards import NATIVE, compiled, compiled_with, script

from agents.fleet_config import resting_on_bottom
from agents.mussel.agent import Agent, AgentConfig
from agents.mussel.board_parts import BoardPart
from agents.mussel.body import Body
from agents.mussel.failing_flash import FailingFlash
from agents.mussel.firmware_failure import FirmwareFailed, PowerLost
from agents.mussel.outputs import Output, StimulusDropped, Truth, WifiSent
from agents.mussel.port import whole_port_firmware
from agents.mussel.port.peripherals import Address, MeasuredWorld, Peripherals
from agents.mussel.stimuli import (
    AgentStimulus,
    CoilSlipped,
    ContactClosed,
    ContactOpened,
    PartFailed,
    PinDisturbed,
    PingArrived,
    Placed,
    SoundArrived,
    WasReset,
    WifiArrived,
)
from firmware_model import config
from firmware_model.actions import Buoyancy
from firmware_model.config import LastResort, Timekeeping
from firmware_model.hardware.whole import WholeBoardHardware
from firmware_model.packets import (
    PLAIN,
    Beacon,
    Command,
    CommandPacket,
    HoverAt,
    Kind,
    LogAck,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    Threshold,
)
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.port_frames import Frame, FromBoard, SleepMode
from firmware_model.power.charge import FULL, Battery, Flow, grains
from firmware_model.power.rails import Rail, bits
from firmware_model.sampling.flash import Flash, MemoryFlash
from firmware_model.states import State
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import FIELD, METERING, board, power

CODEC = MusselbedCodec()
CYCLE = replace(FIELD, alarm_ms=200_000)
WATER = replace(STILL, body=replace(STILL.body, coil_alignment_ms=20_000)).maker().config(7).water
OURS = AgentConfig(board(CYCLE, power(LastResort.CALL), agent_id=7), WATER, STILL.reports)
_METERED = board(CYCLE, power(LastResort.SURFACE, metering=METERING, low_level=FULL // 2), agent_id=7)
assert _METERED.whole is not None
METERED = replace(
    OURS,
    board=replace(
        _METERED,
        drift_ppb=-20_000,
        whole=replace(_METERED.whole, timekeeping=Timekeeping(50_000, 30_000), stay_down_ms=300_000),
    ),
)
AWAKE = replace(OURS, board=board(None, power(LastResort.CALL), agent_id=7))
PAPER = replace(OURS, reports=replace(STILL.reports, heard_always=True))
BOTH = replace(OURS, board=board(CYCLE, power(LastResort.CALL, secondary_in_use=True), agent_id=7))
CONFIGS = {
    "calls": OURS,
    "works on both": BOTH,
    "metered, surfaces": METERED,
    "never sleeps": AWAKE,
    "heard always": PAPER,
}
COMMANDS: tuple[Command, ...] = (
    *(CommandPacket(kind, 7) for kind in sorted(PLAIN)),
    CommandPacket(Kind.PING, 0),
    CommandPacket(Kind.SINK, 9),
    Beacon(7, 500_000),
    Beacon(0, 1_500_000),
    Beacon(7, 1 << 60),
    SleepSchedule(7, 150_000, 20_000),
    SleepSchedule(7, 20_000, 150_000),
    SlotAssignment(7, 60_000, 4000, 1500, 3, -20),
    SlotAssignment(7, 60_000, 4000, 1500, 15, 0),
    SetThreshold(7, Threshold.SAFE_LEVEL, 0.1),
    SetThreshold(7, Threshold.LOW_LEVEL, 0.8),
    HoverAt(7, 1.25),
    HoverAt(7, 0.0),
    LogAck(7, 2),
    LogAck(7, 9999),
)
STIMULI: tuple[AgentStimulus, ...] = (
    *(SoundArrived(CODEC.encode(command)) for command in COMMANDS),
    *(WifiArrived(CODEC.encode(command)) for command in COMMANDS),
    SoundArrived(b"wrong"),
    WifiArrived(b""),
    *(ContactClosed(0, 0), ContactOpened(), CoilSlipped()) * 3,
    PingArrived(1000),
    PinDisturbed(False, True),
    Placed(1_000_000, 2_000_000, 3_000_000, grains(0.4), grains(0.9)),
    WasReset(ResetCause.BROWN_OUT),
    *(
        PartFailed(part, value)
        for part, values in {
            BoardPart.BUS: (1, 0),
            BoardPart.CONVERTER: (grains(0.05), 0),
            BoardPart.UARTS: (4, 0),
            BoardPart.WRITES: (10, 0),
            BoardPart.CELLS: (16, 0),
            BoardPart.SUPPLY: (1, 13, 23),
            BoardPart.HOLD: (1, 0),
            BoardPart.FLASH: (1, 0),
            BoardPart.DEPTH: (1, 0),
        }.items()
        for value in values
    ),
)
END_MS = 2_000_000
TIMES = st.integers(0, END_MS)
Story = list[tuple[int, AgentStimulus]]


@pytest.fixture(scope="module")
def c_board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory, "whole_board")


def life(
    config: AgentConfig, story: Story, cuts: list[int], charges: tuple[float, float]
) -> tuple[list[Output], list[Truth]]:
    mussel = Agent(config, CODEC, resting_on_bottom(1.0, 2.0, 3.0, *charges), 0, ResetCause.POWER_ON)
    outputs: list[Output] = []
    moments = [(at_ms, 1, stimulus) for at_ms, stimulus in story] + [(at_ms, 0, None) for at_ms in cuts]
    for at_ms, _, stimulus in sorted(moments, key=lambda it: it[:2]):
        outputs += mussel.advance(at_ms) if stimulus is None else mussel.receive(stimulus, at_ms)
    outputs += mussel.advance(END_MS)
    mussel.close()
    return outputs, mussel.take_truths()


def is_sending_cut_short(truths: list[Truth]) -> bool:
    """True if something ended a transmission: on the C board the modem then sends to its end."""
    return any(
        before.state in (State.TRANSMITTING, State.CALLING)
        and after.state not in (before.state, State.SLEEPING, State.EMPTY)
        for before, after in pairwise(truths)
    )


def without_dead_reports(outputs: list[Output], truths: list[Truth]) -> list[Output]:
    """The outputs without the experiment's reports of a board without power, whose log only our board's host knows."""
    dark = [
        (it.at_ms, after.at_ms)
        for it, after in zip(truths, [*truths[1:], replace(truths[-1], at_ms=END_MS + 1)], strict=True)
        if it.state is State.LOST
    ]
    return [
        it
        for it in outputs
        if not (isinstance(it, WifiSent) and any(begin <= it.at_ms <= end for begin, end in dark))
    ]


def lasting(truths: list[Truth]) -> list[Truth]:
    """The truths that held for a millisecond or more: a board may pass through a state in one step or in two."""
    held = [truth for truth, after in pairwise(truths) if truth.at_ms != after.at_ms] + truths[-1:]
    return held[:1] + [after for truth, after in pairwise(held) if after != replace(truth, at_ms=after.at_ms)]


@pytest.mark.parametrize("name", CONFIGS)
@settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@example(
    story=[(2000, SoundArrived(CODEC.encode(CommandPacket(Kind.HOVER, 7))))], cuts=[], charges=(0.001, 0.15)
)
@example(
    # Its clock is set back by seven periods in its sleep, and by less than one in the wake after it.
    story=[
        (310_000, SoundArrived(CODEC.encode(Beacon(0, 1_500_000)))),
        (715_000, SoundArrived(CODEC.encode(Beacon(7, 500_000)))),
        (820_000, SoundArrived(CODEC.encode(Beacon(7, 500_000)))),
    ],
    cuts=[],
    charges=(0.9, 1.0),
)
@example(
    # A level is reached at the millisecond at which a brown-out in a write resets the board.
    story=[
        (472, SoundArrived(CODEC.encode(SleepSchedule(7, 150_000, 20_000)))),
        (196_962, SoundArrived(CODEC.encode(SetThreshold(7, Threshold.LOW_LEVEL, 0.8)))),
        (245_930, PartFailed(BoardPart.SUPPLY, 1)),
    ],
    cuts=[],
    charges=(0.5001, 1.0),
)
@given(
    story=st.lists(st.tuples(TIMES, st.sampled_from(STIMULI)), max_size=12, unique_by=lambda it: it[0]),
    cuts=st.lists(TIMES, max_size=6),
    charges=st.sampled_from([(0.0, 0.0), (0.001, 0.15), (0.01, 1.0), (0.9, 1.0), (0.5001, 1.0)]),
)
def test_it_lives_the_life_of_our_board(
    c_board: Path, name: str, story: Story, cuts: list[int], charges: tuple[float, float]
) -> None:
    """Any stimuli at any times, and for the C board any further cuts: the same packets, refusals and physical states."""
    config = CONFIGS[name]
    outputs, truths = life(config, story, [], charges)
    assume(not is_sending_cut_short(truths))
    theirs = life(replace(config, firmware=(str(c_board),)), story, cuts, charges)
    assert without_dead_reports(*theirs) == without_dead_reports(outputs, truths)
    assert lasting(theirs[1]) == lasting(truths)


TRUSTING = ("return hal_feed() == HAL_PRIMARY ||", "return true || hal_feed() == HAL_PRIMARY ||")
"""A mistake of firmware: it goes on as if its battery never emptied."""


@pytest.fixture(scope="module")
def trusting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    source = NATIVE / "whole" / "state_task.c"
    assert TRUSTING[0] in source.read_text()
    program = tmp_path_factory.mktemp("trusting") / "board"
    compiled_with(tmp_path_factory, source, source.read_text().replace(*TRUSTING), program)
    return program


def test_firmware_without_power_does_nothing_and_a_charger_boots_it(trusting: Path) -> None:
    """Afloat it idles with 950 mW of radios, by hand 0.0010427 + 950 / 7400 / 60 a minute: 0.004 last for 75 s."""
    config = replace(AWAKE, firmware=(str(trusting),))
    afloat = replace(resting_on_bottom(1.0, 2.0, 0.0, 0.002, 0.002), buoyancy=Buoyancy.FLOAT)
    mussel = Agent(config, CODEC, afloat, 0, ResetCause.POWER_ON)
    mussel.advance(70_000)
    assert mussel._others is not None
    firmware = mussel._others.program
    assert firmware is not None and firmware.pid is not None and Path(f"/proc/{firmware.pid}").exists()
    mussel.advance(80_000)
    assert not Path(f"/proc/{firmware.pid}").exists()
    assert (mussel.board.state, mussel.board.rails) == (State.LOST, 0)
    assert (mussel.physical.primary.charge, mussel.physical.secondary.charge) == (0, 0)
    for kind in (Kind.PERMISSION, Kind.SINK, Kind.BACK_UP_LOG):
        (dropped,) = mussel.receive(WifiArrived(CODEC.encode(CommandPacket(kind, 7))), 300_000)
        assert dropped == StimulusDropped(300_000, 7, "Wi-Fi is off")
    mussel.receive(ContactClosed(0, 0), 400_000)
    mussel.advance(430_000)
    assert mussel.board.reset_cause is ResetCause.BROWN_OUT
    assert mussel.board.state is State.CHARGING
    mussel.close()


def frames(*sent: tuple[int, int, bytes]) -> bytes:
    return b"".join(Frame(kind, port, 0, n, payload).encode() for n, (kind, port, payload) in enumerate(sent))


HELLO = (FromBoard.HELLO, 0, b"\1\0board")


def test_a_watchdog_that_is_not_served_resets_the_board_also_in_its_sleep(tmp_path: Path) -> None:
    """It is started for 5 s at each boot; charge and place go on, and the cause is the board's to tell."""
    answer = frames(
        HELLO, (FromBoard.KICK, 0, (5000).to_bytes(4, "little")), (FromBoard.SLEEP, SleepMode.DEEP << 1, b"")
    )
    program = script(tmp_path, f"port.recv(9999); port.sendall({answer!r}); port.recv(9999)")
    config = replace(OURS, firmware=(str(program),))
    mussel = Agent(config, CODEC, resting_on_bottom(1.0, 2.0, 3.0, 0.5, 1.0), 0, ResetCause.POWER_ON)
    mussel.advance(4_999)
    assert mussel.board.reset_cause is ResetCause.POWER_ON
    mussel.advance(5_000)
    assert mussel.board.reset_cause is ResetCause.WATCHDOG
    assert (mussel.physical.north_um, mussel.physical.depth_um) == (1_000_000, 3_000_000)
    assert 0 < grains(0.5) - mussel.physical.primary.charge < grains(0.001)
    mussel.close()


def test_a_program_that_was_built_with_other_numbers_does_not_begin(
    c_board: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """It would read the scenario's numbers shifted."""
    monkeypatch.setattr(
        whole_port_firmware, "numbers_for_port", lambda *it: (*config.numbers_for_port(*it), 7)
    )
    ours = replace(OURS, firmware=(str(c_board),))
    with pytest.raises(FirmwareFailed):
        Agent(ours, CODEC, resting_on_bottom(1.0, 2.0, 3.0, 0.5, 1.0), 0, ResetCause.POWER_ON).advance(60_000)
    assert "build with its board_config.h" in capfd.readouterr().err


def devices(now_ms: int = 0, flash: Flash | None = None) -> tuple[Peripherals, WholeBoardHardware]:
    battery = Battery(0, FULL // 2, Flow.DISCHARGING)
    hardware = WholeBoardHardware(OURS.board, battery, battery, 0, None)
    hardware.power_on(False, False, now_ms)
    body = resting_on_bottom(1.0, -2.0, 3.0, 0.5, 0.5)
    world = MeasuredWorld(
        flash or MemoryFlash(), Body(7, OURS.water, body, now_ms), lambda at, n: ((1, 2, 3, 4 + n), 0b1000)
    )
    return Peripherals(hardware, world), hardware


def test_a_sensor_without_power_and_a_silent_one_do_not_answer() -> None:
    bus, hardware = devices()
    assert bus.transfer(Address.SENSOR + 3, b"", 3, 0) is None
    hardware.enter(State.SAMPLING, bits(Rail.TURBIDITY), 0)
    assert bus.transfer(Address.SENSOR + 3, b"", 3, 0) == b"\4\0\1"
    assert bus.transfer(Address.SENSOR + 2, b"", 3, 0) is None
    bus.world.sensors = lambda now_ms, sequence: None
    assert bus.transfer(Address.SENSOR + 3, b"", 3, 0) is None


@pytest.mark.parametrize(
    ("address", "written", "count"),
    [
        (0x11, b"", 1),
        (0x50, b"short", 0),
        (0x36, b"\3\0\0", 0),
        (0x68, b"", 1),
        (0x68, b"\x63\0", 0),
        (0x48, b"", 11),
    ],
)
def test_bytes_that_no_device_takes_get_no_answer(address: int, written: bytes, count: int) -> None:
    assert devices()[0].transfer(address, written, count, 0) is None


def test_a_write_that_fails_is_an_error_of_the_flash() -> None:
    failing: dict[BoardPart, int] = {}
    bus, _ = devices(flash=FailingFlash(MemoryFlash(), failing))
    failing[BoardPart.WRITES] = 3
    assert bus.flash_program(0, b"torn") is None and bus.flash_read(0, 4) == b"tor\0"
    failing.clear()
    failing[BoardPart.CELLS] = 0x20
    assert bus.flash_program(8, b"worn") is None and bus.flash_read(8, 4) == b"WORN"
    failing.clear()
    failing[BoardPart.SUPPLY] = 2
    with pytest.raises(PowerLost):
        bus.flash_program(16, b"dark")
    assert bus.flash_read(16, 4) == b"da\0\0" and bus.flash_program(32, b"whole") == b""


def test_flash_is_programmed_once_within_a_page() -> None:
    bus, _ = devices()
    assert bus.flash_program(4090, b"over the edge") is None
    assert bus.flash_program(4088, b"to the..") == b"" and bus.flash_read(4088, 8) == b"to the.."
    assert bus.flash_program(4000, b"once") == b"" and bus.flash_program(4002, b"twice") is None
    assert bus.flash_read(3999, 6) == b"\0once\0"
    assert bus.flash_erase(0) == b"" and bus.flash_read(4000, 4) == b"\0\0\0\0"
    assert bus.flash_erase(16) is None and bus.flash_read(16 * 4096 - 1, 2) is None
