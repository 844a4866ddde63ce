"""The cases of the conformance kit, for the board of the paper's worst case."""

from __future__ import annotations

from dataclasses import replace

from firmware_model.bench.conformance import Case, PaperTime, RequirementSource
from firmware_model.bench.wrong_packets import UNKNOWN_LAYOUTS, by_sound, damages
from firmware_model.packets import (
    EVERYONE,
    Beacon,
    CommandPacket,
    HoverAt,
    Kind,
    LogAck,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    StatusPacket,
    Threshold,
)
from firmware_model.packets.command_packets import TRIGGERS
from firmware_model.packets.commands import WORST_CASE
from firmware_model.packets.wire import sealed
from firmware_model.states import TABLE, State, Trigger

_UP = "3s permission 70s"
"""It floats."""
_LATE_UP = "6s permission 70s"
"""It floats, after a boot of 5 s."""
_DOCKED = f"{_UP} rises 10min"
_RELEASED = f"{_DOCKED} falls 1s"
_SINKING = f"{_UP} sink 30s"
_PERMISSION = CommandPacket(Kind.PERMISSION, 1).encode()
_RELEASE = CommandPacket(Kind.RELEASE, 1).encode()
_STATUS = StatusPacket(1, 0, State.ACTIVE, 0.5, 0.5, 0.0, 0.0, 0.0, 0).encode()


def _of(kind: Kind, agent_id: int) -> str:
    return CommandPacket(kind, agent_id).encode().hex()


_DAMAGED = damages(_PERMISSION)


_PAPER = [
    Case("measures", RequirementSource.PAPER, "IV-A: on the bottom it draws equation (1)'s load", "1h"),
    Case(
        "measures-20-h",
        RequirementSource.PAPER,
        "IV-A: 959 minutes empty a full battery, and 962 in Table I",
        "20h",
        paper=PaperTime("the primary is empty", 959, 962),
    ),
    Case(
        "stays-down",
        RequirementSource.PAPER,
        "II: without a permission an aMussel stays on the bottom",
        "13h",
    ),
    Case(
        "surfaces", RequirementSource.PAPER, "V-A: the aPad's permission brings it up", "3s permission 3min"
    ),
    Case(
        "surfaces-once",
        RequirementSource.PAPER,
        "V-A: runs of its motors are kept to a minimum",
        f"{_UP} 10min",
    ),
    Case(
        "charges",
        RequirementSource.PAPER,
        "III: a closed dock charges it",
        f"{_DOCKED} 5h",
        0.2,
    ),
    Case(
        "charges-from-empty",
        RequirementSource.PAPER,
        "equation (2) from its first segment",
        f"{_UP} rises 9h",
        0.05,
    ),
    Case(
        "charges-485-min",
        RequirementSource.PAPER,
        "Table I: one coil fills an empty battery in 485 minutes",
        "1h permission 70s rises 9h",
        0.05,
        paper=PaperTime("the primary is full", 485, 485, begins="charges"),
    ),
    Case(
        "no-charge-unasked",
        RequirementSource.PAPER,
        "III: without a dock nothing charges it",
        f"{_UP} 2h",
        0.5,
    ),
    Case(
        "charges-no-longer",
        RequirementSource.PAPER,
        "III: a released one is no longer charged",
        f"{_DOCKED} falls 1h",
        0.3,
    ),
    Case(
        "sinks-when-released",
        RequirementSource.PAPER,
        "V-A: it sinks once its dock released it",
        f"{_RELEASED} release 3min",
    ),
    Case(
        "not-before",
        RequirementSource.PAPER,
        "V-A: in its dock it waits until it is full",
        f"{_DOCKED} release 1h",
    ),
    Case(
        "two-services",
        RequirementSource.PAPER,
        "V-A: a second service is as the first",
        f"{_RELEASED} release 2min permission 70s rises 1h falls 1s release 3min",
    ),
    Case(
        "empties",
        RequirementSource.PAPER,
        "IV-A: an empty battery measures nothing, and its aMussel stays",
        "2h",
        0.05,
    ),
    Case(
        "empty-and-fetched",
        RequirementSource.STATES,
        "an empty one takes a permission",
        "2h permission 70s rises 1h",
        0.05,
    ),
]
_PACKETS = [
    Case(
        "for-all",
        RequirementSource.PACKETS,
        "id 0 addresses all",
        f"3s sound:{_of(Kind.PERMISSION, EVERYONE)} 3min",
    ),
    Case(
        "for-another",
        RequirementSource.PACKETS,
        "a command has the id of its receiver",
        f"3s sound:{_of(Kind.PERMISSION, 2)} 3min",
    ),
    *(
        Case(
            f"{kind.name.lower()}-for-all",
            RequirementSource.PACKETS,
            "id 0 addresses all",
            f"{_UP} sound:{_of(kind, EVERYONE)} 3min",
        )
        for kind in (Kind.RELEASE, Kind.SINK)
    ),
    Case(
        "with-the-id-300",
        RequirementSource.PACKETS,
        "an id has two bytes",
        " ".join(
            [
                "3s",
                *(f"sound:{_of(Kind.PERMISSION, it)}" for it in (1, 44, 257)),
                f"1min sound:{_of(Kind.PERMISSION, 300)} 3min",
            ]
        ),
        agent_id=300,
    ),
    Case(
        "for-257",
        RequirementSource.PACKETS,
        "an id has two bytes",
        f"3s sound:{_of(Kind.PERMISSION, 257)} 3min",
    ),
    Case(
        "for-256",
        RequirementSource.PACKETS,
        "an id is little-endian",
        f"3s sound:{_of(Kind.PERMISSION, 256)} 3min",
    ),
    Case(
        "by-wifi",
        RequirementSource.PACKETS,
        "a permission may come by any medium",
        f"3s wifi:{_PERMISSION.hex()} 3min",
    ),
    *(
        Case(
            f"bit-{n}-flipped",
            RequirementSource.PACKETS,
            "the CRC detects every single bit error",
            f"3s sound:{_DAMAGED[n].hex()} 3min",
        )
        for n in (0, 9, 17, 30, 39, 47)
    ),
    Case(
        "too-short",
        RequirementSource.PACKETS,
        "bytes that are no packet are dropped",
        f"3s sound:{_PERMISSION[:-1].hex()} 3min",
    ),
    Case(
        "too-long",
        RequirementSource.PACKETS,
        "bytes that are no packet are dropped",
        f"3s sound:{_PERMISSION.hex()}00 3min",
    ),
    Case(
        "one-byte",
        RequirementSource.PACKETS,
        "bytes that are no packet are dropped",
        "3s sound:01 wifi:02 3min",
    ),
    Case(
        "no-bytes", RequirementSource.PACKETS, "bytes that are no packet are dropped", "3s sound: wifi: 3min"
    ),
    Case(
        "64-bytes",
        RequirementSource.PACKETS,
        "a v3 modem carries 64 bytes",
        f"3s sound:{'ff' * 64} permission 3min",
    ),
    Case(
        "every-bit-flipped",
        RequirementSource.PACKETS,
        "the CRC detects every single bit error",
        f"3s {by_sound(_DAMAGED)} 3min",
    ),
    Case(
        "every-length",
        RequirementSource.PACKETS,
        "bytes that are no packet are dropped",
        " ".join(
            [
                "3s",
                *(f"wifi:{(_PERMISSION * 11)[:n].hex()}" for n in range(65) if n != len(_PERMISSION)),
                "3min",
            ]
        ),
    ),
    Case(
        "every-kind",
        RequirementSource.PACKETS,
        "an unknown kind is dropped",
        f"3s {by_sound([sealed(bytes([1, kind, 1, 0])) for kind in range(13, 256)])} 3min",
    ),
    Case(
        "every-layout",
        RequirementSource.PACKETS,
        "version, kind and size belong together",
        f"3s {by_sound(UNKNOWN_LAYOUTS)} 3min",
    ),
    Case(
        "every-bit-of-a-release",
        RequirementSource.PACKETS,
        "the CRC detects every single bit error",
        f"{_UP} {by_sound(damages(_RELEASE))} 3min",
    ),
    Case(
        "counts-what-it-refuses",
        RequirementSource.PACKETS,
        "a board counts what it does not use",
        f"3s {by_sound([_DAMAGED[0], _PERMISSION[:-1]])} sound:{_of(Kind.PERMISSION, 2)} release sink 1min",
        counts_refusals=True,
    ),
    Case(
        "every-layout-afloat",
        RequirementSource.PACKETS,
        "version, kind and size belong together",
        f"{_UP} {by_sound(UNKNOWN_LAYOUTS)} 3min",
    ),
    Case("a-status", RequirementSource.PACKETS, "a status is no command", f"3s sound:{_STATUS.hex()} 3min"),
    Case(
        "another-version",
        RequirementSource.PACKETS,
        "an unknown version is dropped",
        f"3s sound:{sealed(bytes([9, Kind.PERMISSION, 1, 0])).hex()} 3min",
    ),
    Case(
        "a-beacon",
        RequirementSource.PACKETS,
        "a beacon moves no aMussel",
        f"3s sound:{Beacon(1, 10**6).encode().hex()} 3min",
    ),
    Case(
        "a-log-ack",
        RequirementSource.PACKETS,
        "an acknowledgement moves no aMussel",
        f"3s wifi:{LogAck(1, 7).encode().hex()} 3min",
    ),
    Case(
        "a-schedule",
        RequirementSource.PACKETS,
        "a schedule moves no aMussel",
        f"3s sound:{SleepSchedule(1, 3_600_000, 10_000).encode().hex()} 2h",
    ),
    Case(
        "a-timeslot",
        RequirementSource.PACKETS,
        "a timeslot moves no aMussel",
        f"3s sound:{SlotAssignment(1, 300_000, 3000, 0, 1, 0).encode().hex()} 1h",
    ),
    Case(
        "a-threshold",
        RequirementSource.PACKETS,
        "a threshold moves no aMussel",
        f"3s sound:{SetThreshold(1, Threshold.SAFE_LEVEL, 0.5).encode().hex()} 1h",
    ),
    Case("a-ping", RequirementSource.PACKETS, "a worst case answers no ping by sound", "3s ping 3min"),
    Case(
        "a-ping-for-all",
        RequirementSource.PACKETS,
        "nobody answers a ping to everyone, and a board counts it",
        f"3s sound:{_of(Kind.PING, EVERYONE)} 3min",
        counts_refusals=True,
    ),
    Case(
        "a-ping-down",
        RequirementSource.STATES,
        "the table: SINKING takes PING_HEARD, so nothing is refused",
        f"{_UP} sink 20s ping 1min",
        counts_refusals=True,
    ),
    Case(
        "a-hover",
        RequirementSource.PACKETS,
        "a worst case knows no HOVER",
        f"3s hover sound:{HoverAt(1, 2.0).encode().hex()} 10min",
    ),
]
_STATES = [
    Case(
        "permission-again",
        RequirementSource.STATES,
        "on its way up a further permission runs no motor",
        "3s permission 10s permission 10s permission 3min",
    ),
    Case(
        "permission-afloat",
        RequirementSource.STATES,
        "afloat a permission runs no motor",
        f"{_UP} permission 3min",
    ),
    Case(
        "permission-prolongs-no-float",
        RequirementSource.STATES,
        "a permission afloat is refused, and does not begin the time afloat anew",
        f"{_LATE_UP} permission 9h",
        uneven=True,
        shows="motors sink",
    ),
    Case(
        "permission-docked",
        RequirementSource.STATES,
        "docked a permission runs no motor",
        f"{_DOCKED} permission 3min",
    ),
    Case(
        "permission-while-sinking",
        RequirementSource.STATES,
        "a permission turns a sinking one round",
        f"{_SINKING} permission 3min",
    ),
    Case(
        "does-not-come-up",
        RequirementSource.STATES,
        "one that does not come up in 180 s runs its motors back",
        "travel:20min 3s permission 30min",
    ),
    Case(
        "tries-again",
        RequirementSource.STATES,
        "the permission's repetition is another try",
        "travel:4min 3s permission 8min travel:60s permission 3min",
    ),
    Case(
        "comes-up-in-time", RequirementSource.STATES, "179 s are in time", "travel:179s 3s permission 10min"
    ),
    Case("nobody-comes", RequirementSource.STATES, "afloat for 12 h it sinks again", f"{_UP} 13h"),
    Case("fetched-late", RequirementSource.STATES, "afloat for less it stays", f"{_UP} 11h rises 10min"),
    Case(
        "no-release-packet",
        RequirementSource.STATES,
        "without a release it sinks after 120 s",
        f"{_RELEASED} 10min",
    ),
    Case(
        "release-in-time",
        RequirementSource.STATES,
        "a release within 120 s counts",
        f"{_RELEASED} 118s release 10min",
    ),
    Case(
        "release-before-the-edge",
        RequirementSource.STATES,
        "docked, it sinks as soon as the pin has fallen",
        f"{_DOCKED} release 1s falls 10min",
    ),
    Case(
        "a-release-is-used-once",
        RequirementSource.STATES,
        "a release belongs to one docking",
        f"{_DOCKED} release 1s falls 3min permission 70s rises 1min falls 10min",
    ),
    Case("a-release-afloat", RequirementSource.STATES, "afloat a release sinks it", f"{_UP} release 3min"),
    Case(
        "a-release-below",
        RequirementSource.STATES,
        "on the bottom a release runs no motor",
        "3s release 3min",
    ),
    Case(
        "sinks-on-order", RequirementSource.STATES, "an order sinks it from the surface", f"{_UP} sink 3min"
    ),
    Case(
        "sinks-on-its-way",
        RequirementSource.STATES,
        "an order sinks it on its way up",
        "3s permission 20s sink 3min",
    ),
    Case(
        "sink-below", RequirementSource.STATES, "on the bottom an order to sink runs no motor", "3s sink 3min"
    ),
    Case(
        "sink-docked",
        RequirementSource.STATES,
        "docked, an order to sink runs no motor",
        f"{_DOCKED} sink 3min",
    ),
    Case(
        "docked-again",
        RequirementSource.STATES,
        "a rising pin charges a released one",
        f"{_RELEASED} rises 1h",
        0.4,
    ),
    Case(
        "docked-on-its-way-down",
        RequirementSource.STATES,
        "a rising pin charges a sinking one",
        f"{_SINKING} rises 1h",
        0.4,
    ),
    Case(
        "charger-below",
        RequirementSource.STATES,
        "a rising pin charges one on the bottom",
        "3s rises 1h",
        0.4,
    ),
    Case(
        "charger-while-empty",
        RequirementSource.STATES,
        "a rising pin charges an empty one",
        "2h rises 1h",
        0.05,
    ),
    Case(
        "bounces",
        RequirementSource.STATES,
        "a level counts once it held for 50 ms",
        f"{_UP} chatter:20:20:20 rises 1h",
        0.4,
    ),
    Case(
        "a-touch",
        RequirementSource.STATES,
        "a touch of 49 ms charges nothing",
        f"{_UP} rises 49ms falls 1h",
        0.4,
    ),
    Case(
        "a-gap",
        RequirementSource.STATES,
        "a gap of 49 ms ends no charge",
        f"{_DOCKED} falls 49ms rises 1h falls 1s release 2min",
        0.4,
    ),
    Case(
        "chatter-mostly-high",
        RequirementSource.STATES,
        "after 2 s of chatter the level of most of the time counts",
        f"{_UP} chatter:30:10:100 rises 1h",
        0.4,
    ),
    Case(
        "chatter-mostly-low",
        RequirementSource.STATES,
        "after 2 s of chatter the level of most of the time counts",
        f"{_UP} chatter:10:30:100 3min",
        0.4,
    ),
    Case(
        "chatter-that-turns",
        RequirementSource.STATES,
        "each 2 s of chatter are judged by themselves",
        f"{_UP} chatter:30:10:100 chatter:10:30:200 3min",
        0.4,
    ),
    Case(
        "chatter-51-percent-high",
        RequirementSource.STATES,
        "the time up to the end of the 2 s counts, too",
        f"{_UP} chatter:41:41:30 rises 1h",
        0.4,
        is_near_tie=True,
    ),
    Case(
        "two-spells-of-chatter",
        RequirementSource.STATES,
        "a level that held ends a chatter, and its time counts no more",
        f"{_UP} chatter:30:10:40 1s chatter:20:28:50 3min",
        0.4,
    ),
    Case(
        "a-fall-missed-in-a-rise",
        RequirementSource.STATES,
        "a level that did not hold for 50 ms counts for nothing",
        f"{_UP} rises 30ms falls_unseen 10min",
        0.4,
    ),
    Case(
        "a-rise-missed-in-a-fall",
        RequirementSource.STATES,
        "a level that did not hold for 50 ms counts for nothing",
        f"{_DOCKED} falls 30ms rises_unseen 1h",
        0.4,
    ),
    Case(
        "missed-rise",
        RequirementSource.STATES,
        "a minute's look finds a lost edge",
        f"{_UP} rises_unseen 1h",
        0.4,
    ),
    Case(
        "missed-fall",
        RequirementSource.STATES,
        "a minute's look finds a lost edge",
        f"{_DOCKED} falls_unseen 3min",
        0.4,
    ),
    Case(
        "a-wake-finds-it",
        RequirementSource.STATES,
        "a wake finds a lost edge",
        "3s rises_unseen 1s permission 200ms 1h",
        0.4,
    ),
    Case(
        "a-boot-finds-it",
        RequirementSource.STATES,
        "the begin of ACTIVE is a wake, and finds a lost edge",
        "1s rises_unseen 55s",
        0.4,
        shows="charges",
    ),
    Case(
        "a-way-down-finds-it",
        RequirementSource.STATES,
        "the begin of SINKING is a wake, and finds a lost edge",
        f"{_UP} rises_unseen 1s sink 40s",
        0.4,
        shows="charges",
    ),
    Case(
        "a-look-after-a-reset",
        RequirementSource.PORT,
        "the look for a lost edge comes at each whole minute of the counter, also after a reset",
        "10s brown_out 20s rises_unseen 35s",
        0.4,
        shows="charges",
    ),
    Case(
        "a-level-repeated",
        RequirementSource.STATES,
        "a level that repeats itself does not begin the 50 ms anew",
        "59s rises 49ms rises 1min",
        0.4,
        shows="charges",
    ),
    Case(
        "a-rise-missed-in-a-touch",
        RequirementSource.STATES,
        "an edge that is unseen within the 50 ms is found at their end, and its level counts 50 ms later",
        f"{_UP} rises 20ms falls 10ms rises_unseen 40s",
        0.4,
        shows="charges",
    ),
    Case(
        "a-look-while-it-debounces",
        RequirementSource.STATES,
        "a whole minute's look finds a lost edge also while a level is to hold",
        f"{_UP} 46980ms rises 10ms falls_unseen 20ms rises_unseen 10min",
        0.4,
        is_near_tie=True,
        shows="charges",
    ),
    Case("brown-out-below", RequirementSource.STATES, "a reset on the bottom measures on", "1h brown_out 1h"),
    Case(
        "brown-out-afloat",
        RequirementSource.STATES,
        "a reset afloat floats on, for 12 h from then",
        f"{_UP} 2h brown_out 13h",
    ),
    Case(
        "brown-out-docked",
        RequirementSource.STATES,
        "a reset in a dock charges on",
        f"{_DOCKED} watchdog 2h",
        0.2,
    ),
    Case(
        "brown-out-on-its-way-up",
        RequirementSource.STATES,
        "a reset on its way up arrives, and can be docked",
        "3s permission 20s brown_out 2min rises 1h",
        0.4,
    ),
    Case(
        "arrives-after-a-reset",
        RequirementSource.STATES,
        "a reset on its way up floats for 12 h once it has arrived",
        "3s permission 20s brown_out 13h",
    ),
    Case(
        "arrives-empty-after-a-reset",
        RequirementSource.STATES,
        "likewise with an empty battery",
        "2h permission 20s brown_out 13h",
        0.05,
    ),
    Case(
        "undocked-in-a-boot",
        RequirementSource.STATES,
        "a pin that fell in a boot ends the charge",
        f"{_DOCKED} brown_out 1s falls 10min",
        0.4,
    ),
    Case(
        "docked-in-a-boot",
        RequirementSource.STATES,
        "a pin that rose in a boot charges after it",
        f"{_UP} brown_out 1s rises 1h",
        0.4,
    ),
    Case(
        "release-forgotten",
        RequirementSource.STATES,
        "a reset forgets a release",
        f"{_DOCKED} release brown_out 1min falls 10min",
    ),
    Case(
        "empties-afloat",
        RequirementSource.STATES,
        "afloat an empty battery runs no motor",
        f"{_UP} 3h rises 1h",
        0.05,
    ),
    Case(
        "chatter-40-percent-high",
        RequirementSource.STATES,
        "after 2 s of chatter the level of most of the time counts",
        f"{_UP} chatter:20:30:200 3min",
        0.4,
    ),
    Case(
        "chatter-60-percent-high",
        RequirementSource.STATES,
        "after 2 s of chatter the level of most of the time counts",
        f"{_UP} chatter:30:20:200 rises 1h",
        0.4,
    ),
    Case(
        "sinks-again-after-a-net",
        RequirementSource.STATES,
        "one that comes up by itself floats, and sinks after 12 h",
        f"{_UP} sink 3min surfaced 13h",
    ),
    Case(
        "touches-the-surface",
        RequirementSource.STATES,
        "the table: SINKING takes SURFACE_REACHED, so it floats on, and sinks after 12 h",
        f"{_UP} sink 20s surfaced 13h",
    ),
    Case(
        "permission-in-a-boot",
        RequirementSource.PACKETS,
        "a booting board refuses every order",
        "1s permission 3min",
    ),
    Case(
        "boot-time",
        RequirementSource.PORT,
        "HELLO has the length of a boot",
        "1900ms permission 200ms permission 3min",
    ),
]
WAYS_INTO: dict[State, tuple[float, str]] = {
    State.BOOTING: (0.5, "1s"),
    State.ACTIVE: (0.5, "10s"),
    State.SURFACING: (0.5, "3s permission 20s"),
    State.FLOATING: (0.5, _UP),
    State.CHARGING: (0.5, _DOCKED),
    State.RELEASED: (0.5, _RELEASED),
    State.SINKING: (0.5, _SINKING),
    State.EMPTY: (0.05, "2h"),
}
"""A way into each state: the charge and a script."""
_ORDERS = {kind: trigger for kind, trigger in TRIGGERS.items() if kind in WORST_CASE}
_KEPT = {(State.CHARGING, Kind.RELEASE)}
"""No trigger of the table, and yet an order that is kept until the pin has fallen."""
AFTERWARDS = "permission 70s rises 1min falls 8min"
"""A service in which an order that was kept for later would show."""
_FACTS = {
    "surfaced": Trigger.SURFACE_REACHED,
    "landed": Trigger.BOTTOM_REACHED,
    "falls": Trigger.CHARGE_EDGE_FELL,
}
_TABLE = [
    *(
        Case(
            f"{kind.name.lower()}-in-{state.name.lower()}",
            RequirementSource.STATES,
            f"the table: {state.name} takes {trigger.name}",
            f"{script} sound:{_of(kind, 1)} 5min",
            primary,
            counts_refusals=True,
            shows=f"state {TABLE[state, trigger].name}",
        )
        for state, (primary, script) in WAYS_INTO.items()
        for kind, trigger in _ORDERS.items()
        if (state, trigger) in TABLE
    ),
    *(
        Case(
            f"nothing-else-in-{state.name.lower()}",
            RequirementSource.STATES,
            f"the table: {state.name} takes no other order, counts it, and keeps nothing of it",
            " ".join(
                [
                    script,
                    *(
                        f"sound:{_of(kind, 1)}"
                        for kind, trigger in _ORDERS.items()
                        if (state, trigger) not in TABLE and (state, kind) not in _KEPT
                    ),
                    f"1min {'falls' if state is State.CHARGING else ''} 5min {AFTERWARDS}",
                ]
            ),
            primary,
            counts_refusals=True,
        )
        for state, (primary, script) in WAYS_INTO.items()
    ),
    *(
        Case(
            f"{word}-in-{state.name.lower()}",
            RequirementSource.STATES,
            f"the table: {state.name} takes {trigger.name}, or refuses and counts it",
            f"{script} {word} 5min {AFTERWARDS}",
            primary,
            counts_refusals=True,
        )
        for state, (primary, script) in WAYS_INTO.items()
        for word, trigger in _FACTS.items()
        if (state is State.CHARGING) == (word == "falls")
    ),
    *(
        Case(
            f"empties-{name}",
            RequirementSource.STATES,
            "the table: a worst case that is not ACTIVE goes on with an empty battery, and is EMPTY once it is down",
            f"{script} 5min {AFTERWARDS}",
            primary,
            counts_refusals=True,
        )
        for name, script, primary in (
            ("in-a-boot", "1min", 0.00001),
            ("on-its-way-up", "3s permission 70s sink 2min", 0.0006),
            ("before-it-sinks", f"{_UP} 1min sink 2min", 0.002),
            ("on-its-way-down", f"{_UP} 47s sink 2min", 0.0026),
        )
    ),
    *(
        Case(
            f"docked-in-{state.name.lower()}",
            RequirementSource.STATES,
            f"the table: {state.name} takes CHARGE_EDGE_ROSE",
            f"{script} rises 10min falls 1s release 2min",
            primary,
            shows="charges",
        )
        for state, (primary, script) in WAYS_INTO.items()
        if (state, Trigger.CHARGE_EDGE_ROSE) in TABLE
    ),
    *(
        Case(
            f"a-reset-in-{state.name.lower()}",
            RequirementSource.STATES,
            "a reset boots the board, which then determines where it is",
            f"{script} brown_out 10min permission 70s rises 10min",
            primary,
        )
        for state, (primary, script) in WAYS_INTO.items()
    ),
]
_WRAPS = "36h 24min 31s"
"""A second before the counter wraps."""
COUNTER: tuple[tuple[str, str, str], ...] = (
    ("afloat", "30h permission 13h", "motors sink"),
    ("before-a-release", "36h 20min permission 70s rises 130s falls 10min", "motors sink"),
    ("in-a-chatter", f"{_WRAPS} chatter:30:10:100 rises 5min", "state CHARGING"),
    (
        "in-a-boot-and-a-debounce",
        f"{_WRAPS} brown_out 970ms rises 530ms permission 10min falls 5min",
        "state CHARGING",
    ),
    (
        "while-it-comes-up-and-before-a-look",
        f"{_WRAPS} travel:20min permission 40min rises_unseen 2min falls 5min brown_out 10s rises_unseen 2min",
        "state CHARGING",
    ),
)
"""Scripts with a time that lasts as the counter wraps: (name, script, sign). A look's minutes go on until a reset."""
_COUNTER = [
    Case(
        f"the-counter-wraps-{name}",
        RequirementSource.PORT,
        "the counter wraps after 36 hours",
        script,
        is_near_tie="debounce" in name,
        shows=shows,
    )
    for name, script, shows in COUNTER
]
PIN: tuple[tuple[str, str, str], ...] = (
    (
        "a-tie-leaves-it-low",
        "after 2 s of as much high as low the former level counts",
        f"{_UP} chatter:25:25:45 5min",
    ),
    (
        "a-tie-leaves-it-high",
        "after 2 s of as much high as low the former level counts",
        f"{_UP} rises 1min chatter:25:25:45 rises 5min",
    ),
    (
        "a-spell-follows-at-once",
        "the next 2 s of chatter follow at once",
        f"{_UP} chatter:6:45:40 chatter:45:6:60 rises 5min",
    ),
    (
        "a-fall-in-the-second-spell",
        "the next 2 s of chatter follow at once",
        f"{_UP} rises 1min chatter:45:6:40 chatter:6:45:60 5min",
    ),
    (
        "three-spells",
        "each 2 s of chatter are judged by themselves",
        f"{_UP} chatter:40:8:42 chatter:8:40:42 chatter:40:8:42 rises 5min",
    ),
    (
        "a-level-holds-past-a-spell",
        "a level that began to hold within 2 s of chatter counts 50 ms after it began",
        f"{_UP} chatter:5:45:39 rises 5ms falls 30ms rises 5min",
    ),
    (
        "a-fall-holds-past-a-spell",
        "a level that began to hold within 2 s of chatter counts 50 ms after it began",
        f"{_UP} rises 1min chatter:5:45:39 rises 5ms falls 30ms rises 5ms falls 5min",
    ),
    (
        "a-lost-edge-at-a-spell-s-end",
        "at the end of a spell and of a level the board looks at the pin",
        f"{_UP} rises 1min chatter:6:45:39 rises 6ms falls 5ms rises_unseen 5min",
    ),
    (
        "a-lost-edge-in-a-chatter",
        "at the end of 50 ms the board looks at the pin",
        f"{_UP} chatter:20:20:20 rises 10ms falls_unseen 10ms rises_unseen 20ms falls_unseen 5min",
    ),
    ("a-hold-of-51-ms", "a level counts once it held for 50 ms", f"{_UP} rises 51ms falls 5min"),
    (
        "a-gap-of-51-ms",
        "a level counts once it held for 50 ms",
        f"{_UP} rises 1min falls 51ms rises 5min",
    ),
    (
        "there-and-back-unseen",
        "an edge that went back before a look is none",
        f"{_UP} rises_unseen 20s falls_unseen 5min",
    ),
    (
        "away-and-back-unseen",
        "an edge that went back before a look is none",
        f"{_UP} rises 1min falls_unseen 20s rises_unseen 5min",
    ),
    (
        "unseen-and-then-repeated",
        "an interrupt that repeats the level tells a lost edge at once",
        f"{_UP} rises_unseen 20s rises 5min",
    ),
    (
        "a-lost-fall-seen-at-its-repetition",
        "an interrupt that repeats the level tells a lost edge at once",
        f"{_UP} rises 1min falls_unseen 5s falls 5min",
    ),
    (
        "a-reset-while-it-debounces",
        "a reset reads the level, which counts at once",
        f"{_UP} rises 30ms brown_out 1min falls 30ms brown_out 5min",
    ),
    (
        "a-reset-in-a-chatter",
        "a reset forgets a chatter",
        f"{_UP} chatter:30:10:40 brown_out 1s chatter:10:30:40 5min",
    ),
    (
        "a-reset-finds-a-lost-edge",
        "a reset reads the level, which counts at once",
        f"{_UP} rises_unseen 5s brown_out 1min falls_unseen 5s watchdog 5min",
    ),
    (
        "a-fall-lost-in-a-boot",
        "a look finds an edge that a boot lost",
        f"{_UP} rises 1min brown_out 1s falls_unseen 5min",
    ),
    (
        "a-rise-lost-in-a-boot-afloat",
        "the begin of FLOATING is a wake, and finds a lost edge",
        f"{_UP} brown_out 1s rises_unseen 5min",
    ),
    (
        "chatter-in-a-boot",
        "what the pin tells in a boot counts after it",
        f"{_UP} brown_out 500ms chatter:30:10:60 5min",
    ),
    (
        "an-edge-at-a-boot-s-end",
        "a level that is to hold as a boot ends counts after it",
        f"{_UP} brown_out 1970ms rises 1min brown_out 1970ms falls 5min",
    ),
    (
        "a-boot-in-a-boot",
        "a reset in a boot begins it anew",
        "1s brown_out 1500ms permission 1s permission 3min",
    ),
)
"""The charger's pin: a name, the requirement, and a script of pins, resets and permissions alone."""
_PIN = [
    Case(name, RequirementSource.STATES, requirement, script, 0.4, is_near_tie=True)
    for name, requirement, script in PIN
]
_ROUNDS = [
    Case(name, RequirementSource.STATES, requirement, script, 0.5, counts_refusals=True, shows=shows)
    for name, requirement, script, shows in (
        (
            "a-release-before-its-edge-is-certain",
            "docked, it sinks as soon as the pin has fallen",
            f"{_DOCKED} falls 20ms release 5min",
            "motors sink",
        ),
        (
            "a-release-while-a-rise-is-to-hold",
            "afloat a release sinks it, and a dock on its way down charges it",
            f"{_UP} rises 20ms release 5min",
            "charges",
        ),
        (
            "a-release-kept-through-a-gap",
            "a gap that does not hold ends no docking",
            f"{_DOCKED} release falls 30ms rises 1min falls 5min",
            "motors sink",
        ),
        (
            "a-release-kept-through-a-lost-fall",
            "docked, it sinks as soon as the pin has fallen, also if a look finds that",
            f"{_DOCKED} release falls_unseen 5min",
            "motors sink",
        ),
        (
            "a-release-too-late",
            "a release on its way down is refused and counted",
            f"{_RELEASED} 121s release 5min",
            "motors sink",
        ),
        (
            "a-wait-for-a-release-begins-anew",
            "each fall begins the wait anew",
            f"{_RELEASED} 100s rises 1min falls 100s rises 1min falls 5min",
            "motors sink",
        ),
        (
            "a-surfacing-begins-anew",
            "each permission begins the time of a surfacing anew",
            "travel:170s 3s permission 100s sink 4min permission 5min",
            "motors sink",
        ),
        (
            "comes-up-too-late",
            "181 s are too late, and counted",
            "travel:181s 3s permission 10min",
            "motors sink",
        ),
        (
            "afloat-again",
            "each surfacing begins the time afloat anew",
            f"{_UP} 8h sink 3min permission 70s 13h",
            "motors sink",
        ),
        (
            "a-permission-while-a-rise-is-to-hold",
            "a rising pin charges one on its way up",
            "3s rises 20ms permission 5min",
            "charges",
        ),
        (
            "sinks-by-wifi",
            "any medium carries an order to sink",
            f"{_UP} wifi:{_of(Kind.SINK, 1)} 5min",
            "motors sink",
        ),
        (
            "released-by-sound",
            "any medium carries a release",
            f"{_RELEASED} sound:{_of(Kind.RELEASE, 1)} 5min",
            "motors sink",
        ),
        (
            "for-another-afloat",
            "a command has the id of its receiver",
            f"{_UP} {' '.join(f'wifi:{_of(kind, it)}' for kind in (Kind.RELEASE, Kind.SINK) for it in (2, 256, 257))} 5min",
            None,
        ),
        (
            "a-release-for-another-docked",
            "a command has the id of its receiver",
            f"{_DOCKED} wifi:{_of(Kind.RELEASE, 2)} falls 5min",
            "motors sink",
        ),
    )
]
_TIMES = [
    Case(
        f"other-times-of-{name}",
        RequirementSource.PORT,
        f"HELLO has the scenario's times: {requirement}",
        script,
        is_near_tie=name == "an-edge",
        uneven=True,
        shows=shows,
    )
    for name, requirement, script, shows in (
        ("a-boot", "a boot", "4s permission 2s permission 3min", "motors float"),
        ("a-surfacing", "the longest surfacing", "travel:20min 6s permission 10min", "motors sink"),
        ("a-float", "the time afloat", f"{_LATE_UP} 9h", "motors sink"),
        ("a-release", "the wait for a release", f"{_LATE_UP} rises 1min falls 3min", "motors sink"),
        ("an-edge", "the debounce", f"{_LATE_UP} rises 79ms falls 10s rises 81ms falls 3min", "charges"),
    )
]


def counting(case: Case) -> Case:
    """The case with its refused inputs counted, if its pin chatters or loses edges: the page states how these count."""
    has_faults = "chatter" in case.script or "unseen" in case.script
    return replace(case, counts_refusals=case.counts_refusals or has_faults)


CASES = tuple(
    counting(it) for it in (*_PAPER, *_PACKETS, *_STATES, *_PIN, *_ROUNDS, *_COUNTER, *_TIMES, *_TABLE)
)
