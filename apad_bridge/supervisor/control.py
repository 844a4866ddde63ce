"""A person's orders to the supervisor of a run, through a socket in the run's directory.

A command connects, writes one request as a line of JSON and reads one answer. A thread of the supervisor's process takes
the request and puts it on the call queue, so the supervisor's own thread acts on it at the next tick. Any process of the
same user may give orders, and nobody else.
"""

from __future__ import annotations

import os
import socket
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, TypeAdapter, ValidationError

from agents.nursery.protocol import is_of_our_user
from apad_bridge.events.guards import StopState
from apad_bridge.events.persons import PersonOrdered, Remarked
from apad_bridge.events.run import EndReason
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.flight_mission import FLIES_ALREADY, FlightMission
from apad_bridge.mission.orders import AllowMotion, GoBackIn, StopVehicle
from apad_bridge.mission.state import MissionEnd
from apad_bridge.mission.values import Refused
from apad_bridge.supervisor.amussel_orders import NO_AMUSSELS, AMusselOrders, AMusselRequest
from apad_bridge.supervisor.control_client import SOCKET_NAME, Act, Answer, Request, answer_of, short_path
from apad_bridge.supervisor.line_server import LineServer
from apad_bridge.vehicle.commands import GoTo, Hold
from apad_bridge.vehicle.guards.stops import StopRecord, StopsEnded

if TYPE_CHECKING:
    from apad_bridge.vehicle.guards.gate import Gate

TICK_S = 3.0
"""A person who stops is told after so many wall seconds that no tick came, and that only the vehicle's switch helps."""
TOLD_S = 6.0
"""A stop is reported after so many wall seconds, whatever came of it. A vehicle that takes none shows after 3 s."""
NOTHING_STOPPED = "nothing was stopped: there is nothing to continue"


def _in_range(request: Request) -> Request:
    if request.mistake:
        raise ValueError(request.mistake)
    return request


AnyRequest = Annotated[Request, AfterValidator(_in_range)] | AMusselRequest
_REQUEST: TypeAdapter[AnyRequest] = TypeAdapter(AnyRequest)
_ANSWER = TypeAdapter(Answer)


def carry_out(
    request: AnyRequest, calls: CallQueue, gate: Gate, amussels: AMusselOrders = NO_AMUSSELS
) -> Answer:
    """Has the supervisor carry the request out at its next tick. It answers within `ANSWER_S`.

    The vehicle's `gate` judges a go-to or a hold before the mission loses the aPad to it.
    """
    if isinstance(request, AMusselRequest):
        try:
            return Answer(True, amussels.carry_out(request, calls))
        except Refused as refused:
            return Answer(False, str(refused))

    if request.act in (Act.STOP, Act.HANDS):
        return _stop(request, calls, gate)

    def act(mission: FlightMission) -> str:
        if request.act is Act.REMARK:
            mission.tell(Remarked(request.text, request.by))
            return ""
        if request.act is Act.GO_TO or request.act is Act.HOLD:
            _move(request, mission, gate)
            return ""
        if request.act is Act.CONTINUE:
            return _continue(request, mission, gate)
        if request.act is Act.BACK_IN:
            return _back_in(request, mission, gate)
        assert request.act is Act.ABORT
        mission.tell(PersonOrdered(request.act.value, request.by))
        mission.finish(MissionEnd(EndReason.CALL, f"{EndReason.CALL}: abort by {request.by}"))
        return ""

    try:
        return Answer(True, calls.call_mission(act))
    except Refused as refused:
        return Answer(False, str(refused))


def _stop(request: Request, calls: CallQueue, gate: Gate) -> Answer:
    """Stops the vehicle, and waits until it has taken that. The stop does not need the mission's leave, or a position."""

    def act(mission: FlightMission) -> int:
        before = 0 if gate.stops.newest is None else gate.stops.newest.number
        mission.tell(PersonOrdered(request.act.value, request.by))
        mission.order(StopVehicle(request.by, off=request.off, hands=request.act is Act.HANDS))
        with suppress(Refused):  # the vehicle stops, whatever the mission says
            mission.stop()
        return before

    try:
        before = calls.call_mission(act, TICK_S, stays=True)
    except Refused as refused:
        return Answer(False, str(refused))
    until_s = time.monotonic() + TOLD_S
    while (stop := gate.stops.newest) is None or stop.number <= before or not _is_decided(stop):
        left_s = until_s - time.monotonic()
        if left_s <= 0 or calls.ended_by is not None:
            break
        calls.wait(left_s)
    if stop is None or stop.number <= before:
        return Answer(
            False, "the stop did not reach the vehicle: no mission tick came, or the mission has ended"
        )
    return _told(stop)


def _is_decided(stop: StopRecord) -> bool:
    return stop.state in (StopState.TAKEN, StopState.AT_REST, StopState.NOT_TAKEN, StopState.REFUSED)


def _told(stop: StopRecord) -> Answer:
    is_taken = stop.taken_ms is not None
    why = stop.refused or stop.not_taken
    times_ms = {"sent": stop.sent_ms, "taken": stop.taken_ms, "at rest": stop.rest_ms}
    after_s = {name: (at - stop.ordered_ms) / 1000 for name, at in times_ms.items() if at is not None}
    message = "" if is_taken else why or "the vehicle has not taken the stop yet"
    return Answer(is_taken, message, stop.number, stop.kind.value, stop.state.value, after_s)


def _continue(request: Request, mission: FlightMission, gate: Gate) -> str:
    if why_not := gate.why_not_continue(request.stop, mission.now_ms, pilot_left=request.pilot_left):
        raise Refused(why_not)
    is_held = bool(gate.awaits_person or gate.pilot)
    if not (is_held or mission.waits):
        raise Refused(NOTHING_STOPPED)
    told = mission.go_on(AllowMotion(request.by, pilot_left=request.pilot_left))
    mission.tell(PersonOrdered(request.act.value, request.by))
    return "" if told == FLIES_ALREADY else told


def _back_in(request: Request, mission: FlightMission, gate: Gate) -> str:
    if not request.lookout.strip():
        raise Refused("the way back inside needs a lookout: name the person who watches the water")
    _, why_not = gate.way_back(mission.now_ms)
    if why_not:
        raise Refused(why_not)
    mission.tell(PersonOrdered(request.act.value, request.by))
    mission.order(GoBackIn(request.by, request.lookout))
    return ""


def _move(request: Request, mission: FlightMission, gate: Gate) -> None:
    """A go-to or a hold, as by a person who takes the aPad over. Where a guard objects, it changes nothing."""
    if request.goal_m is None:
        raise Refused(f"an order to {request.act} needs a goal")
    north_m, east_m = request.goal_m
    target = mission.go_to_target(north_m, east_m, request.speed_m_s)
    command: GoTo | Hold = Hold(0, north_m, east_m)
    if request.act is Act.GO_TO:
        command = GoTo(0, north_m, east_m, target.speed_m_s, target.victory_radius_m)
    if (refusal := gate.refusal(command, mission.now_ms, is_persons=True)) is not None:
        gate.note_refused(command, refusal)
        raise Refused(f"refused: {refusal.reason}")
    mission.order(AllowMotion(request.by, ends=StopsEnded.PERSONS_HOLD))
    mission.tell(PersonOrdered(request.act.value, request.by, north_m=north_m, east_m=east_m))
    if request.act is Act.GO_TO:
        mission.go_to(north_m, east_m, request.speed_m_s)
    else:
        mission.hold(north_m, east_m)


@contextmanager
def control_offered(
    run_dir: Path, calls: CallQueue, gate: Gate, *, amussels: AMusselOrders = NO_AMUSSELS
) -> Iterator[Counter[str]]:
    """Listens in the run's directory while it is entered; yields the counts of dropped requests, by reason.

    For the process that holds the run's lock: a socket that is there already is a dead supervisor's.
    """
    dropped: Counter[str] = Counter()

    def admits(link: socket.socket) -> bool:
        if is_of_our_user(link):
            return True
        dropped["orders of another user"] += 1
        return False

    def answered(line: bytes) -> bytes:
        try:
            request = _REQUEST.validate_json(line)
        except ValidationError as error:
            dropped["orders that cannot be read"] += 1
            return refused_line(_unreadable(error))
        return _ANSWER.dump_json(carry_out(request, calls, gate, amussels))

    with short_path(run_dir) as path:
        with suppress(FileNotFoundError):
            os.unlink(path)
        server = LineServer(path, answered, admits)
    try:
        yield dropped
    finally:
        server.close()
        (run_dir / SOCKET_NAME).unlink(missing_ok=True)


def answered_line(run_dir: Path, line: bytes) -> bytes:
    """The answer's line to a request's line that came by another road than the run's socket."""
    try:
        request = _REQUEST.validate_json(line)
    except ValidationError as error:
        return refused_line(_unreadable(error))
    return _ANSWER.dump_json(answer_of(run_dir, request))


def refused_line(why: str) -> bytes:
    return _ANSWER.dump_json(Answer(False, why))


def _unreadable(error: ValidationError) -> str:
    return f"the request cannot be read: {error.errors()[0]['msg']}"
