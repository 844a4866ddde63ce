"""What a modem does with a command from one of its serial lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.modem import answers, asking
from agents.modem.commands import Command, Malformed
from agents.modem.facts import Action, Dropped
from agents.modem.frames import ADDRESSES
from agents.modem.serial_line import TICKS_PER_MS
from agents.modem.states import ModemState, Trigger

if TYPE_CHECKING:
    from agents.modem.modem import Modem

_US_PER_MS = 1000


def obey(modem: Modem, came: Command | Malformed, number: int, tick: int, now_ms: int) -> list[Action]:
    """Obeys what line `number` brought, its last byte whole at `tick`; a modem that sleeps answers nothing."""
    if modem.state is ModemState.SLEEPING:
        # The first $W starts it; the manual says to repeat it until it is answered.
        awake = isinstance(came, Command) and came.name == "W"
        return modem.go(Trigger.WAKE_TOLD) if awake else []
    if isinstance(came, Malformed):
        modem.answer(number, answers.ERROR, tick)
        return [Dropped(now_ms, f"serial: {came.reason}")]
    if came.address >= ADDRESSES:
        modem.answer(number, answers.ERROR, tick)
        return [Dropped(now_ms, "serial: an address is 0 to 255")]
    if asking.goes_out(came.name):
        return asking.send(modem, came, number, tick, now_ms)
    return _obey_here(modem, came, number, tick)


def _obey_here(modem: Modem, command: Command, number: int, tick: int) -> list[Action]:
    """Commands that nothing in the water learns of."""
    actions: list[Action] = []
    name = command.name
    now_us = tick * _US_PER_MS // TICKS_PER_MS
    if name in ("?", "A", "D", "H", "Q", "N", "S"):
        if name == "A":
            modem.address = command.address
        if name in ("N", "S"):
            modem.answer(number, answers.line(f"${name}"), tick)
        modem.answer(number, _shown(modem, name), tick)
    elif name in ("Z", "W", "R"):
        if name == "R":
            actions = modem.restart()
        elif name == "Z":
            actions = modem.fall_asleep()
        modem.answer(number, answers.line(f"${name}"), tick)
    elif name.startswith("XT"):
        _set_timer(modem, name, now_us)
        modem.answer(number, answers.line(f"#{name}{modem.timer.read_us(now_us):014}"), tick)
    else:
        if name.startswith("XQ"):
            modem.tells_quality = name == "XQE"
        else:
            modem.raises_rxs = name == "XFE"
        modem.answer(number, answers.line(f"#{name}"), tick)
    return actions


def _shown(modem: Modem, name: str) -> bytes:
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
        case "N":
            noise = modem.noise
            return answers.line("#N" + answers.noise(noise.rms, noise.peak, noise.mean))
        case _:
            return answers.spectrum(modem.noise.mean)


def _set_timer(modem: Modem, name: str, now_us: int) -> None:
    if name in ("XTE", "XTD"):
        modem.timer.switch(name == "XTE", now_us)
        for line in modem.lines:
            line.reader.timed = modem.timer.is_on
    elif name == "XTC":
        modem.timer.clear(now_us)
