"""The cases of the conformance kit for a whole board: sleep, timeslots, two batteries, a log with its upload."""

from __future__ import annotations

from binascii import crc_hqx
from dataclasses import replace

from firmware_model.bench.conformance import Case, PaperTime, Source, Whole
from firmware_model.config import LastResort
from firmware_model.packets import (
    EVERYONE,
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

_NEVER, _HOURLY, _FIELD = Whole("never"), Whole("hourly"), Whole("field")
_UP = "3s permission 70s"
"""It floats."""
_DOCKED = f"{_UP} rises 10min"
_RELEASED = f"{_DOCKED} falls 1s"


def _sound(command: Command) -> str:
    return f"sound:{command.encode().hex()}"


def _wifi(command: Command) -> str:
    return f"wifi:{command.encode().hex()}"


def _version_9(command: Command) -> str:
    """The command's bytes with another version, and the check of docs/packets.md for it."""
    body = b"\x09" + command.encode()[1:-2]
    return (body + crc_hqx(body, 0xFFFF).to_bytes(2, "little")).hex()


_EVERY_COMMAND: tuple[Command, ...] = (
    *(CommandPacket(kind, 1) for kind in (Kind.PERMISSION, Kind.RELEASE, Kind.PING, Kind.HOVER)),
    HoverAt(1, 1.25),
    SleepSchedule(1, 60_000, 10_000),
    SlotAssignment(1, 300_000, 3000, 500, 7, 0),
    SetThreshold(1, Threshold.SAFE_LEVEL, 0.5),
    Beacon(1, 3_595_000),
)
_SINK = _wifi(CommandPacket(Kind.SINK, 1))
"""Sound does not reach a modem in air."""
_EACH_MINUTE = _sound(SleepSchedule(1, 60_000, 10_000))
_SLOT_7 = _sound(SlotAssignment(1, 300_000, 3000, 500, 7, 0))
_HUNDRED_SAMPLES = f"3s {_EACH_MINUTE} 100min permission 70s rises"
"""Docked with 100 samples at 101 min 13 s; the next report is at 102 min."""
_REPORTING = f"{_HUNDRED_SAMPLES} 48s"
"""At 102 min 1 s, a second after the report."""
_LEVEL_MS = 40_000
"""The tolerance of what a level of charge causes after 3 h and more: 0.3 % of that time."""
_CALLS = Whole("hourly", 0.21, last_resort=LastResort.CALL)
_SURFACES = Whole("hourly", 0.21, last_resort=LastResort.SURFACE)


def _case(
    name: str,
    source: Source,
    requirement: str,
    script: str,
    whole: Whole = _HOURLY,
    primary: float = 1.0,
    paper: PaperTime | None = None,
    tolerance_ms: int = 20,
    is_near_tie: bool = False,
) -> Case:
    return Case(name, source, requirement, script, primary, tolerance_ms, whole, paper, is_near_tie)


def _table_one(name: str, mode: str, script: str, whole: Whole, ends: str, *minutes: float) -> Case:
    primary = 0.0 if ends == "the primary is full" else 1.0
    paper = PaperTime(ends, minutes[0], minutes[-1])
    return _case(name, Source.PAPER, f"Table I: {mode}", script, whole, primary, paper)


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
    _case("surfaces", Source.PAPER, "III-C: the aPad's permission brings it up", "3s permission 3min"),
    _case("surfaces-from-sleep", Source.PAPER, "III-C: a sleeping one hears it", "30min permission 3min"),
    _case("stays-down", Source.PAPER, "II: without a permission it stays on the bottom", "13h"),
    _case("charges", Source.PAPER, "III-C: a docked one is charged", f"{_DOCKED} 5h", primary=0.2),
    _case("sinks-when-released", Source.PAPER, "III-C: released, it sinks", f"{_RELEASED} release 5min"),
    _case("not-before", Source.PAPER, "III-C: in its dock it runs no motor", f"{_DOCKED} release 1h"),
    _case(
        "two-services",
        Source.PAPER,
        "III-C: a second service is as the first",
        f"{_RELEASED} release 2h permission 70s rises 1h falls 1s release 3min",
    ),
]
_SLEEP = [
    _case("wakes-hourly", Source.PAPER, "IV-A: it wakes at each whole hour for 10 s", "5h"),
    _case("listens-first", Source.STATES, "at rest on the bottom it listens, then it sleeps", "2min"),
    _case("field-wakes", Source.STATES, "it samples, processes, and sends in its timeslot", "4h", _FIELD),
    _case("in-slot-7", Source.PACKETS, "an assigned timeslot counts from now on", f"3s {_SLOT_7} 4h", _FIELD),
    _case(
        "a-first-slot",
        Source.STATES,
        "a board that had no slot transmits from now on",
        f"3s {_SLOT_7} 4h",
    ),
    *(
        _case(
            f"an-offset-of-{offset_ms}-ms",
            Source.PACKETS,
            "an offset moves the timeslot",
            f"3s {_sound(SlotAssignment(1, 300_000, 3000, 500, 2, offset_ms))} 3h",
            _FIELD,
        )
        for offset_ms in (-300, 300)
    ),
    _case(
        "a-slot-that-cannot-be",
        Source.PACKETS,
        "a timeslot beyond its frame is refused",
        f"3s {_sound(SlotAssignment(1, 60_000, 4000, 1500, 15, 0))} 3h",
        _FIELD,
    ),
    _case(
        "each-minute",
        Source.PACKETS,
        "a schedule counts from now on",
        f"3s {_EACH_MINUTE} 1h permission 70s rises 10min",
    ),
    _case(
        "a-longer-wake",
        Source.PACKETS,
        "a schedule sets the length of a wake",
        f"3s {_sound(SleepSchedule(1, 600_000, 60_000))} 2h permission 70s rises 15min",
    ),
    _case(
        "a-schedule-that-cannot-be",
        Source.PACKETS,
        "a wake longer than its period is refused",
        f"3s {_sound(SleepSchedule(1, 20_000, 150_000))} 3h",
        _FIELD,
    ),
    _case(
        "settings-outlive-a-reset",
        Source.STATES,
        "schedule and timeslot are kept",
        f"3s {_SLOT_7} {_sound(SleepSchedule(1, 600_000, 20_000))} 30min brown_out 2h",
        _FIELD,
    ),
    *(
        _case(
            f"drifts-by-{ppm}-ppm",
            Source.STATES,
            "timeslots follow the board's own clock",
            f"3s {_SLOT_7} 12h",
            Whole("field", drift_ppm=ppm),
        )
        for ppm in (-100, 100)
    ),
    _case(
        "a-beacon-sets-it",
        Source.STATES,
        "a beacon sets the drifting clock",
        f"3s {_SLOT_7} 359min beacon:21543000 6h",
        Whole("field", drift_ppm=100),
    ),
    _case(
        "a-beacon-for-all",
        Source.PACKETS,
        "a beacon to id 0 sets every clock",
        f"30min {_sound(Beacon(EVERYONE, 2_400_000))} 2h",
        _FIELD,
    ),
    _case(
        "past-an-alarm",
        Source.STATES,
        "set past an alarm, it rings at once",
        "30min beacon:3700000 2h",
        _FIELD,
    ),
    _case(
        "no-alarm-twice",
        Source.STATES,
        "set back, no alarm rings twice",
        "90min beacon:1800000 permission 20s sink 3h",
        _FIELD,
    ),
    _case(
        "a-time-that-cannot-be",
        Source.PACKETS,
        "a beacon of such a time is refused",
        f"30min {_sound(Beacon(1, 1 << 60))} 3h",
        _FIELD,
    ),
    _case(
        "a-clock-in-doubt",
        Source.STATES,
        "a clock beyond its guard transmits nothing",
        f"3s {_SLOT_7} 8h",
        Whole("field", doubt_ppm=50),
    ),
    _case(
        "a-beacon-dispels-it",
        Source.STATES,
        "a beacon in the wait lets it transmit after all",
        f"3s {_SLOT_7} 237min 100s beacon:14323000 1h",
        Whole("field", doubt_ppm=50),
    ),
    _case("woken-by-a-reset", Source.STATES, "a reset in its sleep boots it", "90min watchdog 2h", _FIELD),
    _case("pi-at-work", Source.STATES, "a reset in a wake ends it", "1h 30s brown_out 2h", _FIELD),
]
_PINGS = [
    _case("a-ping", Source.STATES, "500 ms after a ping it answers", "10s ping 1min"),
    _case("a-ping-in-sleep", Source.STATES, "a sleeping board answers, and sleeps on", "10min ping 1h"),
    _case("a-ping-in-a-wake", Source.STATES, "an answer prolongs no wake", "3603s ping 1h"),
    _case("a-ping-on-its-way", Source.STATES, "it answers on its way up", "3s permission 20s ping 2min"),
    _case("a-ping-down", Source.STATES, "it answers on its way down", f"{_RELEASED} release 20s ping 3min"),
    _case("two-pings", Source.STATES, "one answer at a time", "10s ping 300ms ping 5s ping 10s"),
    _case(
        "a-ping-for-all",
        Source.STATES,
        "nobody answers a ping to everyone",
        f"10s {_sound(CommandPacket(Kind.PING, EVERYONE))} 1min",
    ),
    _case(
        "a-ping-before-its-slot",
        Source.STATES,
        "its own slot drops the answer",
        "3899s 700ms ping 1min",
        _FIELD,
    ),
    _case("a-ping-while-empty", Source.STATES, "it answers on its backup", "2h ping 1min", primary=0.005),
    _case("a-ping-hovering", Source.STATES, "it answers while it hovers", "10s hover 5min ping 5min"),
    _case(
        "for-another",
        Source.PACKETS,
        "a command has the id of its receiver",
        f"10s {_sound(CommandPacket(Kind.PING, 2))} {_sound(CommandPacket(Kind.PERMISSION, 257))} 3min",
    ),
    _case(
        "other-versions",
        Source.PACKETS,
        "a kind of an unknown version is dropped",
        " ".join(["10s", *(f"sound:{_version_9(it)}" for it in _EVERY_COMMAND), "2h ping 1min"]),
    ),
    _case(
        "every-length",
        Source.PACKETS,
        "bytes that are no packet are dropped",
        " ".join(["10s", *(f"sound:{'ff' * n}" for n in range(65)), "ping 1min"]),
    ),
]
_TRAVEL = [
    _case("hovers", Source.STATES, "it hovers at an ordered depth", f"10s {_sound(HoverAt(1, 1.25))} 1h"),
    _case("hovers-here", Source.STATES, "it hovers where it is", "10s permission 30s sink 10s hover 3h"),
    _case("hovers-by-runs", Source.STATES, "a run at every interval keeps the depth", "10s hover 65min"),
    _case(
        "never-at-the-surface",
        Source.STATES,
        "it does not hover at the surface",
        f"10s {_sound(HoverAt(1, 0.0))} 1h",
    ),
    _case("up-from-hovering", Source.STATES, "a permission ends a hover", "10s hover 15min permission 3min"),
    _case("down-from-hovering", Source.STATES, "an order to sink ends a hover", "10s hover 15min sink 5min"),
    _case("a-reset-hovering", Source.STATES, "a reset forgets a hover", "10s hover 15min brown_out 3h"),
    _case(
        "nobody-comes", Source.STATES, "afloat for too long it sinks again", f"{_UP} 2h", Whole(float_min=60)
    ),
    _case("sinks-on-order", Source.STATES, "an order sinks it from the surface", f"{_UP} {_SINK} 3min"),
    _case(
        "sinks-when-told-after-its-dock",
        Source.STATES,
        "likewise after a release",
        f"{_RELEASED} {_SINK} 3min",
    ),
    _case("a-release-afloat", Source.STATES, "afloat a release sinks it", f"{_UP} release 3min"),
    _case(
        "sinks-on-its-way", Source.STATES, "an order sinks it on its way up", "3s permission 20s sink 3min"
    ),
    _case("no-release-packet", Source.STATES, "without a release it sinks after 120 s", f"{_RELEASED} 10min"),
    _case(
        "release-before-the-edge",
        Source.STATES,
        "docked, it sinks as soon as the pin has fallen",
        f"{_DOCKED} release 1s falls 10min",
    ),
    _case(
        "bounces", Source.STATES, "a level counts once it held for 50 ms", f"{_UP} chatter:20:20:20 rises 1h"
    ),
    _case(
        "chatter-mostly-high",
        Source.STATES,
        "after 2 s of chatter the level of most of the time counts",
        f"{_UP} chatter:30:10:52 {_SINK} rises 1h",
    ),
    _case(
        "chatter-51-percent-high",
        Source.STATES,
        "the time up to the end of the 2 s counts, too",
        f"{_UP} chatter:41:41:25 {_SINK} rises 1h",
        is_near_tie=True,
    ),
    _case(
        "chatter-mostly-low",
        Source.STATES,
        "after 2 s of chatter the level of most of the time counts",
        f"{_UP} chatter:10:30:100 3min",
    ),
    _case("missed-rise", Source.STATES, "a minute's look finds a lost edge", f"{_UP} rises_unseen 2h"),
    _case("missed-fall", Source.STATES, "a look finds a lost edge", f"{_DOCKED} falls_unseen 2h"),
    _case("slips", Source.STATES, "coils that slip and align charge on", f"{_DOCKED} slips 2h", primary=0.4),
    _case(
        "brown-out-docked",
        Source.STATES,
        "a reset in a dock charges on",
        f"{_DOCKED} brown_out 2h",
        primary=0.2,
    ),
    _case(
        "brown-out-afloat",
        Source.STATES,
        "a reset afloat floats on, for as long again",
        f"{_UP} 30min brown_out 2h",
        Whole(float_min=60),
    ),
    _case(
        "reports-when-asked",
        Source.PACKETS,
        "the experiment's report is a full status",
        f"{_UP} 1h watchdog 1h",
        Whole("hourly", report_min=10),
    ),
]
_LOG = [
    _case(
        "reports-docked", Source.PACKETS, "each wake in a dock reports by Wi-Fi", f"{_DOCKED} 3h", primary=0.3
    ),
    _case("uploads", Source.PACKETS, "a report brings the waiting records", f"{_HUNDRED_SAMPLES} 50s"),
    _case(
        "acknowledged",
        Source.PACKETS,
        "an acknowledgement brings the next records",
        f"{_REPORTING} {_wifi(LogAck(1, 72))} 1s {_wifi(LogAck(1, 100))} 5min",
    ),
    _case("no-acknowledgement", Source.PACKETS, "unacknowledged records come again", f"{_REPORTING} 5min"),
    _case(
        "an-acknowledgement-lost",
        Source.PACKETS,
        "the next report begins after what was acknowledged",
        f"{_REPORTING} {_wifi(LogAck(1, 18))} 5min",
    ),
    _case(
        "an-acknowledgement-twice",
        Source.PACKETS,
        "one of nothing new asks for the missing records",
        f"{_REPORTING} {_wifi(LogAck(1, 36))} 1s {_wifi(LogAck(1, 36))} 1s {_wifi(LogAck(1, 0))} 5min",
    ),
    _case(
        "acknowledgements-out-of-order",
        Source.PACKETS,
        "a late one takes nothing back",
        f"{_REPORTING} {_wifi(LogAck(1, 54))} 1s {_wifi(LogAck(1, 18))} 5min",
    ),
    _case(
        "never-taken",
        Source.PACKETS,
        "one of records that were never taken is refused",
        f"{_REPORTING} {_wifi(LogAck(1, 9999))} 5min",
    ),
    _case(
        "acknowledged-in-sleep",
        Source.PACKETS,
        "without Wi-Fi none is heard",
        f"{_HUNDRED_SAMPLES} 20s {_wifi(LogAck(1, 72))} 5min",
    ),
    _case(
        "asked-for-its-log",
        Source.PACKETS,
        "BACK_UP_LOG sends what waits",
        f"3h permission 70s 1s {_wifi(CommandPacket(Kind.BACK_UP_LOG, 1))} 1min",
    ),
    _case(
        "an-upload-keeps-it-awake",
        Source.STATES,
        "each acknowledgement prolongs the report",
        f"{_REPORTING} 8s {_wifi(LogAck(1, 18))} 9s {_wifi(LogAck(1, 36))} 5min",
    ),
    _case(
        "a-log-outlives-a-reset",
        Source.PACKETS,
        "no sequence is used twice",
        f"3s {_EACH_MINUTE} 30min brown_out 30min watchdog 30min permission 70s rises 5min",
    ),
    _case(
        "acknowledged-before-a-reset",
        Source.PACKETS,
        "acknowledged records stay so",
        f"{_REPORTING} {_wifi(LogAck(1, 72))} 1s brown_out 5min",
    ),
    _case(
        "a-full-ring",
        Source.PACKETS,
        "the oldest page is overwritten, and counted",
        f"3s {_EACH_MINUTE} 45h permission 70s rises 5min",
    ),
]
_UPLOADED = "1h permission 70s rises 10min"
"""Docked, a report and an upload after the words before it."""
_FAULTS = [
    _case(
        "a-silent-sensor",
        Source.CHOICE,
        "a sensor that does not answer repeats its last counts",
        f"3s {_EACH_MINUTE} 10min bus:1 10min bus:0 {_UPLOADED}",
    ),
    _case(
        "a-torn-write",
        Source.PACKETS,
        "a torn record is left out of an upload, and no other",
        f"3s {_EACH_MINUTE} 10min writes:10 2min writes:0 {_UPLOADED}",
    ),
    _case(
        "a-write-torn-to-a-byte",
        Source.PACKETS,
        "a torn record is left out of an upload, and no other",
        f"3s {_EACH_MINUTE} 10min writes:1 1min writes:0 {_UPLOADED}",
    ),
    _case(
        "worn-cells",
        Source.PACKETS,
        "a record whose check is wrong is left out of an upload",
        f"3s {_EACH_MINUTE} 10min cells:16 5min cells:0 {_UPLOADED}",
    ),
    *(
        _case(
            f"a-brown-out-after-{size}-bytes",
            Source.PACKETS,
            "a record that a reset tore is counted, and its sequence is not used again",
            f"3s {_EACH_MINUTE} 10min supply:{size} {_UPLOADED}",
        )
        for size in (1, 10, 23, 24)
    ),
    _case(
        "torn-at-a-page-s-edge",
        Source.PACKETS,
        "a page whose first record is torn goes on with the next one",
        f"3s {_EACH_MINUTE} 172min supply:10 {_UPLOADED}",
    ),
    _case(
        "written-at-a-page-s-edge",
        Source.PACKETS,
        "a record that a reset left whole keeps its sequence",
        f"3s {_EACH_MINUTE} 172min supply:24 {_UPLOADED}",
    ),
    _case(
        "torn-again-and-again",
        Source.PACKETS,
        "every torn record is counted",
        f"3s {_EACH_MINUTE} 10min supply:10 5min supply:20 5min supply:5 {_UPLOADED}",
    ),
    _case(
        "an-overrun",
        Source.PACKETS,
        "bytes that are no packet are dropped",
        "3s uart:4 permission ping 1min uart:0 ping 1min permission 3min",
    ),
    _case(
        "readings-with-noise",
        Source.PACKETS,
        "a status has the batteries' readings",
        "3s readings:5 3h readings:0 2h",
        _FIELD,
    ),
]
_EMERGENCY = [
    _case("empties", Source.STATES, "an empty one measures nothing", "8h", primary=0.005),
    _case(
        "empty-and-fetched",
        Source.PAPER,
        "III-C: an empty one takes a permission",
        "2h permission 70s rises 3h",
        primary=0.005,
    ),
    _case("waits", Source.STATES, "at its safe level it may wait", "12h", Whole("hourly", 0.21), 0.005),
    _case(
        "calls",
        Source.STATES,
        "at its safe level it may call, every 10 min",
        "30h",
        _CALLS,
        0.005,
        tolerance_ms=_LEVEL_MS,
    ),
    _case(
        "surfaces-at-last",
        Source.STATES,
        "at its safe level it may surface",
        "40h",
        _SURFACES,
        0.005,
        tolerance_ms=_LEVEL_MS,
    ),
    _case(
        "a-last-resort-ends-in-a-dock",
        Source.STATES,
        "once charged it sinks again after its time afloat",
        "10h rises 350min falls 1s release 10min permission 70s 2h",
        replace(_SURFACES, float_min=60),
        0.005,
        tolerance_ms=_LEVEL_MS,
    ),
    _case(
        "stays-down-when-told",
        Source.STATES,
        "for 6 h after an order to sink no last resort brings it up",
        "2h permission 20s sink 1s 40h",
        Whole("hourly", 0.2101, last_resort=LastResort.SURFACE),
        0.005,
    ),
    _case(
        "both-empty",
        Source.STATES,
        "without charge it answers nothing",
        "20h ping 1min",
        Whole("never", 0.005),
        0.005,
    ),
    _case(
        "back-on-its-primary",
        Source.STATES,
        "a dock switches it back at 10 %",
        "2h permission 70s rises 5h",
        primary=0.005,
    ),
    _case(
        "low-level",
        Source.STATES,
        "at its low level it wakes once",
        "3h",
        Whole("field", low_level=0.5),
        0.502,
    ),
    _case(
        "another-low-level",
        Source.PACKETS,
        "a threshold is set by a packet",
        f"3s {_sound(SetThreshold(1, Threshold.LOW_LEVEL, 0.8))} 3h",
        Whole("field", low_level=0.1),
        0.802,
    ),
    _case(
        "another-safe-level",
        Source.PACKETS,
        "a threshold is set by a packet",
        f"3s {_sound(SetThreshold(1, Threshold.SAFE_LEVEL, 0.5))} 30h",
        Whole("hourly", 0.51, last_resort=LastResort.CALL),
        0.005,
        tolerance_ms=_LEVEL_MS,
    ),
    _case(
        "another-switch-back",
        Source.PACKETS,
        "a threshold is set by a packet, and kept",
        f"3s {_sound(SetThreshold(1, Threshold.SWITCH_BACK, 0.3))} 1min brown_out 2h permission 70s rises 5h",
        primary=0.005,
    ),
    _case(
        "metered",
        Source.STATES,
        "a run of its motors does not look empty",
        f"{_UP} release 4h",
        Whole("field", metered=True),
        0.15,
    ),
    _case(
        "metered-and-empty",
        Source.STATES,
        "a voltage that stays low is empty",
        "8h",
        Whole("field", metered=True),
        0.01,
    ),
]
WHOLE_CASES = (*_PAPER, *_SLEEP, *_PINGS, *_TRAVEL, *_LOG, *_FAULTS, *_EMERGENCY)
