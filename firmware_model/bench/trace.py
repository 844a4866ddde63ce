"""Writes a board's actions as readable lines and as a VCD file for GTKWave."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from firmware_model.actions import (
    Action,
    DropLog,
    Dropped,
    FeedFrom,
    LogSample,
    MotorsStalled,
    RunBuoyancy,
    SendAnswer,
    SendBytes,
    SendLog,
    SendStatus,
    SetRail,
    StateChanged,
    StateReported,
)
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.charge import Battery, ChargeModel, fraction
from firmware_model.power.rails import Rail
from firmware_model.states import State
from firmware_model.stimuli import (
    BottomReached,
    ChargePinFell,
    ChargePinRose,
    PacketHeard,
    PowerCameOn,
    Stimulus,
    SurfaceReached,
    WifiReceived,
)


def clock(at_ms: int) -> str:
    """Hours, minutes, seconds and milliseconds of agent time."""
    seconds, ms = divmod(at_ms, 1000)
    return f"{seconds // 3600:3d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{ms:03d}"


def line(action: Action) -> str:
    """One action as a readable line."""
    match action:
        case StateChanged(at_ms, old, trigger, new):
            return f"{clock(at_ms)}  {old.name} -{trigger.name}-> {new.name}"
        case StateReported(at_ms, old, new):
            return f"{clock(at_ms)}  {old.name} -> {new.name}"
        case RunBuoyancy(at_ms, to, depth_mm):
            depth = "" if depth_mm is None else f" at {depth_mm / 1000:g} m"
            return f"{clock(at_ms)}      motors: {to.name}{depth}"
        case MotorsStalled(at_ms, to):
            return f"{clock(at_ms)}      motors: {to.name} lacks charge"
        case SetRail(at_ms, rail, on):
            return f"{clock(at_ms)}      {rail.name} {'on' if on else 'off'}"
        case FeedFrom(at_ms, feed):
            return f"{clock(at_ms)}      fed by {feed.name}"
        case LogSample(at_ms):
            return f"{clock(at_ms)}      sample logged"
        case DropLog(at_ms, next_sequence):
            return f"{clock(at_ms)}      log acknowledged up to {next_sequence}"
        case SendLog(at_ms):
            return f"{clock(at_ms)}      log sent"
        case SendStatus(at_ms, by):
            return f"{clock(at_ms)}      status sent by {by.name}"
        case SendAnswer(at_ms):
            return f"{clock(at_ms)}      asked, and answered by MODEM_TRANSMITTING"
        case SendBytes(at_ms, by, data):
            return f"{clock(at_ms)}      {data.hex()} sent by {by.name}"
        case Dropped(at_ms, reason):
            return f"{clock(at_ms)}      dropped: {reason}"


_SAMPLE_MS = 60_000


def vcd(
    trace: Iterable[Action],
    courses: Sequence[tuple[int, Battery, Battery]],
    model: ChargeModel,
    until_ms: int,
    told: Iterable[tuple[int, Stimulus]] = (),
) -> str:
    """A VCD of states, rails, feed, batteries, pins and packets up to `until_ms`, in steps of a millisecond of agent time.

    `courses` are (from ms, primary, secondary), as `Bench.courses` keeps them; charges are sampled every minute and at
    the start of each course. `told` are the stimuli, as `Bench.told` keeps them.
    """
    changes = [change for at_ms, stimulus in told for change in _inputs(at_ms, stimulus)]
    for action in trace:
        match action:
            case StateChanged(at_ms, _, _, new) | StateReported(at_ms, _, new):
                changes.append((at_ms, f"s{new.name} S"))
            case SetRail(at_ms, rail, on):
                changes.append((at_ms, f"{int(on)}{_rail_id(rail)}"))
            case FeedFrom(at_ms, feed):
                changes.append((at_ms, f"s{feed.name} F"))
            case RunBuoyancy(at_ms, to, _):
                changes.append((at_ms, f"s{to.name} M"))
            case SendBytes(at_ms, by, data):
                changes.append((at_ms, f"s{by.name}:{data.hex()} T"))
            case SendStatus(at_ms, by):
                changes.append((at_ms, f"s{by.name}:status T"))
            case SendAnswer(at_ms):
                changes.append((at_ms, f"s{Rail.MODEM_TRANSMITTING.name}:answer T"))
            case SendLog(at_ms):
                changes.append((at_ms, f"s{Rail.WIFI.name}:log T"))
    changes += _charges(courses, model, until_ms)
    lines = [*_header(), "$dumpvars", f"s{State.OFF.name} S", f"s{ActiveBattery.PRIMARY.name} F"]
    lines += [f"0{_rail_id(rail)}" for rail in Rail] + ["0C", "0U", "$end"]
    now_ms = -1
    for at_ms, change in sorted(changes, key=lambda it: it[0]):
        if at_ms != now_ms:
            lines.append(f"#{at_ms}")
            now_ms = at_ms
        lines.append(change)
    if now_ms < until_ms:
        lines.append(f"#{until_ms}")
    return "\n".join(lines) + "\n"


def _inputs(at_ms: int, stimulus: Stimulus) -> Iterator[tuple[int, str]]:
    """The changes of the charger's pin, of the surface and of the packets that reach the board."""
    match stimulus:
        case ChargePinRose() | ChargePinFell():
            yield at_ms, f"{int(isinstance(stimulus, ChargePinRose))}C"
        case SurfaceReached() | BottomReached():
            yield at_ms, f"{int(isinstance(stimulus, SurfaceReached))}U"
        case PowerCameOn(_, at_surface, pin_high):
            yield from ((at_ms, f"{int(pin_high)}C"), (at_ms, f"{int(at_surface)}U"))
        case PacketHeard(data):
            yield at_ms, f"sMODEM:{data.hex()} R"
        case WifiReceived(data):
            yield at_ms, f"sWIFI:{data.hex()} R"


def _rail_id(rail: Rail) -> str:
    return chr(ord("a") + rail)


def _header() -> list[str]:
    variables = [f"$var wire 1 {_rail_id(rail)} {rail.name} $end" for rail in Rail]
    return [
        "$timescale 1ms $end",
        "$scope module mu $end",
        "$var string 1 S state $end",
        "$var string 1 F feed $end",
        "$var real 64 P primary $end",
        "$var real 64 Q secondary $end",
        "$var wire 1 C charger $end",
        "$var wire 1 U surface $end",
        "$var string 1 M motors $end",
        "$var string 1 T sent $end",
        "$var string 1 R received $end",
        *variables,
        "$upscope $end",
        "$enddefinitions $end",
    ]


def _charges(
    courses: Sequence[tuple[int, Battery, Battery]], model: ChargeModel, until_ms: int
) -> list[tuple[int, str]]:
    changes: list[tuple[int, str]] = []
    ends = [from_ms for from_ms, _, _ in courses[1:]] + [until_ms + 1]
    for (from_ms, primary, secondary), end_ms in zip(courses, ends, strict=True):
        first_ms = (from_ms // _SAMPLE_MS + 1) * _SAMPLE_MS
        for at_ms in (from_ms, *range(first_ms, end_ms, _SAMPLE_MS)):
            changes.append((at_ms, f"r{fraction(model.charge_at(primary, at_ms)):.9g} P"))
            changes.append((at_ms, f"r{fraction(model.charge_at(secondary, at_ms)):.9g} Q"))
    return changes
