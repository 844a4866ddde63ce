"""Turns recorded messages into facts, by each message's own definition: of a bag, or of a graph that one listens to.

Both generations' topics are read, and musselbed's own. A field that a definition lacks leaves out what needs it, and
`missing` has one line about it.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

from agents.water.medium import PacketOutcome
from apad_bridge.assembly.stacks import adrift_ms
from apad_bridge.events.mission_events import PrimitiveChanged
from apad_bridge.field.field_log.log_facts import (
    AmusselCharged,
    AmusselPlaced,
    BatteryReading,
    BeliefsReport,
    EventReport,
    Held,
    LoggedFact,
    PacketLogged,
    PilotSteers,
    Posed,
    SoundEnded,
    Witness,
    Work,
    WorkBegan,
    WorkEnded,
)
from apad_bridge.records.bag import RecordedMessage, RecordedTypes, recorded_messages
from apad_bridge.records.bag_samples import BagUnreadable
from apad_bridge.ros_names.names import AMUSSEL, in_full, of_amussel, of_apad, ours
from apad_bridge.supervisor.packet_relay import RANGE
from apad_bridge.vehicle.generation_a.messages import GO_TO, PERCH, RELEASE, GoalCode
from apad_bridge.vehicle.generation_b.messages import PrimitiveStatus

_WORK_OF_GOAL = {GO_TO: Work.GO_TO, PERCH: Work.DOCK, RELEASE: Work.UNDOCK}
_WORK_OF_PRIMITIVE = {"go to point": Work.GO_TO, "dock": Work.DOCK, "undock": Work.UNDOCK}
_AMUSSEL_TOPIC = re.compile(rf"{AMUSSEL}(\d+)/(position|battery_level|position_static)$", re.ASCII)
_NUMBER = re.compile(r"\d+$", re.ASCII)
_OPEN = 0.5
"""`dock_out`: 1 for an open arm, 0 for a closed one."""
_HELD_SILENT_S = 3.0
"""`position_static` comes at 20 Hz; this long without it, a dock has let go, as the published release never says so."""
_RECEIVED = PacketOutcome.RECEIVED.name.lower()
_DEAF = frozenset(
    it.name.lower() for it in (PacketOutcome.CUT, PacketOutcome.IN_AIR, PacketOutcome.TRANSMITTING)
)
"""Outcomes of a packet that say nothing of the range: the listener could not have heard it at any."""
_PRE_EMPTED = frozenset({GoalCode.PREEMPTED, GoalCode.RECALLED, GoalCode.LOST})

Take = Callable[[float, Any], Iterable[LoggedFact]]


class FactReader:
    """Reads the topics of the aPad called `apad`, of the aMussels and of a supervisor, below `namespace`.

    `source` names the bag or the graph in errors. Messages of other topics are ignored.
    """

    def __init__(self, source: str, apad: str, namespace: str = "") -> None:
        self.missing: dict[tuple[str, str], str] = {}
        """By topic and md5, one line about the field that this definition lacks: other publishers may have it."""
        self.dropped: Counter[str] = Counter()
        self._source = source
        self._types = RecordedTypes(source)
        self._namespace = namespace
        self._goal_m: tuple[float, float] | None = None
        self._statuses = {Work.GO_TO: PrimitiveStatus.IDLE, Work.DOCK: PrimitiveStatus.IDLE}
        self._servo: WorkBegan | None = None
        """Generation B's own docking or undocking under way."""
        self._works = 0
        """Numbers works that have no key of their own."""
        self._keys: dict[Work, str] = {}
        """Generation B's works by the topic of their status."""
        self._reported_keys: dict[str, str] = {}
        """A supervisor's primitives by name."""
        self._held_s: dict[int, float] = {}
        """By aMussel in a dock by `position_static`, when that came last."""
        self._sample_held: frozenset[int] = frozenset()
        of_actions = {
            f"{of_apad(apad, action)}/{leaf}": take
            for action, leaf, take in (
                ("action_server", "goal", self._goal),
                ("action_server", "result", self._result),
                ("go2point", "goal", self._go_to_goal),
            )
        }
        of_vehicle = {
            of_apad(apad, leaf): take
            for leaf, take in {
                "position": self._position,
                "battery_level": self._battery,
                "goto_status": self._goto_status,
                "docking_status": self._docking_status,
                "dock_out": self._arms,
                "manual": self._manual,
            }.items()
        }
        of_supervisor = {
            ours(leaf): take
            for leaf, take in {
                "mission": self._event,
                "apad": self._sample,
                "heard": self._packet,
                "sound": self._sound,
                "beliefs": self._beliefs,
            }.items()
        }
        self._take: dict[str, Take] = {
            in_full(namespace, name): take for name, take in (of_actions | of_vehicle | of_supervisor).items()
        }

    @property
    def topics(self) -> list[str]:
        """The topics of the aPad and of the supervisor that are read."""
        return list(self._take)

    def amussel_topics(self, agent_ids: Iterable[int]) -> list[str]:
        """The topics of these aMussels that are read."""
        return [
            in_full(self._namespace, of_amussel(agent_id, leaf))
            for agent_id in agent_ids
            for leaf in ("position", "battery_level", "position_static")
        ]

    def reads(self, topic: str) -> bool:
        return topic in self._take or self._amussel_topic(topic) is not None

    def read(self, message: RecordedMessage) -> list[LoggedFact]:
        """The facts of one message, and those that silence tells. BagUnreadable as `RecordedTypes`."""
        topic, at_s = message.connection.topic, message.stamp_ns / 1e9
        facts = list(self._let_go_in_silence(at_s))
        key = topic, message.connection.md5
        if key in self.missing or not self.reads(topic):
            return facts
        content = self._types.read(message)
        try:
            if (take := self._take.get(topic)) is not None:
                facts += take(at_s, content)
            else:
                facts += self._of_amussel(topic, at_s, content)
        except AttributeError as error:
            field = error.name or str(error)
            self.missing[key] = (
                f"{self._source}: {topic} ({message.connection.kind.replace('/msg/', '/')}, md5 "
                f"{message.connection.md5}) has no field `{field}`: what needs it is left out"
            )
        except (ValueError, TypeError, LookupError):
            self.dropped[f"{topic}: no sense"] += 1
        return facts

    # The aPad, both generations.

    def _position(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        yield Posed(
            at_s, Witness.VEHICLE, _stamp_s(content), _finite(content.position.north, content.position.east)
        )

    def _battery(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        (percent,) = _finite(content.data)
        yield BatteryReading(at_s, Witness.VEHICLE, percent / 100)

    # Generation A.

    def _goal(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        goal, work = content.goal, _WORK_OF_GOAL.get(content.goal.id)
        if work is None:
            return
        place = goal.pose.position
        goal_m = _finite(place.x, place.y) if work is Work.GO_TO else None
        number = _NUMBER.search(goal.object)
        agent_id = None if number is None or work is Work.GO_TO else int(number[0])
        yield WorkBegan(at_s, Witness.VEHICLE, content.goal_id.id, work, goal_m, agent_id)

    def _result(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        code = GoalCode(content.status.status)
        is_done = code is GoalCode.SUCCEEDED
        missed = not is_done and code not in _PRE_EMPTED
        yield WorkEnded(at_s, Witness.VEHICLE, content.status.goal_id.id, is_done, missed)

    # Generation B.

    def _go_to_goal(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        point = content.goal.T2.point
        self._goal_m = _finite(point.x, point.y)
        return iter(())

    def _goto_status(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        yield from self._status(at_s, Work.GO_TO, Work.GO_TO, PrimitiveStatus(content.data))

    def _docking_status(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        for fact in self._status(at_s, Work.DOCK, Work.UNDOCK, PrimitiveStatus(content.data)):
            self._servo = fact if isinstance(fact, WorkBegan) else None
            yield fact

    def _arms(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        """Status and services' answers do not tell a docking from an undocking; but an arm opens at once for a docking,
        and for an undocking only after the camera's servo."""
        began = self._servo
        is_open = any(it > _OPEN for it in content.data)
        if began is not None and is_open and at_s - began.at_s < adrift_ms() / 2000:
            self._servo = None
            yield replace(began, work=Work.DOCK)

    def _status(
        self, at_s: float, topic: Work, work: Work, status: PrimitiveStatus
    ) -> Iterator[WorkBegan | WorkEnded]:
        before, self._statuses[topic] = self._statuses[topic], status
        if status is PrimitiveStatus.RUNNING and before is not PrimitiveStatus.RUNNING:
            self._works += 1
            goal_m, self._goal_m = self._goal_m, None
            key = self._keys[topic] = f"{topic.name} {self._works}"
            yield WorkBegan(at_s, Witness.VEHICLE, key, work, goal_m if work is Work.GO_TO else None)
        elif status is not PrimitiveStatus.RUNNING and before is PrimitiveStatus.RUNNING:
            key = self._keys.get(topic, "")
            yield WorkEnded(
                at_s, Witness.VEHICLE, key, status is PrimitiveStatus.DONE, status is PrimitiveStatus.IDLE
            )

    def _manual(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        yield PilotSteers(at_s, bool(content.data))

    # aMussels.

    def _amussel_topic(self, topic: str) -> re.Match[str] | None:
        before = in_full(self._namespace, AMUSSEL).removesuffix(AMUSSEL)
        return _AMUSSEL_TOPIC.match(topic.removeprefix(before)) if topic.startswith(before) else None

    def _of_amussel(self, topic: str, at_s: float, content: Any) -> Iterator[LoggedFact]:
        found = self._amussel_topic(topic)
        assert found is not None
        agent_id = int(found[1])
        match found[2]:
            case "position":
                yield AmusselPlaced(at_s, agent_id, _finite(content.position.north, content.position.east))
            case "battery_level":
                (percent,) = _finite(content.data)
                yield AmusselCharged(at_s, agent_id, min(1.0, max(0.0, percent / 100)))
            case _:
                yield from self._static(at_s, agent_id, is_held=content.status == 0)

    def _static(self, at_s: float, agent_id: int, *, is_held: bool) -> Iterator[LoggedFact]:
        if is_held and agent_id not in self._held_s:
            yield Held(at_s, Witness.VEHICLE, agent_id, True)
        elif not is_held and agent_id in self._held_s:
            yield Held(at_s, Witness.VEHICLE, agent_id, False)
        if is_held:
            self._held_s[agent_id] = at_s
        else:
            self._held_s.pop(agent_id, None)

    def _let_go_in_silence(self, at_s: float) -> Iterator[LoggedFact]:
        for agent_id, heard_s in list(self._held_s.items()):
            if at_s - heard_s > _HELD_SILENT_S:
                del self._held_s[agent_id]
                yield Held(heard_s, Witness.VEHICLE, agent_id, False)

    def _packet(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        if content.medium != RANGE:
            yield PacketLogged(at_s, content.agent, content.medium, bytes(content.data))

    def _sound(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        (range_m,) = _finite(content.range)
        if (outcome := content.message.partition(" ")[0]) not in _DEAF:
            yield SoundEnded(at_s, range_m, outcome == _RECEIVED)

    # A supervisor of ours.

    def _beliefs(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        yield BeliefsReport(at_s, content.mission_time_ms, tuple(content.agents))

    def _sample(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        yield Posed(at_s, Witness.SUPERVISOR, None, _finite(content.north, content.east))
        if isfinite(content.battery_fraction):
            yield BatteryReading(at_s, Witness.SUPERVISOR, content.battery_fraction)
        held = frozenset(int(it) for it in content.docks if it >= 0)
        for agent_id in sorted(held ^ self._sample_held):
            yield Held(at_s, Witness.SUPERVISOR, agent_id, agent_id in held)
        self._sample_held = held

    def _event(self, at_s: float, content: Any) -> Iterator[LoggedFact]:
        data = json.loads(content.data)
        yield EventReport(at_s, content.mission_time_ms, content.kind, data)
        if content.kind != PrimitiveChanged.kind or (work := _WORK_OF_PRIMITIVE.get(data["name"])) is None:
            return
        name, phase = data["name"], data["phase"]
        if phase == "started":
            self._works += 1
            self._reported_keys[name] = f"{name} {self._works}"
            goal_m = (data["north_m"], data["east_m"]) if work is Work.GO_TO else None
            yield WorkBegan(
                at_s, Witness.SUPERVISOR, self._reported_keys[name], work, goal_m, data.get("agent")
            )
        else:
            missed = phase == "nothing_caught" or "missed" in data.get("reason", "")
            key = self._reported_keys.get(name, name)
            yield WorkEnded(at_s, Witness.SUPERVISOR, key, phase == "succeeded", missed)


def facts_of(path: Path, apad: str, namespace: str = "") -> tuple[list[LoggedFact], list[str]]:
    """The facts of a bag in the order recorded, and a line for each definition that lacks a field.

    BagUnreadable, one line, for a bag that has nothing of this aPad; OSError.
    """
    reader = FactReader(str(path), apad, namespace)
    facts: list[LoggedFact] = []
    for message in recorded_messages(path):
        facts += reader.read(message)
    if not facts and not reader.missing:
        raise BagUnreadable(
            f"{path}: no message of {in_full(namespace, apad)} or of musselbed; is apad.name the name of this vehicle?"
        )
    return facts, list(reader.missing.values())


def _finite(*numbers: float) -> tuple[Any, ...]:
    if not all(isfinite(it) for it in numbers):
        raise ValueError(f"not finite: {numbers}")
    return tuple(float(it) for it in numbers)


def _stamp_s(content: Any) -> float | None:
    stamp = content.header.stamp
    return float(stamp.sec + stamp.nanosec / 1e9) or None
