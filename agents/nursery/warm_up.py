"""The life of an aMussel that never was, played in the nursery before it forks.

Python specialises code and fills caches as it runs, which copies pages that a forked agent would otherwise share. After
this every path of an agent has run, so that a thousand agents share the result.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from agents.fleet import AgentConfigs, resting_on_bottom
from agents.hosting.agent_process import WindowHandler, answer_one, message_room
from agents.hosting.host import Grant
from agents.hosting.link_protocol import NEVER, Repeat, Window
from agents.mussel.agent import Agent, AgentConfig
from agents.mussel.stimuli import (
    CoilSlipped,
    ContactClosed,
    ContactOpened,
    DockMoved,
    ModemSent,
    PingArrived,
    Placed,
    SoundArrived,
    Stimulus,
    WasReset,
    WifiArrived,
)
from agents.nursery.flash_file import FlashRegion
from agents.nursery.state_file import RecordPair
from firmware_model.config import BoardConfig, FullFirmware
from firmware_model.packets import (
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
from firmware_model.packets.codec import Codec
from firmware_model.packets.commands import LATEST_MS
from firmware_model.stimuli import ResetCause

_Value = TypeVar("_Value")
_LIVES = 12
"""The interpreter specialises a function after eight calls."""
ROUND = 3
"""One life in so many begins with an empty battery."""
_ALARM_MS = 10_000
_REPORT_MS = 300_000
"""Reports come at least so often: those who report seldom would rehearse for hours."""


def warm_up(configs: AgentConfigs, codec: Codec, agent_id: int, lives: int = _LIVES) -> None:
    """Plays all of an agent's paths, among them the refusals."""
    slots, flash = os.memfd_create("rehearsal"), os.memfd_create("rehearsal")
    hearer, teller = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    asker, link = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with hearer, teller, asker, link, message_room() as room:

        def ask(servant: WindowHandler, message: bytes) -> None:
            asker.send(message)
            answer_one(link, room, servant)
            for end in (asker, hearer):
                while _drained(end):
                    pass

        config = configs.config(agent_id)
        config = _with(config, report_period_ms=min(config.report_period_ms, _REPORT_MS))
        if config.board.whole is not None:
            config = _with(config, board=_in_haste(config.board, config.board.whole))
        for life in range(lives):
            _live(config, codec, 0.5 if life % ROUND else 0.0, slots, FlashRegion(flash, 0, 3), teller, ask)
    os.close(slots)
    os.close(flash)


def _in_haste(board: BoardConfig, whole: FullFirmware) -> BoardConfig:
    """The same board with everything that it does in an hour within ten seconds."""
    cycle = whole.cycle
    if cycle is not None:
        slots = None if cycle.slots is None else _with(cycle.slots, frame_ms=1000, slot_ms=1000, guard_ms=100)
        processing_ms = min(cycle.processing_ms, 1000)
        cycle = _with(
            cycle,
            alarm_ms=_ALARM_MS,
            sample_ms=1000,
            processing_ms=processing_ms,
            slots=slots,
            listen_ms=1000,
        )
    timekeeping = whole.timekeeping
    if timekeeping is not None:
        # In doubt 5 s after a beacon.
        timekeeping = _with(timekeeping, bound_ppb=20_000_000, beacon_wait_ms=1000)
    power = _with(whole.power, motor_run_ms=1000)
    hasty = _with(
        whole,
        power=power,
        cycle=cycle,
        transmit_ms=100,
        turnaround_ms=100,
        answer_ms=100,
        call_ms=1000,
        hover_ms=2000,
        stay_down_ms=1000,
        timekeeping=timekeeping,
    )
    return _with(board, whole=hasty, slot=0)


def _with(value: _Value, **changes: Any) -> _Value:
    """`dataclasses.replace`, which knows nothing of the nursery's lean classes."""
    kind: Any = type(value)
    made: _Value = kind(**{name: changes.get(name, getattr(value, name)) for name in kind.__slots__})
    return made


def _live(
    config: AgentConfig,
    codec: Codec,
    primary: float,
    slots: int,
    flash: FlashRegion,
    teller: socket.socket,
    ask: Callable[[WindowHandler, bytes], None],
) -> None:
    agent_id = config.board.agent_id
    pair = RecordPair(slots, 0, agent_id)
    secondary = 1.0 if primary else 0.1
    pair.initial_state(resting_on_bottom(0.0, 0.0, config.water.bottom_um / 1e6, primary, secondary))
    cause = ResetCause.POWER_ON
    for epoch in (1, 2):
        slot = pair.newest((epoch, 0))
        if slot is None:
            raise AssertionError("a slot just written was not found")
        flash.roll_back(slot.physical.samples)
        agent = Agent(config, codec, slot.physical, slot.granted_ms, cause, flash)
        servant = WindowHandler(agent, pair, teller, slot.key, slot.granted_ms)
        until_ms = slot.granted_ms
        ask(servant, Repeat((epoch, 0)).encode())
        sequence = 0
        for part in (_days, _wakes):
            for duration_ms, stimuli in part(agent, codec, agent_id, until_ms):
                facts = tuple((until_ms, stimulus) for stimulus in stimuli)
                until_ms += duration_ms
                sequence += 1
                window = Window((epoch, sequence), Grant(until_ms, facts)).encode()
                ask(servant, window)
                ask(servant, window)
        for wrong in (b"wrong", Window(NEVER, Grant(0)).encode(), Repeat((epoch, 1)).encode()):
            ask(servant, wrong)
        cause = ResetCause.BROWN_OUT


def _wakes(agent: Agent, codec: Codec, agent_id: int, now_ms: int) -> Iterator[tuple[int, list[Stimulus]]]:
    """As `_days`, for a board that sleeps: a wake on the bottom, and one in a dock, where it sends its log."""
    config = agent.config
    cycle = None if config.board.whole is None else config.board.whole.cycle
    if cycle is None:
        return
    words = (LogAck(agent_id, 1), LogAck(agent_id, 2**31), CommandPacket(Kind.BACK_UP_LOG, agent_id))
    permission, *told = (codec.encode(word) for word in (CommandPacket(Kind.PERMISSION, agent_id), *words))
    up_ms, in_dock_ms = config.water.surfacing_ms, config.board.pin_debounce_ms + config.water.step_ms
    yield 2 * cycle.alarm_ms, []
    yield up_ms, [SoundArrived(permission)]
    yield in_dock_ms, [ContactClosed(0, 0)]
    docked_ms = now_ms + 2 * cycle.alarm_ms + up_ms + in_dock_ms
    yield cycle.alarm_ms - docked_ms % cycle.alarm_ms, []
    yield cycle.sample_ms, [WifiArrived(data) for data in told]
    yield config.board.release_wait_ms + config.water.sinking_ms, [ContactOpened()]


def _days(agent: Agent, codec: Codec, agent_id: int, now_ms: int) -> Iterator[tuple[int, list[Stimulus]]]:
    """(duration in agent ms, stimuli at its start), window by window, from the bottom to the bottom."""
    config = agent.config
    permission = codec.encode(CommandPacket(Kind.PERMISSION, agent_id))
    release = codec.encode(CommandPacket(Kind.RELEASE, agent_id))
    second_ms = config.water.step_ms
    yield config.board.boot_ms + second_ms, []
    yield config.report_period_ms, [SoundArrived(b"wrong")]
    yield second_ms, [PingArrived(1)]
    if config.board.whole is not None:
        ping, hover = (codec.encode(CommandPacket(kind, agent_id)) for kind in (Kind.PING, Kind.HOVER))
        yield 2 * _ALARM_MS, [SoundArrived(ping), SoundArrived(ping)]
        yield 3000, [PingArrived(1), PingArrived(1), ModemSent(100)]
        for word in _words(config.board, agent_id, now_ms):
            yield 3000, [SoundArrived(codec.encode(word))]
        yield _ALARM_MS, [SoundArrived(hover)]
        yield _ALARM_MS, [SoundArrived(release), SoundArrived(hover)]
    yield (
        config.water.surfacing_ms,
        [SoundArrived(permission), ContactOpened(), DockMoved(0, 0)],
    )
    yield second_ms, [SoundArrived(permission), PingArrived(1)]
    yield config.board.pin_debounce_ms + second_ms, [ContactClosed(0, 0), ContactClosed(0, 0)]
    yield config.report_period_ms + _ALARM_MS, [DockMoved(1, 1), CoilSlipped()]
    yield config.board.pin_debounce_ms, [WifiArrived(release), ContactOpened()]
    yield config.water.sinking_ms, [WifiArrived(permission)]
    yield config.report_period_ms + second_ms, [WifiArrived(release)]
    charge, secondary = agent.board.primary.charge, agent.board.secondary.charge
    yield config.board.boot_ms + second_ms, [Placed(0, 0, config.water.bottom_um, charge, secondary)]
    yield config.board.boot_ms + second_ms, [WasReset(ResetCause.WATCHDOG)]


def _words(board: BoardConfig, agent_id: int, now_ms: int) -> Iterator[Command]:
    """What changes a whole board's clock, settings and depth; each also as it cannot be obeyed."""
    cycle = None if board.whole is None else board.whole.cycle
    if cycle is not None:
        yield SleepSchedule(agent_id, cycle.alarm_ms, cycle.sample_ms)
        if cycle.slots is not None:
            yield SlotAssignment(agent_id, cycle.slots.frame_ms, cycle.slots.slot_ms, 100, 0, -10)
    yield SleepSchedule(agent_id, 0, 0)
    yield SlotAssignment(agent_id, 0, 1, 0, 0, 0)
    yield SetThreshold(agent_id, Threshold.SAFE_LEVEL, 0.2)
    # Whatever the time in this life is, one of many beacons a second apart finds a board that waits for it.
    for _ in range(12):
        yield Beacon(agent_id, now_ms)
    yield Beacon(agent_id, LATEST_MS + 1)
    yield HoverAt(agent_id, 0.0)
    yield HoverAt(agent_id, 1.0)
    yield CommandPacket(Kind.SINK, agent_id)


def _drained(hearer: socket.socket) -> bool:
    try:
        return bool(hearer.recv(1, socket.MSG_DONTWAIT))
    except BlockingIOError:
        return False
