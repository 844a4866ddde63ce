"""Carries out the commands that a modem reads from one of its serial lines."""

from __future__ import annotations

from agents.modem import answers, sending
from agents.modem.commands import Malformed, ModemCommand
from agents.modem.core import MEASURING_MS, ModemCore
from agents.modem.facts import AddressChanged, FrameDropped, ModemAction
from agents.modem.frames import ADDRESSES
from agents.modem.serial_line import TICKS_PER_MS
from agents.modem.states import ModemState, ModemTrigger

_US_PER_MS = 1000


def handle(
    modem: ModemCore, item: ModemCommand | Malformed, line_index: int, tick: int, now_ms: int
) -> list[ModemAction]:
    """Handles what that line completed at `tick`, with its last byte. A sleeping modem answers nothing."""
    if modem.state is ModemState.SLEEPING:
        # The first $W starts it; the manual tells the host to repeat $W until the modem answers.
        wakes = isinstance(item, ModemCommand) and item.name == "W"
        return modem.go(ModemTrigger.WAKE_ORDERED) if wakes else []
    if isinstance(item, Malformed):
        modem.answer(line_index, answers.ERROR, tick)
        return [FrameDropped(now_ms, f"serial: {item.reason}")]
    if item.address >= ADDRESSES:
        modem.answer(line_index, answers.ERROR, tick)
        return [FrameDropped(now_ms, "serial: an address is 0 to 255")]
    if sending.goes_out(item.name):
        return sending.send(modem, item, line_index, tick, now_ms)
    return _handle_local(modem, item, line_index, tick, now_ms)


def _handle_local(
    modem: ModemCore, command: ModemCommand, line_index: int, tick: int, now_ms: int
) -> list[ModemAction]:
    """Carries out a command that sends nothing through the water."""
    actions: list[ModemAction] = []
    name = command.name
    now_us = tick * _US_PER_MS // TICKS_PER_MS
    if name in ("?", "A", "D", "H", "Q"):
        if name == "A":
            modem.address = command.address
            actions = [AddressChanged(now_ms, command.address)]
        modem.answer(line_index, _report(modem, name), tick)
    elif name in MEASURING_MS:
        if modem.measurement is not None:
            modem.answer(line_index, answers.ERROR, tick)
            return [FrameDropped(now_ms, "serial: the noise is being measured already")]
        modem.measure(name, line_index, tick)
        modem.answer(line_index, answers.line(f"${name}"), tick)
    elif name in ("Z", "W", "R"):
        if name == "R":
            actions = modem.restart()
        elif name == "Z":
            actions = modem.fall_asleep()
        modem.answer(line_index, answers.line(f"${name}"), tick)
    elif name.startswith("XT"):
        _set_timer(modem, name, now_us)
        # The letter is the timer's state, whatever was asked: so the makers' driver reads it.
        state = "E" if modem.timer.is_on else "D"
        modem.answer(line_index, answers.line(f"#XT{state}{modem.timer.read_us(now_us):014}"), tick)
    else:
        if name.startswith("XQ"):
            modem.reports_quality = name == "XQE"
        else:
            modem.raises_rxs = name == "XFE"
        modem.answer(line_index, answers.line(f"#{name}"), tick)
    return actions


def _report(modem: ModemCore, name: str) -> bytes:
    match name:
        case "?":
            return answers.status(modem.config.firmware, modem.address, modem.supply_mv)
        case "A":
            return answers.line(f"#A{modem.address:03}")
        case "D":
            return answers.identity(modem.config.unique_id)
        case "H":
            return answers.HELP
        case "Q":
            return answers.line("$C-" if modem.corrected is None else f"$C{modem.corrected}")
    raise ValueError(f"${name} reports nothing")


def _set_timer(modem: ModemCore, name: str, now_us: int) -> None:
    if name in ("XTE", "XTD"):
        modem.timer.switch(name == "XTE", now_us)
        for line in modem.lines:
            line.reader.timed = modem.timer.is_on
    elif name == "XTC":
        modem.timer.clear(now_us)
