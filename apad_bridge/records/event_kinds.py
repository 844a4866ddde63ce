"""Every kind of line in journal.jsonl, with its fields: the writer, the reader and docs/records.md follow this table.

A line is `{"t": mission ms, "kind": kind, ...}`. An aMussel is named by `id`, or by `agent` in what the mission did.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum, StrEnum
from functools import cache
from types import GenericAlias, NoneType
from typing import Annotated, Any, Literal, NamedTuple, Optional, get_args

from pydantic import ConfigDict, StrictBool, StrictInt, StrictStr, ValidationError, create_model
from pydantic import Field as Constraint
from pydantic_core import SchemaValidator

from apad_bridge.beliefs.modes import Mode
from apad_bridge.events.event import Event, EventField, fields_of
from apad_bridge.events.union import EVENTS
from apad_bridge.mission.ending import EndReason
from apad_bridge.mission.state import EARLIER_COMMANDED, Phase
from apad_bridge.planning.solution import StepKind
from apad_bridge.scenario.schema import MAX_DOCKS
from apad_bridge.scenario.timed_faults import TimedFault
from apad_bridge.supervisor.roster import Presence
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Flow
from firmware_model.states import State


class EventKind(StrEnum):
    RUN = "run"
    TICK = "tick"
    END = "end"
    TRUTH = "truth"
    BELIEF = "belief"
    APAD = "apad"
    MISSION = "mission"
    PLAN = "plan"
    LEG = "leg"
    PRIMITIVE = "primitive"
    DOCK = "dock"
    RELEASED = "released"
    GIVEN_UP = "given_up"
    LEFT_ALONE = "left_alone"
    BEYOND_REACH = "beyond_reach"
    IN_REACH = "in_reach"
    STUCK = "stuck"
    OVERRIDE = "override"
    OPERATOR = "operator"
    REMARK = "remark"
    SCRIPT = "script"
    REFUSED = "refused"
    GUARD = "guard"
    GUARD_OVER = "guard_over"
    STOP = "stop"
    CONTINUED = "continued"
    BACK_IN = "back_in"
    DRIFT = "drift"
    PILOT = "pilot"
    OTHERS = "others"
    DOCKS_DISAGREE = "docks_disagree"
    STANDS_DOWN = "stands_down"
    HANDED_ON = "handed_on"
    TOOK_ON = "took_on"
    STIMULUS = "stimulus"
    DIED = "died"
    PRESENCE = "presence"
    FAULT = "fault"
    FAULT_OVER = "fault_over"
    PACKET = "packet"
    RANGE = "range"
    FIX = "fix"
    ASKED = "asked"
    UNANSWERED = "unanswered"
    SAMPLES_GONE = "samples_gone"
    LINKS = "links"
    MODEM = "modem"
    MASTER_GONE = "master_gone"
    MASTER_BACK = "master_back"
    GRAPH_DEAF = "graph_deaf"
    GRAPH_HEARS = "graph_hears"
    VEHICLE_SILENT = "vehicle_silent"
    VEHICLE_HEARD = "vehicle_heard"
    UNREADABLE = "unreadable"
    LEFT_WATER = "left_water"
    RESUMED = "resumed"
    RESTORED = "restored"


class Type(NamedTuple):
    """A field's type: for the check of a value, and as the page names it."""

    annotation: Any
    text: str


class Field(NamedTuple):
    name: str
    type: Type
    meaning: str
    unit: str = ""
    optional: bool = False
    """True for a field that a line has only where it says something."""


class Kind(NamedTuple):
    kind: str
    when: str
    fields: tuple[Field, ...] = ()
    is_open: bool = False
    """True for lines with further fields, which a script's author names."""


def _or_null(type_: Type) -> Type:
    return Type(Optional[type_.annotation], f"{type_.text} or null")  # noqa: UP045 - a runtime value


def _list_of(type_: Type) -> Type:
    return Type(GenericAlias(list, (type_.annotation,)), f"list of {type_.text}")


def _row(*types: Type) -> Type:
    return Type(
        GenericAlias(tuple, tuple(it.annotation for it in types)), f"[{', '.join(it.text for it in types)}]"
    )


def _one_of(values: Sequence[str]) -> Type:
    return Type(Literal[*values], "text")


def _names(kind: type[Enum]) -> Type:
    return _one_of([it.name for it in kind])


def _values(kind: type[StrEnum]) -> Type:
    return _one_of([it.value for it in kind])


def _object(name: str, *fields: Field) -> Type:
    return Type(_model(name, fields), "{" + ", ".join(it.name for it in fields) + "}")


def _model(name: str, fields: Sequence[Field]) -> Any:
    """Names of fields may be keywords of Python, so each is an alias."""
    members: dict[str, Any] = {
        f"field_{n}": (it.type.annotation, Constraint(None if it.optional else ..., alias=it.name))
        for n, it in enumerate(fields)
    }
    return create_model(name, __config__=ConfigDict(defer_build=True), **members)


INTEGER = Type(StrictInt, "integer")
NUMBER = Type(Annotated[float, Constraint(strict=True, allow_inf_nan=False)], "number")
TEXT = Type(StrictStr, "text")
_NUMBERS = Type(GenericAlias(dict, (StrictStr, NUMBER.annotation)), "{name: number}")
BOOLEAN = Type(StrictBool, "true or false")
_TYPES = {int: INTEGER, float: NUMBER, str: TEXT, bool: BOOLEAN}
_DOCK = Type(Annotated[StrictInt, Constraint(ge=0, lt=MAX_DOCKS)], "integer")
_BATTERY = _row(
    *(INTEGER, INTEGER, Type(Annotated[StrictInt, Constraint(ge=0, lt=len(Flow))], "integer")),
    INTEGER,
    INTEGER,
)

_ID = Field("id", INTEGER, "the aMussel")
_AGENT = Field("agent", INTEGER, "the aMussel")
_DOCK_FIELD = Field("dock", _DOCK, "the dock, counted from 0")
_NORTH = Field("north_m", NUMBER, "place, north of the scenario's origin", "m")
_EAST = Field("east_m", NUMBER, "place, east of the scenario's origin", "m")
_AGENT_MS = Field("agent_ms", INTEGER, "when, by the aMussel's time", "agent ms")
_REASON = Field("reason", TEXT, "why")


def _optional(field: Field) -> Field:
    return field._replace(optional=True)


_PHASE = _one_of([*(it.value for it in Phase), *EARLIER_COMMANDED])
_POINT = _row(NUMBER, NUMBER)
_LEG = _object(
    "leg",
    Field("primitive_id", INTEGER, ""),
    *(Field("start", _POINT, ""), Field("goal", _POINT, ""), Field("counted", _POINT, "")),
)
_SNAPSHOT = _object(
    "snapshot",
    *(Field("phase", _PHASE, ""), Field("since_ms", INTEGER, "")),
    Field("plan", _list_of(_row(_values(StepKind), INTEGER, INTEGER)), ""),
    Field("docked", _list_of(_row(INTEGER, INTEGER)), ""),
    Field("homes", _list_of(_row(INTEGER, NUMBER, NUMBER)), ""),
    *(Field("primitive_id", INTEGER, ""), Field("cost_m", NUMBER, "")),
    *(Field("services", INTEGER, ""), Field("leaves_full", BOOLEAN, "")),
    # Earlier versions had no field of these, and one more.
    *(_optional(Field("planned_m", NUMBER, "")), _optional(Field("leg", _or_null(_LEG), ""))),
    _optional(Field("dock_count", INTEGER, "")),
    _optional(Field("failed_tries", _list_of(_row(INTEGER, INTEGER)), "")),
    _optional(Field("failed_undockings", _list_of(_row(INTEGER, INTEGER)), "")),
    _optional(Field("released", _list_of(_row(INTEGER, INTEGER)), "")),
    _optional(Field("attempts", INTEGER, "")),
    Field("ended_by", _or_null(TEXT), ""),
    Field("end_reason", _or_null(_values(EndReason)), "", optional=True),
)


def _kind_of(event: type[Event]) -> Kind:
    """The row of a kind that has a class."""
    return Kind(event.kind, event.when, tuple(_field_of(it) for it in fields_of(event)))


def _field_of(field: EventField) -> Field:
    """An optional field of a line is absent rather than null."""
    members = get_args(field.annotation)
    annotation = next(it for it in members if it is not NoneType) if field.is_optional else field.annotation
    return Field(field.name, _type_of(annotation), *field.meaning, field.is_optional)


def _type_of(annotation: Any) -> Type:
    """The type of a line's field, from that of the event's class."""
    if annotation in _TYPES:
        return _TYPES[annotation]
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return _values(annotation) if issubclass(annotation, StrEnum) else _names(annotation)
    members = get_args(annotation)
    assert NoneType in members, annotation
    return _or_null(_type_of(next(it for it in members if it is not NoneType)))


KINDS: tuple[Kind, ...] = (
    Kind(
        EventKind.RUN,
        "the first line of a run",
        (
            Field("format", INTEGER, "of the journal"),
            Field("scenario", TEXT, "its name"),
            Field("theta", INTEGER, "agent time per mission time"),
            Field("seed", INTEGER, "of all that is random"),
            Field("duration_s", NUMBER, "how long the mission is", "s"),
            Field("pool_threshold", NUMBER, "charge at which an aMussel becomes a candidate", "0 to 1"),
            Field("full_threshold", NUMBER, "charge at which it counts as full", "0 to 1"),
            Field(
                "agents",
                _list_of(
                    _object(
                        "start",
                        *(_ID, _NORTH, _EAST),
                        *(Field("primary", NUMBER, ""), Field("secondary", NUMBER, "")),
                    )
                ),
                "where each aMussel starts, and its charges",
                "m, 0 to 1",
            ),
        ),
    ),
    Kind(EventKind.TICK, "a tick without another event; its time shows the progress of the flight"),
    Kind(
        EventKind.END,
        "the mission has ended",
        (
            Field("reason", TEXT, "why, for people"),
            _optional(Field("end_reason", _values(EndReason), "why: one of a fixed set")),
        ),
    ),
    Kind(
        EventKind.TRUTH,
        "a simulated aMussel's true state changed, or it drifted by a quarter of a metre; it holds until the next",
        (
            _ID,
            _AGENT_MS,
            Field("state", _names(State), "the board's state, by name"),
            Field("primary", _BATTERY, "battery: anchor, charge, flow, load, coils", "agent ms, grains"),
            Field("secondary", _BATTERY, "the other battery, in the same form", "agent ms, grains"),
            Field("north_um", INTEGER, "place, north", "um"),
            Field("east_um", INTEGER, "place, east", "um"),
            Field("depth", _row(INTEGER, INTEGER), "anchor, and the depth then", "agent ms, um"),
            Field("buoyancy", _names(Buoyancy), "the direction in which its motors move it"),
            Field("docked", BOOLEAN, "true while a dock holds it"),
            _optional(Field("hover_um", INTEGER, "the depth to which it hovers", "um")),
            _optional(Field("pin_due", INTEGER, "when the coils will be aligned", "agent ms")),
            _optional(Field("log", _row(INTEGER, INTEGER), "samples taken, and samples acknowledged")),
        ),
    ),
    Kind(
        EventKind.BELIEF,
        "the supervisor's belief of an aMussel changed noticeably",
        (
            _ID,
            Field("heard", INTEGER, "the time of its newest packet", "mission ms"),
            Field("state", _names(State), "the board's state, by name"),
            Field("charge", NUMBER, "of the primary battery", "0 to 1"),
            Field("secondary", NUMBER, "charge of the other battery", "0 to 1"),
            _NORTH,
            _EAST,
            _optional(Field("sd", NUMBER, "standard deviation of the charge; of a twin alone", "0 to 1")),
            _optional(Field("low", NUMBER, "begin of the charge's interval of 95 %", "0 to 1")),
            _optional(Field("high", NUMBER, "end of that interval", "0 to 1")),
            _optional(Field("mode", _names(Mode), "the most probable mode, by name")),
        ),
    ),
    Kind(
        EventKind.APAD,
        "the aPad moved, turned, used energy or changed its docks, or a minute passed",
        (
            _NORTH,
            _EAST,
            Field("heading_rad", NUMBER, "heading, from north to east", "rad"),
            Field("voltage_v", _or_null(NUMBER), "its battery's voltage", "V"),
            Field("battery", _or_null(NUMBER), "charge of its battery", "0 to 1"),
            Field("primitive", TEXT, "the primitive under way, or `none`"),
            Field("docks", _list_of(INTEGER), "the aMussel in each dock, -1 for none"),
        ),
    ),
    Kind(
        EventKind.MISSION,
        "the mission's state changed; a resumed run continues from the newest",
        (
            Field("phase", _PHASE, "the box of the paper's Fig. 7"),
            Field("snapshot", _SNAPSHOT, "the whole state", "m, mission ms"),
        ),
    ),
    Kind(
        EventKind.PLAN,
        "a strategy made a plan",
        (
            Field("what", TEXT, "`collect` or `redeploy`"),
            Field("strategy", TEXT, "its name"),
            Field("steps", _list_of(_object("step", _AGENT, _DOCK_FIELD)), "in order"),
            Field(
                "costs",
                _object(
                    "costs",
                    *(Field("distance_m", NUMBER, ""), Field("demand", NUMBER, "")),
                    *(Field("distance_cost", NUMBER, ""), Field("energy_cost", NUMBER, "")),
                ),
                "equations (4) to (6): the way, the energy, and both scaled",
                "m, batteries",
            ),
            Field(
                "beliefs",
                _list_of(
                    _object(
                        "candidate",
                        *(_ID, Field("charge", NUMBER, ""), _NORTH, _EAST),
                        *(
                            _optional(Field("secondary", NUMBER, "")),
                            _optional(Field("unserved_s", NUMBER, "")),
                        ),
                    )
                ),
                "the beliefs of the candidates, and the time since each was released",
                "0 to 1, m, s",
            ),
            _optional(Field("from", _POINT, "the aPad's place, north and east", "m")),
            _optional(
                Field(
                    "exchanged",
                    _list_of(
                        _object("exchange", Field("released", INTEGER, ""), Field("collected", INTEGER, ""))
                    ),
                    "who exchange places: the one that is released takes that of the one that is collected",
                )
            ),
            _optional(
                Field(
                    "options",
                    _list_of(
                        _object(
                            "option",
                            Field("agents", _list_of(INTEGER), ""),
                            *(Field("cost", NUMBER, ""), Field("parts", _NUMBERS, "")),
                        )
                    ),
                    "what the strategy weighed, by its own costs, whose parts have names: the plan itself, its runner-up, "
                    "others; none without reasons",
                )
            ),
            _optional(Field("unexplained", TEXT, "the error of a strategy's own explanation")),
        ),
    ),
    Kind(
        EventKind.PRIMITIVE,
        "a primitive started, succeeded or failed, or a docking caught nothing within the catch radius",
        (
            Field("name", TEXT, "`go to point`, `hold position`, `dock` or `undock`"),
            Field("phase", _one_of(["started", "succeeded", "failed", "nothing_caught"]), "the result"),
            _optional(_AGENT),
            _optional(_DOCK_FIELD),
            _optional(Field("north_m", NUMBER, "the goal, north", "m")),
            _optional(Field("east_m", NUMBER, "the goal, east", "m")),
            _optional(Field("reason", TEXT, "why it failed")),
        ),
    ),
    Kind(
        EventKind.DOCK,
        "a dock closed around an aMussel, or opened",
        (_DOCK_FIELD, _AGENT, Field("closed", BOOLEAN, "true when it closed")),
    ),
    Kind(
        EventKind.OPERATOR,
        "a person gave the supervisor an order by a command",
        (
            Field(
                "order",
                _one_of(
                    (
                        *("stop", "hands", "continue", "back in", "abort", "go to", "hold"),
                        *("ping", "permit to surface"),
                    )
                ),
                "the order",
            ),
            Field("by", TEXT, "the person's name on that machine"),
            _optional(_AGENT),
            _optional(Field("north_m", NUMBER, "the goal, north", "m")),
            _optional(Field("east_m", NUMBER, "the goal, east", "m")),
        ),
    ),
    Kind(
        EventKind.REMARK,
        "a person made a remark",
        (
            Field("text", TEXT, "the remark"),
            Field("by", TEXT, "who made it"),
        ),
    ),
    Kind(
        EventKind.SCRIPT,
        "a script printed a line, or noted its own event with its own fields",
        (
            _optional(Field("said", TEXT, "a line for people")),
            _optional(Field("what", TEXT, "the name that the script gave its event")),
        ),
        is_open=True,
    ),
    Kind(
        EventKind.HANDED_ON,
        "one of several aPads no longer serves an aMussel",
        (_ID, _optional(Field("to", TEXT, "the aPad that does; with --time asap"))),
    ),
    Kind(
        EventKind.TOOK_ON,
        "one of several aPads serves another aMussel",
        (_ID, _optional(Field("of", TEXT, "the aPad that did; with --time asap"))),
    ),
    Kind(
        EventKind.STIMULUS,
        "something reached an aMussel: a contact, a packet, its place in a dock",
        (
            _ID,
            _AGENT_MS,
            Field(
                "wire",
                _list_of(Type(StrictInt | StrictStr, "integer or text")),
                "its number in `agents/mussel/stimuli.py` and its fields; bytes in hexadecimal",
            ),
        ),
    ),
    Kind(
        EventKind.PRESENCE,
        "an aMussel became real, retired, or simulated again",
        (
            _ID,
            Field("is", _values(Presence), "its new presence"),
            Field("by", TEXT, "the node that asked"),
        ),
    ),
    Kind(
        EventKind.FAULT,
        "a fault began, of a simulated aMussel or of the simulated aPad ([faults.md](faults.md))",
        (
            _optional(_ID._replace(meaning="the aMussel; absent for a fault of the aPad")),
            Field("fault", _values(TimedFault), "which"),
            _optional(Field("value", NUMBER, "its value, in the unit of its row")),
            _optional(
                Field(
                    "until_ms",
                    INTEGER,
                    "when it ends; the line's own time for one that is over at once",
                    "ms",
                )
            ),
            _optional(Field("refused", TEXT, "why a fault of the scenario did not begin")),
        ),
    ),
    Kind(
        EventKind.FAULT_OVER,
        "a fault that lasted was healed",
        (
            _optional(_ID._replace(meaning="the aMussel; absent for a fault of the aPad")),
            Field("fault", _values(TimedFault), "which"),
        ),
    ),
    Kind(
        EventKind.PACKET,
        "an acoustic packet ended, in simulated water",
        (
            Field("from", INTEGER, "the sender: an aMussel's id, 0 is the aPad"),
            Field("address", _or_null(INTEGER), "the addressed modem; null for all"),
            Field("what", TEXT, "the kind of frame"),
            Field("bytes", INTEGER, "its payload", "bytes"),
            Field("began_ms", INTEGER, "when it began", "agent ms"),
            Field("lasted_ms", INTEGER, "the duration of its transmission", "agent ms"),
            Field("timeslot", _or_null(INTEGER), "the timeslot in which it began; null without timeslots"),
            Field("unsent", _or_null(TEXT), "why it was not sent; null for a sent one"),
            Field(
                "heard",
                _list_of(_row(INTEGER, TEXT, NUMBER, INTEGER, NUMBER, NUMBER)),
                "at each listener: id (another aPad is -n, the n-th), outcome, SNR, end, travel time, way",
                "dB, agent ms, ms, m",
            ),
            Field("data", TEXT, "its payload, in hexadecimal"),
        ),
    ),
    Kind(
        EventKind.FIX,
        "ranges gave an aMussel's place",
        (
            *(_ID, _NORTH, _EAST),
            Field("covariance", _list_of(NUMBER), "north, north-east, east", "m^2"),
            Field("hdop", NUMBER, "dilution of precision, of the geometry"),
            Field("residual_m", NUMBER, "root mean square of the ranges' residuals", "m"),
            Field("ranges", INTEGER, "number of ranges used"),
        ),
    ),
    Kind(
        EventKind.LINKS,
        "the file of links between modems changed",
        (
            Field(
                "rules",
                _or_null(
                    _list_of(_row(_or_null(INTEGER), _or_null(INTEGER), NUMBER, INTEGER, _or_null(INTEGER)))
                ),
                "from, to, loss, since, until; null when the file could not be read",
                "0 to 1, agent ms",
            ),
            Field("problem", _or_null(TEXT), "why it could not be read"),
        ),
    ),
    Kind(
        EventKind.MODEM,
        "a physical or opened modem dropped a packet, or changed",
        (
            _optional(Field("dropped", TEXT, "why it dropped a packet")),
            _optional(Field("id", _or_null(INTEGER), "the aMussel of that packet")),
            _optional(Field("what", TEXT, "what happened")),
        ),
    ),
    Kind(
        EventKind.RESUMED,
        "another supervisor continues the run",
        (
            Field("journal_dropped", INTEGER, "lines of the journal that could not be read"),
            Field("journal_torn_bytes", INTEGER, "of a torn last line", "bytes"),
            Field(
                "bag_repaired",
                _or_null(
                    _object(
                        "repair",
                        *(Field("name", TEXT, ""), Field("messages", INTEGER, "")),
                        *(Field("last_ms", INTEGER, ""), Field("torn_bytes", INTEGER, "")),
                    )
                ),
                "the bag that was never closed; null if there was none",
            ),
            Field("bag_lost_ms", INTEGER, "samples that are lost from its end", "mission ms"),
        ),
    ),
    Kind(
        EventKind.RESTORED,
        "the knowledge that this supervisor restored",
        (Field("told", _list_of(TEXT), "the lines printed for people"),),
    ),
    *map(_kind_of, EVENTS.values()),
)

_BY_KIND = {str(it.kind): it for it in KINDS}
_ALLOWED = {str(it.kind): frozenset(field.name for field in it.fields) for it in KINDS}


@cache
def _check_of(kind: str) -> SchemaValidator | None:
    """Made when the first line of its kind comes: most runs have few kinds. None for a line without fields."""
    found = _BY_KIND.get(kind)
    if found is None or not found.fields:
        return None
    model = _model(kind, found.fields)
    model.model_rebuild()
    check: SchemaValidator = model.__pydantic_validator__
    return check


def fault_of(kind: str, data: Mapping[str, Any]) -> str | None:
    """The fault of a line that was read; None for a line without fault, and for one of a kind unknown here."""
    check = _check_of(kind)
    if check is None:
        return None
    try:
        check.validate_python(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        is_missing = first["type"] == "missing" and len(first["loc"]) == 1
        return f"a line `{kind}` {'without' if is_missing else 'with a wrong'} `{first['loc'][0]}`"
    return None


def refuse_wrong(kind: str, data: Mapping[str, Any]) -> None:
    """Raises ValueError for an event that is not of the table: a mistake of the code that writes it."""
    if kind not in _BY_KIND:
        raise ValueError(f"`{kind}` is no kind of event: add it to apad_bridge/events.py")
    if not _BY_KIND[kind].is_open and (unknown := data.keys() - _ALLOWED[kind]):
        raise ValueError(f"`{kind}` has a field that its table does not: {', '.join(sorted(unknown))}")
    if (fault := fault_of(kind, data)) is not None:
        raise ValueError(f"{fault}: {dict(data)!r}")
