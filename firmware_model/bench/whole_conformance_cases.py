"""The cases of the conformance kit for a whole board: sleep, timeslots, two batteries, a log with its upload."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from firmware_model.bench.conformance import Case, PaperTime, RequirementSource, Whole
from firmware_model.bench.conformance_cases import AFTERWARDS, COUNTER, PIN, counting
from firmware_model.bench.rigs import COMMANDS, lasts_ms
from firmware_model.bench.wrong_packets import (
    EVERY_COMMAND,
    OTHER_VERSIONS,
    UNKNOWN_LAYOUTS,
    by_sound,
    damages,
)
from firmware_model.config import LastResort
from firmware_model.packets import (
    EVERYONE,
    AcousticStatus,
    Beacon,
    Command,
    CommandPacket,
    HoverAt,
    Kind,
    LogAck,
    LogRecords,
    SetThreshold,
    ShortStatus,
    SleepSchedule,
    SlotAssignment,
    Threshold,
    WifiStatus,
)
from firmware_model.packets.command_packets import TRIGGERS
from firmware_model.packets.wire import sealed
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.state_groups import BEYOND_HELP, DOCKED, STRANDED
from firmware_model.states import TABLE, State, Trigger
from firmware_model.stimuli import ResetCause

_NEVER, _HOURLY, _FIELD = Whole("never"), Whole("hourly"), Whole("field")
_UP = "3s permission 70s"
"""It floats."""
_DOCKED = f"{_UP} rises 10min"
_RELEASED = f"{_DOCKED} falls 1s"
_RELEASED_IN_A_REPORT = f"{_UP} rises 3529s release"
"""A dock's only release that the board hears: in the hour's report its Wi-Fi is on."""
_SLOT_MS = 2
"""The tolerance of a timeslot."""
_LEVEL_MS = 40_000
"""The tolerance of what a level of charge causes after 3 h and more: 0.3 % of that time."""
_LOW_LEVEL_MS = 3000
"""The same after a quarter of an hour."""
_UPLOADED = "1h permission 70s rises 10min"
"""Docked, a report and an upload after the words before it."""


def _sound(command: Command) -> str:
    return f"sound:{command.encode().hex()}"


def _wifi(command: Command) -> str:
    return f"wifi:{command.encode().hex()}"


_SINK = _wifi(CommandPacket(Kind.SINK, 1))
"""Sound does not reach a modem in air."""
_ASKED = _wifi(CommandPacket(Kind.BACK_UP_LOG, 1))
_EACH_MINUTE = _sound(SleepSchedule(1, 60_000, 10_000))
_EACH_WAKE_S_SLOT = _sound(SlotAssignment(1, 60_000, 3000, 500, 10, 0))
_SLOT_7 = _sound(SlotAssignment(1, 300_000, 3000, 500, 7, 0))
_MANY_SAMPLES = f"3s {_EACH_MINUTE} 100min permission 70s rises"
"""Docked with 98 samples at 101 min 13 s; the next report is at 102 min."""
_LAST_SLOT = _sound(SlotAssignment(1, 300_000, 3000, 500, 99, 0))
_REPORTING = f"{_MANY_SAMPLES} 48s"
"""At 102 min 1 s, a second after the report."""
_CALLS = Whole("hourly", 0.21, last_resort=LastResort.CALL)
_SURFACES = Whole("hourly", 0.21, last_resort=LastResort.SURFACE)
_LOW_CALLS, _LOW_SURFACES = replace(_CALLS, secondary=0.19), replace(_SURFACES, secondary=0.19)
"""At the safe level as soon as the primary is empty."""
_case = partial(Case, whole=_HOURLY)
"""A case of a board that wakes each hour, if `whole` does not say otherwise."""


def _sends(kind: type[Any], **values: object) -> Callable[[Any], bool]:
    """True for a packet of this kind with these values."""
    return lambda it: isinstance(it, kind) and all(getattr(it, key) == value for key, value in values.items())


def _table_one(name: str, mode: str, script: str, whole: Whole, ends: str, *minutes: float) -> Case:
    primary = 0.0 if ends == "the primary is full" else 1.0
    paper = PaperTime(ends, minutes[0], minutes[-1])
    return _case(
        name, RequirementSource.PAPER, f"Table I: {mode}", script, whole=whole, primary=primary, paper=paper
    )


_PAPER = [
    _table_one("table-1-idle", "discharging, idle", "17h", _NEVER, "the primary is empty", 959, 962),
    _table_one(
        "table-1-asleep", "discharging, hourly wakes", "240h", _HOURLY, "the primary is empty", 14_057
    ),
    _table_one(
        "table-1-charging-idle",
        "charging, idle",
        "10h",
        Whole("never", docked=True),
        "the primary is full",
        575,
    ),
    _table_one(
        "table-1-charging-asleep",
        "charging, hourly wakes",
        "7h",
        Whole("hourly", docked=True),
        "the primary is full",
        398,
    ),
    _table_one(
        "table-1-backup",
        "charging the second battery",
        "9h",
        Whole("hourly", 0.0, docked=True),
        "the backup is full",
        485,
    ),
    _case(
        "surfaces", RequirementSource.PAPER, "V-A: the aPad's permission brings it up", "3s permission 3min"
    ),
    _case(
        "surfaces-from-sleep",
        RequirementSource.PAPER,
        "IV-A: a packet wakes a sleeping one",
        "30min permission 3min",
    ),
    _case("stays-down", RequirementSource.PAPER, "II: without a permission it stays on the bottom", "13h"),
    _case("charges", RequirementSource.PAPER, "III: a closed dock charges it", f"{_DOCKED} 5h", primary=0.2),
    _case(
        "sinks-when-released",
        RequirementSource.PAPER,
        "V-A: released, it sinks",
        f"{_RELEASED} release 5min",
    ),
    _case(
        "not-before",
        RequirementSource.PAPER,
        "V-A: in its dock it waits until it is full",
        f"{_DOCKED} release 1h",
    ),
    _case(
        "two-services",
        RequirementSource.PAPER,
        "V-A: a second service is as the first",
        f"{_RELEASED} release 2h permission 70s rises 1h falls 1s release 3min",
    ),
]
_WRAPPING: tuple[tuple[str, str, str | Callable[[Any], bool]], ...] = (
    ("afloat", "30h permission 9h", "motors sink"),
    *COUNTER[1:],
    ("while-it-hovers", "36h 15min hover 1h", "motors hover"),
    ("before-an-answer", f"131071s 700ms ping 10s {_EACH_MINUTE} 5min ping 1min", _sends(ShortStatus)),
)
_SLEEP = [
    _case("wakes-hourly", RequirementSource.PAPER, "IV-A: it wakes at each whole hour for 10 s", "5h"),
    _case(
        "listens-first", RequirementSource.STATES, "at rest on the bottom it listens, then it sleeps", "2min"
    ),
    _case(
        "field-wakes",
        RequirementSource.STATES,
        "it samples, processes, and sends in its timeslot",
        "4h",
        whole=_FIELD,
        tolerance_ms=_SLOT_MS,
    ),
    _case(
        "in-slot-7",
        RequirementSource.PACKETS,
        "an assigned timeslot counts from now on",
        f"3s {_SLOT_7} 4h",
        whole=_FIELD,
        tolerance_ms=_SLOT_MS,
    ),
    _case(
        "a-first-slot",
        RequirementSource.STATES,
        "a board that had no slot transmits from now on",
        f"3s {_SLOT_7} 4h",
        tolerance_ms=_SLOT_MS,
    ),
    *(
        _case(
            f"an-offset-of-{offset_ms}-ms",
            RequirementSource.PACKETS,
            "an offset moves the timeslot",
            f"3s {_sound(SlotAssignment(1, 300_000, 3000, 500, 2, offset_ms))} 3h",
            whole=_FIELD,
            tolerance_ms=_SLOT_MS,
        )
        for offset_ms in (-300, 300)
    ),
    _case(
        "a-slot-that-cannot-be",
        RequirementSource.PACKETS,
        "a timeslot beyond its frame is refused",
        f"3s {_sound(SlotAssignment(1, 60_000, 4000, 1500, 15, 0))} 3h",
        whole=_FIELD,
    ),
    _case(
        "each-minute",
        RequirementSource.PACKETS,
        "a schedule counts from now on",
        f"3s {_EACH_MINUTE} 1h permission 70s rises 10min",
    ),
    _case(
        "each-minute-told-in-its-sleep",
        RequirementSource.PACKETS,
        "a schedule counts from now on",
        f"10min {_EACH_MINUTE} 30min permission 70s rises 10min",
        shows=_sends(LogRecords),
    ),
    _case(
        "in-slot-7-told-in-its-sleep",
        RequirementSource.PACKETS,
        "an assigned timeslot counts from now on",
        f"10min {_SLOT_7} 3h",
        whole=_FIELD,
        tolerance_ms=_SLOT_MS,
        shows=_sends(AcousticStatus),
    ),
    *(
        _case(
            f"an-offset-beyond-its-frame-{name}",
            RequirementSource.PACKETS,
            "the board takes the next such time, even if the offset moves it beyond its frame",
            f"3s {_sound(SlotAssignment(1, 300_000, 3000, 500, index, offset_ms))} {script}",
            whole=_HOURLY,
            tolerance_ms=_SLOT_MS,
            shows=_sends(AcousticStatus),
        )
        for name, index, offset_ms, script in (
            ("late", 99, 200_000, "2h"),
            ("early", 0, -200_000, "2h"),
            ("by-frames", 50, 1_000_000, "2h"),
            ("by-frames-back", 50, -1_000_000, "3s brown_out 2h"),
        )
    ),
    *(
        _case(
            f"the-counter-wraps-{name}",
            RequirementSource.PORT,
            "the counter wraps after 36 hours",
            script,
            whole=Whole(float_min=480),
            is_near_tie="debounce" in name,
            shows=shows,
        )
        for name, script, shows in _WRAPPING
    ),
    _case(
        "a-longer-wake",
        RequirementSource.PACKETS,
        "a schedule sets the length of a wake",
        f"3s {_sound(SleepSchedule(1, 600_000, 60_000))} 2h permission 70s rises 15min",
    ),
    _case(
        "a-schedule-that-cannot-be",
        RequirementSource.PACKETS,
        "a wake longer than its period is refused",
        f"3s {_sound(SleepSchedule(1, 20_000, 150_000))} 3h",
        whole=_FIELD,
    ),
    _case(
        "settings-outlive-a-reset",
        RequirementSource.STATES,
        "schedule and timeslot are kept",
        f"3s {_SLOT_7} {_sound(SleepSchedule(1, 600_000, 20_000))} 30min brown_out 2h",
        whole=_FIELD,
        tolerance_ms=_SLOT_MS,
    ),
    *(
        _case(
            f"drifts-by-{ppm}-ppm",
            RequirementSource.STATES,
            "timeslots follow the board's own clock",
            f"3s {_SLOT_7} 12h",
            whole=Whole("field", drift_ppm=ppm),
            tolerance_ms=_SLOT_MS,
        )
        for ppm in (-100, 100)
    ),
    _case(
        "a-beacon-sets-it",
        RequirementSource.STATES,
        "a beacon sets the drifting clock",
        f"3s {_SLOT_7} 359min beacon:21543000 6h",
        whole=Whole("field", drift_ppm=100),
        tolerance_ms=_SLOT_MS,
    ),
    _case(
        "a-beacon-for-all",
        RequirementSource.PACKETS,
        "a beacon to id 0 sets every clock",
        f"30min {_sound(Beacon(EVERYONE, 2_400_000))} 2h",
        whole=_FIELD,
    ),
    _case(
        "past-an-alarm",
        RequirementSource.STATES,
        "set past an alarm, it rings at once",
        "30min beacon:3700000 2h",
        whole=_FIELD,
    ),
    _case(
        "no-alarm-twice",
        RequirementSource.STATES,
        "set back, no alarm rings twice",
        "90min beacon:1800000 permission 20s sink 3h",
        whole=_FIELD,
    ),
    *(
        _case(
            name,
            RequirementSource.STATES,
            "set back by more than a period, the alarms begin a new count",
            script,
            whole=_FIELD,
        )
        for name, script in (
            ("a-new-count-from-0", "90min beacon:0 3h"),
            ("a-week-ahead-and-then-right", "30min beacon:606600000 10min beacon:2400000 3h"),
        )
    ),
    _case(
        "a-time-that-cannot-be",
        RequirementSource.PACKETS,
        "a beacon of such a time is refused",
        f"30min {_sound(Beacon(1, 1 << 60))} 3h",
        whole=_FIELD,
    ),
    _case(
        "a-clock-in-doubt",
        RequirementSource.STATES,
        "a clock beyond its guard transmits nothing",
        f"3s {_SLOT_7} 8h",
        whole=Whole("field", doubt_ppm=50),
    ),
    _case(
        "a-beacon-dispels-it",
        RequirementSource.STATES,
        "a beacon in the wait lets it transmit after all",
        f"3s {_SLOT_7} 241min 17s beacon:14480000 1h",
        whole=Whole("field", doubt_ppm=50),
        tolerance_ms=_SLOT_MS,
        shows=lambda it: isinstance(it, AcousticStatus) and 14_480_000 < it.agent_ms < 15_000_000,
    ),
    _case(
        "in-doubt-at-its-slot",
        RequirementSource.STATES,
        "the clock's error at the timeslot counts, and not that as the wait begins",
        f"3s {_LAST_SLOT} 297s beacon:300000 5h",
        whole=Whole("field", doubt_ppm=35),
        shows="state AWAITING_BEACON",
    ),
    _case(
        "each-beacon-ends-the-doubt",
        RequirementSource.STATES,
        "the error of the clock counts since the last beacon, also one that was heard in a boot",
        f"3s {_SLOT_7} 2h brown_out 1s beacon:7204000 170min beacon:17404000 3h",
        whole=Whole("field", doubt_ppm=50),
        tolerance_ms=_SLOT_MS,
        shows=_sends(AcousticStatus),
    ),
    _case(
        "woken-by-a-reset",
        RequirementSource.STATES,
        "a reset in its sleep boots it",
        "90min watchdog 2h",
        whole=_FIELD,
    ),
    _case(
        "pi-at-work",
        RequirementSource.STATES,
        "a reset in a wake ends it",
        "1h 30s brown_out 2h",
        whole=_FIELD,
    ),
]
_GOES_ON = "the board answers a stated turnaround later with its state of then, and otherwise continues"
_ANSWERS = _sends(ShortStatus)
_PINGS = [
    _case("a-ping", RequirementSource.STATES, "500 ms after a ping it answers", "10s ping 1min"),
    _case(
        "a-ping-in-sleep",
        RequirementSource.STATES,
        "a sleeping board answers, and sleeps on",
        "10min ping 1h",
    ),
    _case("a-ping-in-a-wake", RequirementSource.STATES, "an answer prolongs no wake", "3603s ping 1h"),
    _case(
        "a-ping-on-its-way",
        RequirementSource.STATES,
        "it answers on its way up",
        "3s permission 20s ping 2min",
    ),
    _case(
        "a-ping-down",
        RequirementSource.STATES,
        "it answers on its way down",
        f"{_RELEASED} release 20s ping 3min",
    ),
    _case("two-pings", RequirementSource.STATES, "one answer at a time", "10s ping 300ms ping 5s ping 10s"),
    *(
        _case(
            f"a-ping-{name}",
            RequirementSource.STATES,
            requirement,
            script,
            whole=whole,
            is_near_tie=True,
            counts_refusals=True,
            shows=shows,
        )
        for name, requirement, script, whole, shows in (
            ("as-it-falls-asleep", _GOES_ON, "61s 800ms ping 5min", _FIELD, _ANSWERS),
            ("as-it-wakes", _GOES_ON, "3599s 800ms ping 20min", _FIELD, _ANSWERS),
            ("as-its-wake-ends", _GOES_ON, "3609s 800ms ping 20min", _HOURLY, _ANSWERS),
            ("as-the-pi-begins", _GOES_ON, "3609s 800ms ping 20min", _FIELD, _ANSWERS),
            ("as-the-pi-ends", _GOES_ON, "3669s 800ms ping 20min", _FIELD, _ANSWERS),
            ("as-it-hovers-on", _GOES_ON, "10s hover 599s 800ms ping 20min", _FIELD, _ANSWERS),
            ("as-it-comes-down", _GOES_ON, f"{_UP} {_SINK} 59s 800ms ping 5min", _FIELD, _ANSWERS),
            ("before-a-permission", _GOES_ON, "10s ping 200ms permission 5min", _FIELD, _ANSWERS),
            ("before-a-hover", _GOES_ON, "10min ping 200ms hover 5min", _FIELD, _ANSWERS),
            ("before-it-is-empty", _GOES_ON, "10min ping 200ms loses:100 5min", _FIELD, _ANSWERS),
            (
                "before-it-calls-no-more",
                _GOES_ON,
                "10s loses:100 2min ping 200ms ping 5min",
                _LOW_CALLS,
                _ANSWERS,
            ),
            (
                "as-it-comes-up",
                "lifted out, it drops its answer and counts it",
                "3s permission 59s 700ms ping 5min",
                _FIELD,
                None,
            ),
            (
                "before-its-dock",
                "docked, it drops its answer and counts it",
                "10s rises ping 200ms 5min",
                _FIELD,
                None,
            ),
            ("before-a-reset", "a reset forgets an answer", "10min ping 200ms brown_out 5min", _FIELD, None),
            (
                "after-a-reset",
                "a reset forgets that it is to answer",
                "10min ping 200ms brown_out 5s ping 1min",
                _FIELD,
                _ANSWERS,
            ),
            (
                "while-it-answers",
                "while its modem sends it misses a ping",
                "10min ping 600ms ping 5s ping 5min",
                _FIELD,
                _ANSWERS,
            ),
            (
                "as-it-calls",
                "before a call it answers no more",
                "10s loses:100 600s ping 5min",
                _LOW_CALLS,
                None,
            ),
        )
    ),
    _case(
        "a-hundred-pings",
        RequirementSource.STATES,
        "a sleeping board is up for the turnaround and the answer, and then sleeps at once again",
        f"2min {' '.join(['ping 2s'] * 100)}",
        shows=_sends(ShortStatus),
    ),
    _case(
        "a-ping-for-all",
        RequirementSource.STATES,
        "nobody answers a ping to everyone, and a board counts it",
        f"10s {_sound(CommandPacket(Kind.PING, EVERYONE))} 1min",
        counts_refusals=True,
    ),
    _case(
        "a-ping-before-its-slot",
        RequirementSource.STATES,
        "its own slot drops the answer",
        "3899s 700ms ping 1min",
        whole=_FIELD,
    ),
    _case(
        "a-ping-while-empty",
        RequirementSource.STATES,
        "it answers on its backup",
        "2h ping 1min",
        primary=0.005,
    ),
    _case(
        "a-ping-hovering", RequirementSource.STATES, "it answers while it hovers", "10s hover 5min ping 5min"
    ),
    _case(
        "for-another",
        RequirementSource.PACKETS,
        "a command has the id of its receiver",
        f"10s {_sound(CommandPacket(Kind.PING, 2))} {_sound(CommandPacket(Kind.PERMISSION, 257))} 3min",
    ),
    _case(
        "other-versions",
        RequirementSource.PACKETS,
        "a kind of an unknown version is dropped",
        f"10s {by_sound(OTHER_VERSIONS)} 2h ping 1min",
    ),
    _case(
        "every-length",
        RequirementSource.PACKETS,
        "bytes that are no packet are dropped",
        " ".join(["10s", *(f"sound:{'ff' * n}" for n in range(65)), "ping 1min"]),
    ),
]
_TRAVEL = [
    _case(
        "hovers",
        RequirementSource.STATES,
        "it hovers at an ordered depth",
        f"10s {_sound(HoverAt(1, 1.25))} 1h",
    ),
    _case(
        "hovers-here",
        RequirementSource.STATES,
        "it hovers where it is",
        "10s permission 30s sink 10s hover 3h",
    ),
    _case(
        "hovers-by-runs",
        RequirementSource.STATES,
        "a run at every interval keeps the depth",
        "10s hover 65min",
    ),
    _case(
        "never-at-the-surface",
        RequirementSource.STATES,
        "it does not hover at the surface",
        f"10s {_sound(HoverAt(1, 0.0))} 1h",
    ),
    _case(
        "up-from-hovering",
        RequirementSource.STATES,
        "a permission ends a hover",
        "10s hover 15min permission 3min",
    ),
    _case(
        "down-from-hovering",
        RequirementSource.STATES,
        "an order to sink ends a hover",
        "10s hover 15min sink 5min",
    ),
    _case(
        "a-reset-hovering",
        RequirementSource.STATES,
        "a reset forgets a hover",
        "10s hover 15min brown_out 3h",
    ),
    _case(
        "nobody-comes",
        RequirementSource.STATES,
        "afloat for too long it sinks again",
        f"{_UP} 2h",
        whole=Whole(float_min=60),
    ),
    _case(
        "permission-prolongs-no-float",
        RequirementSource.STATES,
        "a permission afloat is refused, and it sinks when its time afloat is over",
        f"{_UP} {_wifi(CommandPacket(Kind.PERMISSION, 1))} 2h",
        whole=Whole(float_min=60),
        shows="motors sink",
    ),
    _case(
        "empties-while-it-hovers",
        RequirementSource.STATES,
        "the table: HOVERING takes BATTERY_EMPTIED",
        "10min hover 25min loses:90 loses:90 3h",
        shows="motors sink",
    ),
    _case(
        "sinks-on-order",
        RequirementSource.STATES,
        "an order sinks it from the surface",
        f"{_UP} {_SINK} 3min",
    ),
    _case(
        "sinks-when-told-after-its-dock",
        RequirementSource.STATES,
        "likewise after a release",
        f"{_RELEASED} {_SINK} 3min",
    ),
    _case("a-release-afloat", RequirementSource.STATES, "afloat a release sinks it", f"{_UP} release 3min"),
    _case(
        "sinks-on-its-way",
        RequirementSource.STATES,
        "an order sinks it on its way up",
        "3s permission 20s sink 3min",
    ),
    _case(
        "no-release-packet",
        RequirementSource.STATES,
        "without a release it sinks after 120 s",
        f"{_RELEASED} 10min",
    ),
    _case(
        "release-before-the-edge",
        RequirementSource.STATES,
        "docked, it sinks as soon as the pin has fallen",
        f"{_RELEASED_IN_A_REPORT} 20s falls 1min",
        shows="motors sink",
    ),
    _case(
        "bounces",
        RequirementSource.STATES,
        "a level counts once it held for 50 ms",
        f"{_UP} chatter:20:20:20 rises 1h",
    ),
    _case(
        "chatter-mostly-high",
        RequirementSource.STATES,
        "after 2 s of chatter the level of most of the time counts",
        f"{_UP} chatter:30:10:52 {_SINK} rises 1h",
    ),
    _case(
        "chatter-51-percent-high",
        RequirementSource.STATES,
        "the time up to the end of the 2 s counts, too",
        f"{_UP} chatter:41:41:25 {_SINK} rises 1h",
        is_near_tie=True,
    ),
    _case(
        "chatter-mostly-low",
        RequirementSource.STATES,
        "after 2 s of chatter the level of most of the time counts",
        f"{_UP} chatter:10:30:100 3min",
    ),
    _case(
        "missed-rise", RequirementSource.STATES, "a minute's look finds a lost edge", f"{_UP} rises_unseen 2h"
    ),
    _case("missed-fall", RequirementSource.STATES, "a look finds a lost edge", f"{_DOCKED} falls_unseen 2h"),
    _case(
        "slips",
        RequirementSource.STATES,
        "coils that slip and align charge on",
        f"{_DOCKED} slips 2h",
        primary=0.4,
    ),
    _case(
        "brown-out-docked",
        RequirementSource.STATES,
        "a reset in a dock charges on",
        f"{_DOCKED} brown_out 2h",
        primary=0.2,
    ),
    _case(
        "brown-out-afloat",
        RequirementSource.STATES,
        "a reset afloat floats on, for as long again",
        f"{_UP} 30min brown_out 2h",
        whole=Whole(float_min=60),
    ),
    _case(
        "reports-when-asked",
        RequirementSource.PACKETS,
        "the experiment's report is a full status",
        f"{_UP} 1h watchdog 1h",
        whole=Whole("hourly", report_min=10),
    ),
]
_LOG = [
    _case(
        "reports-docked",
        RequirementSource.PACKETS,
        "each wake in a dock reports by Wi-Fi",
        f"{_DOCKED} 3h",
        primary=0.3,
        shows=_sends(WifiStatus),
    ),
    _case(
        "uploads", RequirementSource.PACKETS, "a report brings the waiting records", f"{_MANY_SAMPLES} 50s"
    ),
    _case(
        "acknowledged",
        RequirementSource.PACKETS,
        "an acknowledgement brings the next records",
        f"{_REPORTING} {_wifi(LogAck(1, 72))} 1s {_wifi(LogAck(1, 98))} 5min",
    ),
    _case(
        "no-acknowledgement",
        RequirementSource.PACKETS,
        "unacknowledged records come again",
        f"{_REPORTING} 5min",
    ),
    _case(
        "an-acknowledgement-lost",
        RequirementSource.PACKETS,
        "the next report begins after what was acknowledged",
        f"{_REPORTING} {_wifi(LogAck(1, 18))} 5min",
    ),
    _case(
        "an-acknowledgement-twice",
        RequirementSource.PACKETS,
        "one of nothing new asks for the missing records",
        f"{_REPORTING} {_wifi(LogAck(1, 36))} 1s {_wifi(LogAck(1, 36))} 1s {_wifi(LogAck(1, 0))} 5min",
    ),
    _case(
        "acknowledgements-out-of-order",
        RequirementSource.PACKETS,
        "a late one takes nothing back",
        f"{_REPORTING} {_wifi(LogAck(1, 54))} 1s {_wifi(LogAck(1, 18))} 5min",
    ),
    _case(
        "never-taken",
        RequirementSource.PACKETS,
        "one of records that were never taken is refused",
        f"{_REPORTING} {_wifi(LogAck(1, 9999))} 5min",
    ),
    _case(
        "acknowledged-in-sleep",
        RequirementSource.PACKETS,
        "without Wi-Fi none is heard",
        f"{_MANY_SAMPLES} 20s {_wifi(LogAck(1, 72))} 5min",
    ),
    _case(
        "asked-for-its-log",
        RequirementSource.PACKETS,
        "BACK_UP_LOG sends what waits",
        f"3h permission 70s 1s {_ASKED} 1min",
    ),
    _case(
        "an-upload-keeps-it-awake",
        RequirementSource.STATES,
        "each acknowledgement prolongs the report",
        f"{_REPORTING} 8s {_wifi(LogAck(1, 18))} 9s {_wifi(LogAck(1, 36))} 5min",
    ),
    _case(
        "a-log-outlives-a-reset",
        RequirementSource.PACKETS,
        "no sequence is used twice",
        f"3s {_EACH_MINUTE} 30min brown_out 30min watchdog 30min permission 70s rises 5min",
    ),
    _case(
        "acknowledged-before-a-reset",
        RequirementSource.PACKETS,
        "acknowledged records stay so",
        f"{_REPORTING} {_wifi(LogAck(1, 72))} 1s brown_out 5min",
    ),
    _case(
        "a-full-ring",
        RequirementSource.PACKETS,
        "the oldest page is overwritten, and counted; what waits has no record that is gone",
        f"3s {_EACH_MINUTE} 45h {_EACH_WAKE_S_SLOT} 3min permission 70s rises 48s {_wifi(LogAck(1, 2690))} 2min"
        " brown_out 3min",
        shows=_sends(WifiStatus, acknowledged=2690, overwritten=0),
    ),
    _case(
        "the-newest-counts-outlive-a-reset",
        RequirementSource.PACKETS,
        "after a reset the board finds the newest record, and reports its counts",
        f"3s {_EACH_MINUTE} 10min permission 70s rises 10s brown_out 3min",
        shows=_sends(WifiStatus, samples=8),
    ),
]
_FAULTS = [
    _case(
        "a-silent-sensor",
        RequirementSource.CHOICE,
        "a sensor that does not answer repeats its last counts",
        f"3s {_EACH_MINUTE} 10min bus:1 10min bus:0 {_UPLOADED}",
    ),
    _case(
        "a-torn-write",
        RequirementSource.PACKETS,
        "a torn record is left out of an upload, and no other",
        f"3s {_EACH_MINUTE} 10min writes:10 2min writes:0 {_UPLOADED}",
    ),
    _case(
        "a-write-torn-to-a-byte",
        RequirementSource.PACKETS,
        "a torn record is left out of an upload, and no other",
        f"3s {_EACH_MINUTE} 10min writes:1 1min writes:0 {_UPLOADED}",
    ),
    _case(
        "worn-cells",
        RequirementSource.PACKETS,
        "a record whose check is wrong is left out of an upload",
        f"3s {_EACH_MINUTE} 10min cells:16 5min cells:0 {_UPLOADED}",
    ),
    *(
        _case(
            f"a-brown-out-after-{size}-bytes",
            RequirementSource.PACKETS,
            "a record that a reset tore is counted, and its sequence is not used again",
            f"3s {_EACH_MINUTE} 10min supply:{size} {_UPLOADED}",
        )
        for size in (1, 10, 23, 24)
    ),
    _case(
        "torn-at-a-page-s-edge",
        RequirementSource.PACKETS,
        "a page whose first record is torn goes on with the next one",
        f"3s {_EACH_MINUTE} 172min supply:10 {_UPLOADED}",
    ),
    _case(
        "torn-before-every-whole-one",
        RequirementSource.PACKETS,
        "every torn record is counted, the flash's first one, too",
        f"3s {_EACH_MINUTE} writes:10 130s writes:0 10min brown_out 5min permission 70s rises 3min",
        shows=_sends(WifiStatus, torn=1),
    ),
    _case(
        "torn-twice-at-a-page-s-edge",
        RequirementSource.PACKETS,
        "a page whose first records are torn goes on with the next one",
        f"3s {_EACH_MINUTE} 172min writes:10 2min writes:0 5min brown_out 5min {_UPLOADED}",
    ),
    _case(
        "written-at-a-page-s-edge",
        RequirementSource.PACKETS,
        "a record that a reset left whole keeps its sequence",
        f"3s {_EACH_MINUTE} 172min supply:24 {_UPLOADED}",
    ),
    _case(
        "torn-again-and-again",
        RequirementSource.PACKETS,
        "every torn record is counted",
        f"3s {_EACH_MINUTE} 10min supply:10 5min supply:20 5min supply:5 {_UPLOADED}",
    ),
    _case(
        "an-overrun",
        RequirementSource.PACKETS,
        "bytes that are no packet are dropped",
        "3s uart:4 permission ping 1min uart:0 ping 1min permission 3min",
    ),
    _case(
        "readings-with-noise",
        RequirementSource.PACKETS,
        "a status has the batteries' readings",
        "3s readings:5 3h readings:0 2h",
        whole=_FIELD,
    ),
]
_EMERGENCY = [
    *(
        _case(
            name,
            RequirementSource.STATES,
            requirement,
            script,
            whole=whole,
            counts_refusals=True,
            shows=shows,
        )
        for name, requirement, script, whole, shows in (
            (
                "calls-from-now-on",
                "it calls at its safe level, and again every 10 min",
                "10s loses:100 45min",
                _LOW_CALLS,
                "state CALLING",
            ),
            (
                "calls-while-told-to-stay-down",
                "an order to sink forbids no call",
                "10s permission 20s sink 2min loses:100 1h",
                _LOW_CALLS,
                "state CALLING",
            ),
            (
                "a-dock-ends-its-calls",
                "it calls every 10 min until a charger was there, and then anew",
                "10s loses:100 1min permission 70s rises 20s falls 1s release 30min",
                _LOW_CALLS,
                "state CALLING",
            ),
            (
                "a-touch-of-a-charger-between-calls",
                "a level of the pin that did not hold ends no calls",
                "10s loses:100 1min permission 70s rises 30ms falls 1s release 30min",
                _LOW_CALLS,
                "state CALLING",
            ),
            (
                "calls-after-a-reset",
                "a reset forgets the last call",
                "10s loses:100 3min brown_out 25min",
                _LOW_CALLS,
                "state CALLING",
            ),
            (
                "fetched-between-two-calls",
                "between two calls it takes a permission",
                "10s loses:100 5min permission 70s rises 10min falls 5min",
                _LOW_CALLS,
                "state CHARGING",
            ),
            (
                "surfaces-from-now-on",
                "after a last resort it does not sink again by itself",
                "10s loses:100 3h",
                replace(_LOW_SURFACES, float_min=60),
                "state FLOATING",
            ),
            (
                "a-last-resort-told-to-sink",
                "an order sinks one that came up by itself, and it stays down",
                f"10s loses:100 5min {_SINK} 3h",
                _LOW_SURFACES,
                "motors sink",
            ),
            (
                "a-permission-leaves-the-order-to-stay",
                "for 6 h after an order to sink no last resort brings it up, but a permission does",
                "10s permission 20s sink 2min permission 70s release 2min loses:100 7h",
                _LOW_SURFACES,
                "state EMPTY",
            ),
            (
                "an-order-to-stay-prolonged",
                "the newest order to sink counts",
                "10s permission 20s sink 3h permission 20s sink 2min loses:100 7h",
                _LOW_SURFACES,
                "state EMPTY",
            ),
            (
                "a-reset-forgets-the-order-to-stay",
                "a reset forgets an order to stay down",
                "10s permission 20s sink 2min brown_out 10s loses:100 1h",
                _LOW_SURFACES,
                "state FLOATING",
            ),
            (
                "a-sink-refused-is-no-order-to-stay",
                "a refused order is not kept",
                "10s sink 10s loses:100 1h",
                _LOW_SURFACES,
                "state FLOATING",
            ),
            (
                "does-not-come-up-at-last",
                "a last resort that does not come up runs its motors back, counts it, and tries again",
                "10s jam:1 loses:100 30min",
                _LOW_SURFACES,
                "motors sink",
            ),
            (
                "works-on-below-the-safe-level",
                "without a last resort a secondary in use works on until it is empty",
                "10s loses:100 3h",
                Whole("field", 0.19, secondary_in_use=True),
                _sends(AcousticStatus),
            ),
            (
                "a-reserve-below-the-safe-level",
                "with a last resort a secondary in use is EMPTY from the safe level on",
                "10s loses:100 3h",
                Whole("field", 0.19, last_resort=LastResort.CALL, secondary_in_use=True),
                "state CALLING",
            ),
            (
                "waits-at-its-safe-level",
                "it may do nothing at its safe level",
                "10s loses:100 1h",
                Whole("hourly", 0.19),
                "state EMPTY",
            ),
            (
                "another-safe-level-while-empty",
                "a threshold counts from now on",
                f"10s loses:100 20min {_sound(SetThreshold(1, Threshold.SAFE_LEVEL, 0.9))} 1h",
                Whole("hourly", 0.8, last_resort=LastResort.CALL),
                "state CALLING",
            ),
            (
                "a-threshold-in-a-boot",
                "a booting board stores settings all the same",
                f"10s brown_out 1s {_sound(SetThreshold(1, Threshold.SAFE_LEVEL, 0.9))} 10s loses:100 1h",
                Whole("hourly", 0.8, last_resort=LastResort.CALL),
                "state CALLING",
            ),
            (
                "no-low-level",
                "a low level of 0 is none",
                f"3s {_sound(SetThreshold(1, Threshold.LOW_LEVEL, 0.0))} 2min loses:30 30min",
                Whole("field", low_level=0.8),
                "state SLEEPING",
            ),
            (
                "never-sleeping-through-a-day",
                "a board that never sleeps refuses every schedule, and transmits in no slot",
                f"10s {_EACH_MINUTE} {_SLOT_7} 2h permission 70s rises 2h falls 1s release 5min hover 15min sink 5min"
                " ping 5min",
                _NEVER,
                "motors hover",
            ),
        )
    ),
    _case("empties", RequirementSource.STATES, "an empty one measures nothing", "8h", primary=0.005),
    _case(
        "empty-and-fetched",
        RequirementSource.STATES,
        "an empty one takes a permission",
        "2h permission 70s rises 3h",
        primary=0.005,
    ),
    _case(
        "works-on-both",
        RequirementSource.PAPER,
        "IV-A: actively using the secondary doubles the deployment",
        "6h",
        whole=Whole("field", 0.9, secondary_in_use=True),
        primary=0.005,
        shows=_sends(AcousticStatus, samples=5),
    ),
    _case(
        "keeps-a-reserve",
        RequirementSource.STATES,
        "with a last resort a secondary in use is spared from the safe level on",
        "5h",
        whole=Whole("field", 0.21, last_resort=LastResort.CALL, secondary_in_use=True),
        primary=0.005,
        tolerance_ms=_LEVEL_MS,
        shows="state CALLING",
    ),
    _case(
        "waits",
        RequirementSource.STATES,
        "at its safe level it may wait",
        "12h",
        whole=Whole("hourly", 0.21),
        primary=0.005,
    ),
    _case(
        "calls",
        RequirementSource.STATES,
        "at its safe level it may call, every 10 min",
        "30h",
        whole=_CALLS,
        primary=0.005,
        tolerance_ms=_LEVEL_MS,
    ),
    _case(
        "surfaces-at-last",
        RequirementSource.STATES,
        "at its safe level it may surface",
        "40h",
        whole=_SURFACES,
        primary=0.005,
        tolerance_ms=_LEVEL_MS,
    ),
    _case(
        "a-last-resort-ends-in-a-dock",
        RequirementSource.STATES,
        "once charged it sinks again after its time afloat",
        "4h rises 350min falls 1s release 10min permission 70s 2h",
        whole=replace(_SURFACES, float_min=60),
        primary=0.005,
        tolerance_ms=_LEVEL_MS,
    ),
    _case(
        "stays-down-when-told",
        RequirementSource.STATES,
        "for 6 h after an order to sink no last resort brings it up",
        "2h permission 20s sink 1s 40h",
        whole=Whole("hourly", 0.2101, last_resort=LastResort.SURFACE),
        primary=0.005,
    ),
    _case(
        "both-empty",
        RequirementSource.STATES,
        "without charge it answers nothing",
        "20h ping 1min",
        whole=Whole("never", 0.005),
        primary=0.005,
    ),
    _case(
        "boots-when-fed",
        RequirementSource.STATES,
        "without power no code runs, and a charger's feed boots it",
        f"{_UP} 30min rises 20min falls 5min",
        whole=Whole("never", 0.01, report_min=13),
        primary=0.04,
    ),
    _case(
        "back-on-its-primary",
        RequirementSource.STATES,
        "a dock switches it back at 10 %",
        "2h permission 70s rises 5h",
        primary=0.005,
    ),
    _case(
        "low-level",
        RequirementSource.STATES,
        "at its low level it wakes once",
        "3h",
        whole=Whole("field", low_level=0.5),
        primary=0.502,
        tolerance_ms=_LOW_LEVEL_MS,
    ),
    _case(
        "low-level-while-it-listens",
        RequirementSource.STATES,
        "the low level wakes a sleeping board alone",
        f"3s {_sound(SetThreshold(1, Threshold.LOW_LEVEL, 0.98))} loses:20 3min",
        shows="state SLEEPING",
    ),
    _case(
        "another-low-level",
        RequirementSource.PACKETS,
        "a threshold is set by a packet",
        f"3s {_sound(SetThreshold(1, Threshold.LOW_LEVEL, 0.8))} 3h",
        whole=Whole("field", low_level=0.1),
        primary=0.802,
        tolerance_ms=_LOW_LEVEL_MS,
    ),
    _case(
        "another-safe-level",
        RequirementSource.PACKETS,
        "a threshold is set by a packet",
        f"3s {_sound(SetThreshold(1, Threshold.SAFE_LEVEL, 0.5))} 30h",
        whole=Whole("hourly", 0.51, last_resort=LastResort.CALL),
        primary=0.005,
        tolerance_ms=_LEVEL_MS,
    ),
    _case(
        "another-switch-back",
        RequirementSource.PACKETS,
        "a threshold is set by a packet, and kept",
        f"3s {_sound(SetThreshold(1, Threshold.SWITCH_BACK, 0.3))} 1min brown_out 2h permission 70s rises 5h",
        primary=0.005,
    ),
    _case(
        "metered",
        RequirementSource.STATES,
        "a run of its motors does not look empty",
        f"{_UP} release 4h",
        whole=Whole("field", metered=True),
        primary=0.15,
    ),
    _case(
        "metered-and-empty",
        RequirementSource.STATES,
        "a voltage that stays low is empty",
        "8h",
        whole=Whole("field", metered=True),
        primary=0.01,
    ),
]
_UNEVEN = Whole(uneven=True)
_LATE_UP = "6s permission 70s"
"""It floats, after a boot of 5 s."""
_TIMES = [
    _case(
        f"other-times-{name}",
        RequirementSource.STATES,
        f"the scenario's times: {requirement}",
        script,
        whole=whole,
        primary=primary,
        tolerance_ms=_LEVEL_MS if whole.last_resort is LastResort.CALL else 20,
        is_near_tie=name == "of-an-edge",
        shows=shows,
    )
    for name, requirement, script, whole, primary, shows in (
        (
            "of-a-wake",
            "listening, sensors, the Pi, the slot and its guard",
            "4h",
            _UNEVEN,
            1.0,
            _sends(AcousticStatus),
        ),
        ("of-a-report", "a report's length", f"{_LATE_UP} rises 3h", _UNEVEN, 0.3, _sends(WifiStatus)),
        (
            "of-an-upload",
            "its length after an acknowledgement",
            f"6s {_EACH_MINUTE} 100min permission 70s rises 45s {_wifi(LogAck(1, 18))} 2min",
            _UNEVEN,
            1.0,
            _sends(LogRecords, first=18),
        ),
        ("of-a-boot", "a boot", "4s permission 2s permission 3min", _UNEVEN, 1.0, "motors float"),
        (
            "of-a-release",
            "the wait for a release",
            f"{_LATE_UP} rises 10min falls 10min",
            _UNEVEN,
            1.0,
            "motors sink",
        ),
        (
            "of-an-edge",
            "the debounce",
            f"{_LATE_UP} rises 79ms falls 1min rises 81ms falls 10min",
            _UNEVEN,
            0.4,
            "state CHARGING",
        ),
        (
            "of-a-chatter",
            "a chatter",
            f"{_LATE_UP} chatter:60:10:46 {_SINK} rises 1h",
            _UNEVEN,
            0.4,
            "state CHARGING",
        ),
        (
            "of-a-check",
            "the look for a lost edge",
            f"{_LATE_UP} rises_unseen 10min falls_unseen 10min",
            _UNEVEN,
            0.4,
            "state RELEASED",
        ),
        ("of-a-hover", "the time between two runs", "10s hover 1h", _UNEVEN, 1.0, "motors hover"),
        (
            "of-an-answer",
            "turnaround and answer",
            "10min ping 5min ping 650ms ping 5min",
            _UNEVEN,
            1.0,
            _sends(ShortStatus),
        ),
        (
            "of-a-call",
            "the time between two calls",
            "10h",
            replace(_CALLS, uneven=True),
            0.005,
            "state CALLING",
        ),
        (
            "of-an-order-to-stay",
            "no last resort after an order to sink",
            "2h permission 20s sink 1s 20h",
            replace(_SURFACES, uneven=True),
            0.005,
            "state FLOATING",
        ),
    )
]
_REPORTS_AND_LIMITS = [
    _case(
        "both-charges-told",
        RequirementSource.PACKETS,
        "a status has both charges",
        f"10s ping 2h ping {_UPLOADED}",
        whole=Whole("field", 0.7),
        primary=0.4,
        shows=_sends(ShortStatus),
    ),
    _case(
        "reports-through-a-service",
        RequirementSource.PACKETS,
        "a report has the state, the feed, the rails and the reset's cause",
        f"{_UP} watchdog 60s rises 10min falls 50s release 3min",
        whole=Whole("field", 0.8, report_min=1),
        primary=0.6,
        shows=_sends(WifiStatus, reset_cause=ResetCause.WATCHDOG),
    ),
    _case(
        "reports-on-its-backup",
        RequirementSource.PACKETS,
        "a report has the battery that feeds the board",
        "3h permission 70s rises 3h",
        whole=Whole("hourly", report_min=7),
        primary=0.005,
        shows=_sends(WifiStatus, feed=ActiveBattery.SECONDARY),
    ),
    *(
        _case(
            f"reports-a-clock-{told}",
            RequirementSource.PACKETS,
            "a report has the clock minus the last beacon, and 0 after a reset",
            f"10min {_sound(Beacon(1, 600_000 - offset_ms))} {_UPLOADED} 1h brown_out 1h",
            shows=_sends(WifiStatus, clock_offset_ms=offset_ms),
        )
        for told, offset_ms in (("ahead", 70_000), ("behind", -300))
    ),
    _case(
        "a-year-behind",
        RequirementSource.PACKETS,
        "an offset beyond an i32 is told as the nearest one",
        f"10min {_sound(Beacon(1, 40_000_000_000))} {_UPLOADED} 1h",
        shows=_sends(WifiStatus, clock_offset_ms=-(1 << 31)),
    ),
    _case(
        "beyond-a-sensor-s-range",
        RequirementSource.PACKETS,
        "a sample beyond a sensor's range is marked",
        f"90min {_UPLOADED} 1h",
        whole=Whole("field", turbid=True),
        shows=lambda it: isinstance(it, LogRecords) and any(record.saturated for record in it.records),
    ),
    _case(
        "a-short-modem",
        RequirementSource.PACKETS,
        "a v2 nanomodem carries 7 bytes",
        "80min",
        whole=Whole("field", short_modem=True),
    ),
]
_PACKETS = [
    _case(
        "every-bit-flipped",
        RequirementSource.PACKETS,
        "the CRC detects every single bit error",
        f"10s {by_sound([it for command in EVERY_COMMAND for it in damages(command.encode())])} 2h ping {_UPLOADED}",
        whole=_FIELD,
    ),
    _case(
        "every-layout",
        RequirementSource.PACKETS,
        "version, kind and size belong together",
        f"10s {by_sound(UNKNOWN_LAYOUTS)} 2h ping {_UPLOADED}",
        whole=_FIELD,
    ),
    replace(
        _case(
            "counts-what-it-refuses",
            RequirementSource.PACKETS,
            "a board counts what it does not use",
            f"10s {by_sound([damages(CommandPacket(Kind.PING, 1).encode())[9], b'short'])}"
            f" {_sound(CommandPacket(Kind.PING, 2))} {_sound(SleepSchedule(1, 20_000, 150_000))} {_sound(HoverAt(1, 0.0))}"
            f" {_sound(CommandPacket(Kind.BACK_UP_LOG, 1))} {_sound(CommandPacket(Kind.RELEASE, 1))} 1min",
        ),
        counts_refusals=True,
    ),
    _case(
        "every-layout-afloat",
        RequirementSource.PACKETS,
        "version, kind and size belong together",
        f"{_UP} {by_sound(UNKNOWN_LAYOUTS).replace('sound:', 'wifi:')} 3min",
    ),
    _case(
        "for-all",
        RequirementSource.PACKETS,
        "id 0 addresses all",
        f"10s {_sound(CommandPacket(Kind.HOVER, EVERYONE))} 15min {_sound(CommandPacket(Kind.SINK, EVERYONE))} 5min"
        f" {_sound(CommandPacket(Kind.PERMISSION, EVERYONE))} 70s {_wifi(CommandPacket(Kind.RELEASE, EVERYONE))} 3min",
    ),
    replace(
        _case(
            "with-the-id-300",
            RequirementSource.PACKETS,
            "an id has two bytes",
            " ".join(
                [
                    "10s",
                    *(_sound(CommandPacket(Kind.HOVER, it)) for it in (1, 44, 257, 300 << 8 & 0xFFFF)),
                    f"1min {_sound(CommandPacket(Kind.PING, 300))} 1min",
                    f"{_sound(CommandPacket(Kind.PERMISSION, 300))} 70s rises 2h",
                ]
            ),
            whole=_FIELD,
        ),
        agent_id=300,
    ),
    _case(
        "numbers-of-four-bytes",
        RequirementSource.PACKETS,
        "frame, slot and offset have four bytes, guard and index two",
        f"3s {_sound(SlotAssignment(1, 30_000_000, 90_000, 700, 300, -70_000))} 20h",
        whole=_FIELD,
        tolerance_ms=_SLOT_MS,
    ),
    _case(
        "a-wake-of-two-minutes",
        RequirementSource.PACKETS,
        "the length of a wake has four bytes",
        f"3s {_sound(SleepSchedule(1, 900_000, 120_000))} 4h",
        whole=_FIELD,
    ),
    _case(
        "in-the-last-slot",
        RequirementSource.PACKETS,
        "a timeslot may end with its frame",
        f"3s {_sound(SlotAssignment(1, 60_000, 4000, 1500, 14, 0))} 3h",
        whole=_FIELD,
        tolerance_ms=_SLOT_MS,
    ),
    *(
        _case(f"a-slot-{name}", source, requirement, f"3s {_sound(slot)} 3h", whole=_FIELD)
        for name, source, requirement, slot in (
            (
                "of-no-time",
                RequirementSource.PACKETS,
                "a timeslot without time is refused",
                SlotAssignment(1, 300_000, 0, 0, 0, 0),
            ),
            (
                "beyond-by-one",
                RequirementSource.PACKETS,
                "a timeslot beyond its frame is refused",
                SlotAssignment(1, 59_999, 4000, 1500, 14, 0),
            ),
            (
                "beyond-32-bits",
                RequirementSource.PACKETS,
                "a timeslot beyond its frame is refused, also where its end has more than 32 bits",
                SlotAssignment(1, 300_000, 65_536, 500, 65_535, 0),
            ),
            (
                "with-a-long-guard",
                RequirementSource.PACKETS,
                "a guard as long as its timeslot is refused",
                SlotAssignment(1, 60_000, 4000, 4000, 3, 0),
            ),
        )
    ),
    *(
        _case(f"a-schedule-{name}", source, requirement, f"3s {_sound(schedule)} 3h", whole=_FIELD)
        for name, source, requirement, schedule in (
            (
                "of-no-time",
                RequirementSource.PACKETS,
                "a period without time is refused",
                SleepSchedule(1, 0, 0),
            ),
            (
                "without-a-wake",
                RequirementSource.PACKETS,
                "a wake of no time is refused",
                SleepSchedule(1, 600_000, 0),
            ),
            (
                "of-wakes-alone",
                RequirementSource.PACKETS,
                "a wake as long as its period is refused",
                SleepSchedule(1, 600_000, 600_000),
            ),
        )
    ),
    *(
        _case(
            f"a-level-of-number-{which}",
            RequirementSource.PACKETS,
            "a threshold is one of three",
            f"3s sound:{sealed(bytes([2, 9, 1, 0, which, 255, 200])).hex()} {_UPLOADED}",
            whole=Whole("field", 0.5, low_level=0.5),
            primary=0.502,
            tolerance_ms=_LOW_LEVEL_MS,
        )
        for which in (3, 255)
    ),
    *(
        _case(
            f"a-beacon-{name}",
            RequirementSource.PACKETS,
            "the latest time that a beacon may tell is 2^53 ms",
            f"10s {_sound(Beacon(1, (1 << 53) + by_ms))} 90min",
            whole=_FIELD,
        )
        for name, by_ms in (("of-the-latest-time", 0), ("too-late-by-one", 1))
    ),
    _case(
        "hovers-at-12.75-m",
        RequirementSource.PACKETS,
        "a depth has steps of 0.25 m",
        f"10s {_sound(HoverAt(1, 12.75))} 25min",
    ),
    _case(
        "hovers-at-another-depth",
        RequirementSource.STATES,
        "a hovering one takes another depth",
        f"10s {_sound(HoverAt(1, 1.25))} 15min {_sound(HoverAt(1, 2.0))} 25min",
    ),
    *(
        _case(name, RequirementSource.PACKETS, requirement, script, shows=shows)
        for name, requirement, script, shows in (
            (
                "hovers-here-after-a-depth",
                "HOVER 5 v1: hold the depth where it is",
                f"3s {_sound(HoverAt(1, 1.25))} 5min hover 25min",
                "motors hover",
            ),
            (
                "hovers-here-after-another-dive",
                "HOVER 5 v1: hold the depth where it is",
                f"3s {_sound(HoverAt(1, 1.25))} 5min permission 70s release 5min hover 25min",
                "motors hover",
            ),
            (
                "hovers-here-after-a-reset",
                "a reset forgets the depth to hover at",
                f"3s {_sound(HoverAt(1, 1.25))} 5min brown_out 10s hover 25min",
                "motors hover",
            ),
            (
                "hovers-at-the-least-depth",
                "a depth of 0 is refused, and 0.25 m are none",
                f"10s {_sound(HoverAt(1, 0.25))} 25min permission 3min",
                "motors hover at 0.25 m",
            ),
            (
                "hovers-at-the-most",
                "a depth is a u8 in steps of 0.25 m",
                f"10s {_sound(HoverAt(1, 63.75))} 15min",
                "motors hover at 63.75 m",
            ),
            (
                "a-depth-for-another-state",
                "the depth of an order that was refused is not used",
                f"3s permission 20s {_sound(HoverAt(1, 1.25))} 10s sink 5min hover 15min",
                "motors hover",
            ),
        )
    ),
    _case(
        "a-hover-refused-is-forgotten",
        RequirementSource.STATES,
        "the depth of an order that was refused is not used",
        f"10s hover 5min {_sound(HoverAt(1, 0.0))} 25min",
    ),
]
_ROUND = [
    _case(
        "does-not-come-up",
        RequirementSource.STATES,
        "one that does not come up in 180 s runs its motors back",
        "10s jam:1 permission 10min jam:0 permission 3min",
    ),
    _case(
        "comes-up-late",
        RequirementSource.STATES,
        "179 s are in time",
        "10s jam:1 permission 118s jam:0 10min",
    ),
    _case(
        "a-release-is-used-once",
        RequirementSource.STATES,
        "a release belongs to one docking",
        f"{_RELEASED_IN_A_REPORT} 20s falls 3min permission 70s rises 1min falls 10min",
        shows="motors sink",
    ),
    _case(
        "release-forgotten",
        RequirementSource.STATES,
        "a reset forgets a release",
        f"{_RELEASED_IN_A_REPORT} brown_out 1min falls 10min",
        shows="state RELEASED",
    ),
    _case(
        "a-touch",
        RequirementSource.STATES,
        "a touch of 49 ms charges nothing",
        f"{_UP} rises 49ms falls 1h",
        primary=0.4,
    ),
    _case(
        "a-gap",
        RequirementSource.STATES,
        "a gap of 49 ms ends no docking",
        f"{_DOCKED} falls 49ms rises 1h falls 1s release 2min",
        primary=0.4,
    ),
    _case(
        "chatter-that-turns",
        RequirementSource.STATES,
        "each 2 s of chatter are judged by themselves",
        f"{_UP} chatter:30:10:100 chatter:10:30:200 3min",
        primary=0.4,
    ),
    *(
        _case(
            f"chatter-{percent}-percent-high",
            RequirementSource.STATES,
            "after 2 s of chatter the level of most of the time counts",
            f"{_UP} chatter:{high_ms}:{50 - high_ms}:80 {_SINK} 3min",
            primary=0.4,
        )
        for percent, high_ms in ((40, 20), (60, 30))
    ),
    _case(
        "two-spells-of-chatter",
        RequirementSource.STATES,
        "a level that held ends a chatter, and its time counts no more",
        f"{_UP} chatter:30:10:40 1s chatter:20:28:50 3min",
        primary=0.4,
    ),
    _case(
        "a-fall-missed-in-a-rise",
        RequirementSource.STATES,
        "a level that did not hold for 50 ms counts for nothing",
        f"{_UP} rises 30ms falls_unseen 10min",
        primary=0.4,
    ),
    _case(
        "a-wake-finds-it",
        RequirementSource.STATES,
        "a wake finds a lost edge",
        "3s rises_unseen 1s permission 200ms 1h",
        primary=0.4,
    ),
    _case(
        "a-sampling-finds-it",
        RequirementSource.STATES,
        "the begin of SAMPLING is a wake, and finds a lost edge",
        f"3s {_sound(SleepSchedule(1, 90_000, 10_000))} 1337s rises_unseen 30s",
        primary=0.4,
        shows="state CHARGING",
    ),
    *(
        _case(
            f"{name}-finds-it",
            RequirementSource.STATES,
            f"the begin of {begins.name} is a wake, and finds a lost edge",
            script,
            whole=whole,
            primary=0.4,
            shows="state CHARGING",
        )
        for name, begins, script, whole in (
            ("a-boot", State.ACTIVE, "1s rises_unseen 55s", _HOURLY),
            ("a-surface", State.FLOATING, "3s permission 58s rises_unseen 50s", _HOURLY),
            ("a-way-down", State.SINKING, f"{_UP} rises_unseen 1s {_SINK} 40s", _HOURLY),
            ("the-pi", State.PROCESSING, "3605s rises_unseen 50s", _FIELD),
            ("a-hover", State.HOVERING, "10s rises_unseen 1s hover 45s", _HOURLY),
        )
    ),
    _case(
        "a-look-after-a-reset",
        RequirementSource.PORT,
        "the look for a lost edge comes at each whole minute of the counter, also after a reset",
        "10s brown_out 20s rises_unseen 35s",
        primary=0.4,
        shows="state CHARGING",
    ),
    _case(
        "a-rise-missed-in-a-touch",
        RequirementSource.STATES,
        "an edge that is unseen within the 50 ms is found at their end, and its level counts 50 ms later",
        f"{_UP} rises 20ms falls 10ms rises_unseen 40s",
        primary=0.4,
        shows="state CHARGING",
    ),
    _case(
        "a-look-while-it-debounces",
        RequirementSource.STATES,
        "a whole minute's look finds a lost edge also while a level is to hold",
        f"{_UP} 46980ms rises 10ms falls_unseen 20ms rises_unseen 10min",
        primary=0.4,
        is_near_tie=True,
        shows="state CHARGING",
    ),
    _case(
        "a-first-slot-in-its-wake",
        RequirementSource.STATES,
        "a board that had no slot transmits the first time at the end of a wake under way",
        f"3603s {_SLOT_7} 3h",
        tolerance_ms=_SLOT_MS,
        shows=lambda it: isinstance(it, AcousticStatus) and it.agent_ms < 4_000_000,
    ),
    _case(
        "undocked-in-a-boot",
        RequirementSource.STATES,
        "a pin that fell in a boot releases",
        f"{_DOCKED} brown_out 1s falls 10min",
    ),
    _case(
        "docked-in-a-boot",
        RequirementSource.STATES,
        "a pin that rose in a boot docks",
        f"{_UP} brown_out 1s rises 2h",
    ),
    _case(
        "a-timeslot-in-its-wake",
        RequirementSource.PACKETS,
        "a timeslot counts from now on",
        f"3800s {_SLOT_7} 2h",
        whole=_FIELD,
    ),
    _case(
        "a-schedule-in-its-wake",
        RequirementSource.PACKETS,
        "a schedule counts from now on",
        f"3605s {_EACH_MINUTE} 1h",
        whole=_FIELD,
    ),
    _case(
        "a-schedule-in-a-dock",
        RequirementSource.PACKETS,
        "a schedule counts from now on",
        f"{_DOCKED} {_wifi(SleepSchedule(1, 600_000, 10_000))} 50min {_wifi(SleepSchedule(1, 600_000, 10_000))} 1h",
    ),
    _case(
        "a-beacon-that-puts-off-its-slot",
        RequirementSource.STATES,
        "timeslots follow the clock as it is",
        "3800s beacon:3650000 1h",
        whole=_FIELD,
    ),
    _case(
        "a-beacon-past-its-slot",
        RequirementSource.STATES,
        "timeslots follow the clock as it is",
        "3800s beacon:3950000 1h",
        whole=_FIELD,
    ),
    _case(
        "in-doubt-after-an-hour",
        RequirementSource.STATES,
        "the error of the clock at the timeslot counts, since the last beacon",
        f"3s {_SLOT_7} 55min beacon:3303000 5h beacon:21303000 2h",
        whole=Whole("field", doubt_ppm=40),
    ),
]
_UPLOADS = [
    _case(
        "never-taken-by-one",
        RequirementSource.PACKETS,
        "one of records that were never taken is refused",
        f"{_REPORTING} {_wifi(LogAck(1, 99))} 61s {_wifi(LogAck(1, 98))} 5min",
        shows=_sends(WifiStatus, acknowledged=98),
    ),
    _case(
        "asked-in-its-dock",
        RequirementSource.PACKETS,
        "BACK_UP_LOG sends what waits, and prolongs the report",
        f"{_REPORTING} 8s {_ASKED} 5min",
    ),
    _case(
        "asked-in-its-sleep",
        RequirementSource.PACKETS,
        "without Wi-Fi none is heard",
        f"{_MANY_SAMPLES} 20s {_ASKED} 5min",
    ),
    _case(
        "acknowledged-afloat",
        RequirementSource.PACKETS,
        "afloat its Wi-Fi is on",
        f"3s {_EACH_MINUTE} 100min permission 70s {_ASKED} 1s {_wifi(LogAck(1, 72))} 1min",
    ),
    _case(
        "acknowledged-when-released",
        RequirementSource.PACKETS,
        "released, its Wi-Fi is on",
        f"{_REPORTING} falls 1s {_wifi(LogAck(1, 72))} 1s {_ASKED} 1min",
    ),
    _case(
        "acknowledged-in-parts",
        RequirementSource.PACKETS,
        "then as many records as are acknowledged",
        f"{_REPORTING} {_wifi(LogAck(1, 5))} 1s {_wifi(LogAck(1, 41))} 1s {_wifi(LogAck(1, 90))} 5min",
    ),
    _case(
        "asked-after-an-acknowledgement",
        RequirementSource.PACKETS,
        "it sends what waits",
        f"{_REPORTING} {_wifi(LogAck(1, 54))} 1s {_ASKED} 5min",
    ),
    _case(
        "samples-after-an-upload",
        RequirementSource.PACKETS,
        "records keep their sequence through a service",
        f"{_REPORTING} {_wifi(LogAck(1, 98))} 5min falls 1s {_SINK} 30min permission 70s rises 5min",
    ),
    _case(
        "a-full-ring-acknowledged",
        RequirementSource.PACKETS,
        "what the ring overwrote is counted until more is acknowledged",
        f"3s {_EACH_MINUTE} 50h permission 70s rises 2min {_wifi(LogAck(1, 300))} 1s {_wifi(LogAck(1, 2900))} 5min",
    ),
    _case(
        "a-full-ring-outlives-a-reset",
        RequirementSource.PACKETS,
        "after a reset the board finds the newest record by its sequence",
        f"3s {_EACH_MINUTE} 50h brown_out 10min permission 70s rises 5min",
    ),
    _case(
        "a-reset-at-a-page-s-edge",
        RequirementSource.PACKETS,
        "after a reset the board finds the newest record by its sequence",
        f"3s {_EACH_MINUTE} 170min brown_out 5min {_UPLOADED}",
    ),
    _case(
        "two-resets",
        RequirementSource.PACKETS,
        "no sequence is used twice",
        f"3s {_EACH_MINUTE} 10min supply:10 10min brown_out 10min watchdog {_UPLOADED}",
    ),
    _case(
        "a-flash-that-does-not-answer",
        RequirementSource.CHOICE,
        "its samples are gone, and counted",
        f"3s {_EACH_MINUTE} 10min flash:1 5min flash:0 {_UPLOADED}",
    ),
    _case(
        "a-flash-that-does-not-answer-in-a-boot",
        RequirementSource.PACKETS,
        "all samples ever taken count as torn, and their number outlives it",
        f"3s {_EACH_MINUTE} 10min flash:1 brown_out 5min flash:0 {_UPLOADED}",
    ),
]
WAYS_INTO: dict[State, tuple[Whole, float, str]] = {
    State.BOOTING: (_FIELD, 1.0, "1s"),
    State.ACTIVE: (_FIELD, 1.0, "10s"),
    State.SLEEPING: (_FIELD, 1.0, "10min"),
    State.SAMPLING: (_FIELD, 1.0, "3605s"),
    State.PROCESSING: (_FIELD, 1.0, "3640s"),
    State.AWAITING_SLOT: (_FIELD, 1.0, "3800s"),
    State.TRANSMITTING: (_FIELD, 1.0, "3900s 300ms"),
    State.AWAITING_BEACON: (Whole("field", doubt_ppm=500), 1.0, "3h 75s"),
    State.SURFACING: (_FIELD, 1.0, "3s permission 20s"),
    State.FLOATING: (_FIELD, 1.0, _UP),
    State.CHARGING: (_FIELD, 0.5, _DOCKED),
    State.REPORTING: (_FIELD, 0.5, f"{_UP} rises 3550s"),
    State.RELEASED: (_FIELD, 1.0, _RELEASED),
    State.SINKING: (_FIELD, 1.0, f"{_RELEASED} release 20s"),
    State.HOVERING: (_FIELD, 1.0, "10s hover 16min"),
    State.EMPTY: (_FIELD, 0.005, "2h"),
    State.CALLING: (Whole("field", 0.19, last_resort=LastResort.CALL), 0.005, "3552s 900ms"),
    State.LOST: (Whole("never", 0.005), 0.005, "20h"),
}
"""A way into each state: the board, its charge and a script."""
_TRIGGERS = {word: TRIGGERS[kind] for word, kind in COMMANDS.items()} | {
    "rises": Trigger.CHARGE_EDGE_ROSE,
    "falls": Trigger.CHARGE_EDGE_FELL,
}
_KEPT = {(state, "release") for state in (State.CHARGING, State.REPORTING)}
"""No trigger of the table, and yet an order that is kept until the pin has fallen."""


def _ordered(word: str) -> str:
    """The order by both media: sound does not reach a modem in air, nor Wi-Fi a board under water."""
    if word not in COMMANDS:
        return word
    packet = CommandPacket(COMMANDS[word], 1)
    return f"{_sound(packet)} {_wifi(packet)}"


def _taken(word: str, new: State) -> str | Callable[[Any], bool]:
    """The sign that a state took an order. A board that hovers at the bottom sinks for no time."""
    if word == "ping":
        return _sends(ShortStatus)
    return "motors sink" if new is State.SINKING else f"state {new.name}"


def _named(state: State) -> str:
    return state.name.lower().replace("_", "-")


_SLOTS = "SLOT_ASSIGNMENT: a slot of no time, beyond its frame, or with a guard as long is refused"
_WAKES = "SLEEP_SCHEDULE: a wake of no time, or as long as its period, is refused; any on a board that never sleeps"
_BOUNDS = [
    _case(
        f"bounds-{name}",
        RequirementSource.PACKETS,
        requirement,
        f"3s {' '.join(map(_sound, commands))} 90min permission 70s rises 15min",
        whole=whole,
        tolerance_ms=_SLOT_MS,
        is_near_tie="1-ms-shorter-than-its-period" in name,
        counts_refusals=True,
    )
    for name, requirement, whole, commands in (
        ("a-slot-of-the-whole-frame", _SLOTS, _HOURLY, (SlotAssignment(1, 60_000, 60_000, 500, 0, 0),)),
        ("a-slot-that-ends-with-its-frame", _SLOTS, _HOURLY, (SlotAssignment(1, 60_000, 20_000, 500, 2, 0),)),
        ("a-slot-that-ends-1-ms-later", _SLOTS, _HOURLY, (SlotAssignment(1, 59_999, 20_000, 500, 2, 0),)),
        ("a-slot-longer-than-its-frame", _SLOTS, _HOURLY, (SlotAssignment(1, 60_000, 60_001, 500, 0, 0),)),
        ("a-slot-of-1-ms", _SLOTS, _HOURLY, (SlotAssignment(1, 60_000, 1, 0, 30_000, 0),)),
        ("a-slot-of-no-time", _SLOTS, _HOURLY, (SlotAssignment(1, 60_000, 0, 0, 0, 0),)),
        ("a-slot-in-no-frame", _SLOTS, _HOURLY, (SlotAssignment(1, 0, 0, 0, 0, 0),)),
        (
            "a-guard-1-ms-shorter-than-its-slot",
            _SLOTS,
            _HOURLY,
            (SlotAssignment(1, 60_000, 4000, 3999, 3, 0),),
        ),
        ("a-guard-as-long-as-its-slot", _SLOTS, _HOURLY, (SlotAssignment(1, 60_000, 4000, 4000, 3, 0),)),
        ("no-guard", _SLOTS, _HOURLY, (SlotAssignment(1, 60_000, 4000, 0, 3, 0),)),
        ("a-wake-of-1-ms", _WAKES, _HOURLY, (SleepSchedule(1, 600_000, 1),)),
        ("a-wake-1-ms-shorter-than-its-period", _WAKES, _HOURLY, (SleepSchedule(1, 600_000, 599_999),)),
        ("a-wake-as-long-as-its-period", _WAKES, _HOURLY, (SleepSchedule(1, 600_000, 600_000),)),
        ("a-wake-of-no-time", _WAKES, _HOURLY, (SleepSchedule(1, 600_000, 0),)),
        ("a-period-of-no-time", _WAKES, _HOURLY, (SleepSchedule(1, 0, 0),)),
        (
            "a-refused-one-leaves-the-former",
            _WAKES,
            _HOURLY,
            (SleepSchedule(1, 900_000, 20_000), SleepSchedule(1, 600_000, 0)),
        ),
        ("a-schedule-for-one-that-never-sleeps", _WAKES, _NEVER, (SleepSchedule(1, 600_000, 10_000),)),
        ("the-first-time", "BEACON: a time above 2^53 ms is refused", _HOURLY, (Beacon(1, 0),)),
        ("the-last-time", "BEACON: a time above 2^53 ms is refused", _HOURLY, (Beacon(1, 1 << 53),)),
        (
            "beyond-the-last-time",
            "BEACON: a time above 2^53 ms is refused",
            _HOURLY,
            (Beacon(1, (1 << 53) + 1),),
        ),
        (
            "every-number-of-a-level",
            "SET_THRESHOLD: a number above 2 is refused",
            _HOURLY,
            tuple(SetThreshold(1, it, 0.5) for it in Threshold),
        ),
        ("a-depth-of-0", "HOVER: a depth of 0 is refused", _HOURLY, (HoverAt(1, 0.0),)),
    )
]
_ACKS = [
    _case(
        f"an-acknowledgement-{name}",
        RequirementSource.PACKETS,
        requirement,
        f"{_REPORTING} {script} 5min",
        counts_refusals=True,
        shows=_sends(LogRecords),
    )
    for name, requirement, script in (
        ("of-all", "a sequence above that of the next record is refused", f"8s {_wifi(LogAck(1, 98))}"),
        (
            "of-one-too-many",
            "a refused one prolongs a report, too",
            f"8s {_wifi(LogAck(1, 99))} 8s {_wifi(LogAck(1, 1))}",
        ),
        (
            "of-none",
            "one of nothing new brings the records from the first one on",
            f"8s {_wifi(LogAck(1, 0))}",
        ),
        (
            "of-the-largest",
            "a sequence has four bytes",
            f"{_wifi(LogAck(1, (1 << 32) - 1))} 1s {_wifi(LogAck(1, 65_536))}",
        ),
        (
            "by-sound",
            "without Wi-Fi none is heard",
            f"30s {_sound(LogAck(1, 50))} 1min {_wifi(LogAck(1, 18))}",
        ),
        (
            "for-all",
            "id 0 addresses all",
            f"{_wifi(LogAck(EVERYONE, 72))} 1s {_wifi(CommandPacket(Kind.BACK_UP_LOG, EVERYONE))}",
        ),
        (
            "for-another",
            "a command has the id of its receiver",
            f"{_wifi(LogAck(257, 72))} 1s {_wifi(CommandPacket(Kind.BACK_UP_LOG, 256))}",
        ),
    )
]
_TABLE = [
    *(
        _case(
            f"{word}-in-{_named(state)}",
            RequirementSource.STATES,
            f"the table: {state.name} takes {trigger.name}",
            f"{script} {_ordered(word)} 25min",
            whole=whole,
            primary=primary,
            is_near_tie=state is State.CALLING,
            counts_refusals=True,
            shows=_taken(word, TABLE[state, trigger]),
        )
        for state, (whole, primary, script) in WAYS_INTO.items()
        for word, trigger in _TRIGGERS.items()
        if (state, trigger) in TABLE
    ),
    *(
        _case(
            f"nothing-else-in-{_named(state)}",
            RequirementSource.STATES,
            f"the table: {state.name} takes no other order, counts it, and keeps nothing of it",
            " ".join(
                [
                    script,
                    *(
                        _ordered(word)
                        for word in COMMANDS
                        if (state, _TRIGGERS[word]) not in TABLE and (state, word) not in _KEPT
                    ),
                    f"1min {'falls' if state in DOCKED else ''} 25min {AFTERWARDS}",
                ]
            ),
            whole=whole,
            primary=primary,
            is_near_tie=state is State.CALLING,
            counts_refusals=True,
        )
        for state, (whole, primary, script) in WAYS_INTO.items()
    ),
    *(
        _case(
            f"{name}-in-{_named(state)}",
            RequirementSource.STATES,
            f"the table: {state.name} takes {trigger.name}, or refuses and counts it",
            f"{script} {word} 25min {AFTERWARDS}",
            whole=whole,
            primary=primary,
            is_near_tie=state is State.CALLING,
            counts_refusals=state
            is not State.TRANSMITTING,  # the rest of its packet may go on, and drops sound
        )
        for name, word, trigger in (
            ("surfaced", "surfaced", Trigger.SURFACE_REACHED),
            ("landed", "landed", Trigger.BOTTOM_REACHED),
            ("emptied", "loses:100", Trigger.BATTERY_EMPTIED),
        )
        for state, (whole, primary, script) in WAYS_INTO.items()
        if state not in (DOCKED if name != "emptied" else STRANDED) | BEYOND_HELP
    ),
    *(
        _case(
            f"both-emptied-in-{_named(state)}",
            RequirementSource.STATES,
            "the table: without charge it is LOST, and a charger that feeds it boots it",
            f"{script} loses:100 5min ping permission 5min surfaced rises 20min falls 5min",
            whole=replace(whole, secondary=0.0),
            primary=primary,
            shows="state LOST",
        )
        for state, (whole, primary, script) in WAYS_INTO.items()
        if state not in DOCKED | STRANDED | BEYOND_HELP
    ),
    *(
        _case(
            f"{name}-in-{_named(state)}",
            RequirementSource.PACKETS,
            requirement,
            f"{script} {' '.join(f'{_sound(it)} {_wifi(it)}' for it in commands(lasts_ms(script)))} 45min permission 70s"
            " rises 61min",
            whole=whole,
            primary=primary,
            is_near_tie=state is State.CALLING,
            counts_refusals=True,
        )
        for name, requirement, commands in (
            (
                "a-beacon",
                "a beacon sets the clock wherever it is received",
                lambda at_ms: (Beacon(1, at_ms + 200_000),),
            ),
            (
                "settings",
                "schedule, timeslot and levels are stored wherever they are received",
                lambda _: (
                    SleepSchedule(1, 600_000, 20_000),
                    SlotAssignment(1, 300_000, 3000, 500, 7, 0),
                    SetThreshold(1, Threshold.SWITCH_BACK, 0.3),
                ),
            ),
            (
                "a-log-order",
                "LOG_ACK and BACK_UP_LOG are refused while the Wi-Fi is off",
                lambda _: (LogAck(1, 1), CommandPacket(Kind.BACK_UP_LOG, 1)),
            ),
        )
        for state, (whole, primary, script) in WAYS_INTO.items()
        if state not in BEYOND_HELP
    ),
    *(
        _case(
            f"a-reset-in-{_named(state)}",
            RequirementSource.STATES,
            "a reset boots the board, which then determines where it is",
            f"{script} brown_out 2h",
            whole=whole,
            primary=primary,
            is_near_tie=state is State.CALLING,
        )
        for state, (whole, primary, script) in WAYS_INTO.items()
    ),
]
_PIN = [
    _case(name, RequirementSource.STATES, requirement, script, primary=0.4, is_near_tie=True)
    for name, requirement, script in PIN
]
WHOLE_CASES = tuple(
    counting(it)
    for it in (
        *_PAPER,
        *_SLEEP,
        *_PINGS,
        *_TRAVEL,
        *(replace(it, shows=it.shows or _sends(LogRecords)) for it in (*_LOG, *_UPLOADS)),
        *_FAULTS,
        *_EMERGENCY,
        *_TIMES,
        *_REPORTS_AND_LIMITS,
        *_PACKETS,
        *_BOUNDS,
        *_ACKS,
        *_ROUND,
        *_PIN,
        *_TABLE,
    )
)
