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
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, TypeAdapter, ValidationError

from agents.nursery.protocol import is_of_our_user
from apad_bridge.events.guard_events import DOES_NOT_OBEY, StopState
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.person_events import PersonOrdered, Remarked, SpeedChanged
from apad_bridge.events.person_orders import Act
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.flight_mission import FLIES_ALREADY, FlightMission
from apad_bridge.mission.orders import AllowMotion, GoBackIn, StopVehicle
from apad_bridge.mission.script_values import Refused
from apad_bridge.supervisor.amussel_orders import NO_AMUSSELS, AMusselOrders, AMusselRequest
from apad_bridge.supervisor.control_protocol import SOCKET_NAME, Answer, Request, answer_of, short_path
from apad_bridge.supervisor.line_server import LineServer
from apad_bridge.vehicle.commands import GoTo, Hold
from apad_bridge.vehicle.guards.stops import StopRecord, StopsEnded

if TYPE_CHECKING:
    from apad_bridge.supervisor.clock import FlightSpeed
    from apad_bridge.vehicle.guards.gate import Gate

TICK_S = 3.0
"""A person who stops is told after so many wall seconds that no tick came, and that only the vehicle's switch helps."""
_STANDS_S = 0.1
"""Nobody waits for a tick while mission time stands still."""
REPORTED_S = 8.0
"""A stop is reported after so many wall seconds, whatever came of it. A vehicle that takes none shows after 3 s, and a hull
that does not slow 3 to 5 s after it has taken the stop."""
LOOK_S = 0.2
"""A stop's state is looked at so often, in wall seconds."""
_NO_SPEED = "only a simulated aPad on the run's own master has a speed to change; to stop the aPad: musselbed stop RUN"
_STANDS = "mission time stands still: `musselbed speed RUN 1` or `musselbed speed RUN step` first"
NOTHING_STOPPED = "nothing was stopped: there is nothing to continue"


def _in_range(request: Request) -> Request:
    if request.mistake:
        raise ValueError(request.mistake)
    return request


AnyRequest = Annotated[Request, AfterValidator(_in_range)] | AMusselRequest
_REQUEST: TypeAdapter[AnyRequest] = TypeAdapter(AnyRequest)
_ANSWER = TypeAdapter(Answer)


def carry_out(
    request: AnyRequest,
    calls: CallQueue,
    gate: Gate,
    amussels: AMusselOrders = NO_AMUSSELS,
    speed: FlightSpeed | None = None,
) -> Answer:
    """Has the supervisor carry the request out at its next tick. It answers within `ANSWER_S`.

    The vehicle's `gate` judges a go-to or a hold before the mission loses the aPad to it. `speed` is that of a flight whose
    time a person may change.
    """
    try:
        return _carried_out(request, calls, gate, amussels, speed)
    except Refused as refused:
        return Answer(False, str(refused))


def _carried_out(
    request: AnyRequest, calls: CallQueue, gate: Gate, amussels: AMusselOrders, speed: FlightSpeed | None
) -> Answer:
    if isinstance(request, Request) and request.act is Act.SPEED:
        return _change_speed(request, calls, speed)
    stands = speed is not None and speed.stands
    if stands and not (isinstance(request, Request) and request.act in (Act.STOP, Act.HANDS)):
        raise Refused(_STANDS)
    if isinstance(request, AMusselRequest):
        return Answer(True, amussels.carry_out(request, calls))
    if request.act in (Act.STOP, Act.HANDS):
        # A simulated hull stands with the time: its stop goes out with the next tick, before it moves.
        return _stop(request, calls, gate, _STANDS_S if stands else TICK_S)

    def told(mission: FlightMission) -> Answer:
        if request.act in _MOVES and mission.is_being_stopped:
            raise Refused("a stop was ordered at this very moment: nothing moves by a word that came with it")
        message = _IN_TICK[request.act](request, mission, gate) or ""
        return Answer(True, message, steers="" if request.act in (Act.ABORT, Act.REMARK) else mission.steers)

    return calls.call_mission(told)


def _change_speed(request: Request, calls: CallQueue, speed: FlightSpeed | None) -> Answer:
    """A change is journaled in the tick before it, or in the next one if time stands."""
    if speed is None:
        raise Refused(_NO_SPEED)
    steps, times = request.times is None, 0.0 if request.times is None else request.times
    if steps and not speed.stands:
        raise Refused("a step takes `musselbed speed RUN 0` first")
    note = SpeedChanged(times, request.by)

    change: Callable[[], object] = speed.step if steps else partial(speed.change, times)

    def act(mission: FlightMission) -> None:
        mission.emit(note)
        change()

    if not speed.stands:
        calls.call_mission(act)
    else:
        change()
        if times or steps:
            calls.call_mission(lambda mission: mission.emit(note))
    return Answer(
        True, f"the flight's speed is {times:g} times real time" if times else "mission time stands still"
    )


def _stop(request: Request, calls: CallQueue, gate: Gate, patience_s: float) -> Answer:
    """Stops the vehicle, and waits until the hull slows. The stop does not need the mission's leave, or a position."""

    def act(mission: FlightMission) -> tuple[int, str]:
        before = 0 if gate.stops.newest is None else gate.stops.newest.number
        mission.emit(PersonOrdered(request.act.value, request.by))
        mission.order(StopVehicle(request.by, off=request.off, hands=request.act is Act.HANDS))
        with suppress(Refused):  # the vehicle stops, whatever the mission says
            mission.stop()
        return before, mission.steers

    before, steers = calls.call_mission(act, patience_s, stays=True)
    until_s = time.monotonic() + REPORTED_S
    while (stop := gate.stops.newest) is None or stop.number <= before or not _is_decided(stop):
        left_s = until_s - time.monotonic()
        if left_s <= 0 or calls.ended_by is not None:
            break
        calls.wait(min(left_s, LOOK_S))
    if stop is None or stop.number <= before:
        raise Refused("the stop did not reach the vehicle: no mission tick came, or the mission has ended")
    return _stop_answer(stop, steers)


def _is_decided(stop: StopRecord) -> bool:
    is_open = stop.state in (StopState.ORDERED, StopState.SENT, StopState.TAKEN)
    return not is_open or bool(stop.unobserved)


def _stop_answer(stop: StopRecord, steers: str) -> Answer:
    """Done is a stop that the hull obeys. A vehicle that has taken it may go on all the same."""
    times_ms = {
        StopState.SENT: stop.sent_ms,
        StopState.TAKEN: stop.taken_ms,
        StopState.OBEYED: stop.obeyed_ms,
        StopState.AT_REST: stop.rest_ms,
    }
    after_s = {state.value: (at - stop.ordered_ms) / 1000 for state, at in times_ms.items() if at is not None}
    is_done = stop.obeyed_ms is not None
    message = "" if is_done else _why_not_done(stop)
    return Answer(
        accepted=is_done,
        message=message,
        stop=stop.number,
        mode=stop.kind.value,
        state=stop.state.value,
        after_s=after_s,
        steers=steers,
    )


def _why_not_done(stop: StopRecord) -> str:
    if stop.not_obeyed:
        return f"{DOES_NOT_OBEY}: {stop.not_obeyed}"
    if stop.taken_ms is None:
        return stop.refused or stop.not_taken or "the vehicle has not taken the stop yet"
    if stop.unobserved:
        return (
            f"the vehicle has taken the stop, and nobody can tell if it slows: look at it: {stop.unobserved}"
        )
    return "the vehicle has taken the stop, and has not slowed yet: look at it"


def _continue(request: Request, mission: FlightMission, gate: Gate) -> str:
    if why_not := gate.why_not_continue(request.stop, mission.now_ms, pilot_left=request.pilot_left):
        raise Refused(why_not)
    is_held = bool(gate.awaits_person or gate.pilot)
    if request.act is Act.CONTINUE and not (is_held or mission.waits):
        raise Refused(f"{NOTHING_STOPPED}; {mission.steers}")
    allowed = AllowMotion(request.by, _number_in_force(gate), pilot_left=request.pilot_left)
    if request.act is Act.GIVE_BACK:
        told = mission.give_back(allowed)
    else:
        told = ""
        mission.go_on(allowed)
    mission.emit(PersonOrdered(request.act.value, request.by))
    return "" if told == FLIES_ALREADY else told


def _back_in(request: Request, mission: FlightMission, gate: Gate) -> None:
    if not request.lookout.strip():
        raise Refused("the way back inside needs a lookout: name the person who watches the water")
    _, why_not = gate.way_back(mission.now_ms)
    if why_not:
        raise Refused(why_not)
    mission.emit(PersonOrdered(request.act.value, request.by))
    mission.order(GoBackIn(request.by, request.lookout))


def _remark(request: Request, mission: FlightMission, _: Gate) -> None:
    mission.emit(Remarked(request.text, request.by))


def _abort(request: Request, mission: FlightMission, _: Gate) -> None:
    mission.emit(PersonOrdered(request.act.value, request.by))
    mission.finish(MissionEnd(EndReason.CALL, f"{EndReason.CALL}: abort by {request.by}"))


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
    word = (
        AllowMotion(request.by, _number_in_force(gate), ends=StopsEnded.PERSONS_HOLD),
        PersonOrdered(request.act.value, request.by, north_m=north_m, east_m=east_m),
    )
    if request.act is Act.GO_TO:
        mission.go_to(north_m, east_m, request.speed_m_s, word=word)
    else:
        mission.hold(north_m, east_m, word=word)


def _number_in_force(gate: Gate) -> int | None:
    stop = gate.stops.in_force
    return None if stop is None else stop.number


_IN_TICK: dict[Act, Callable[[Request, FlightMission, Gate], str | None]] = {
    Act.CONTINUE: _continue,
    Act.GIVE_BACK: _continue,
    Act.BACK_IN: _back_in,
    Act.ABORT: _abort,
    Act.REMARK: _remark,
    Act.GO_TO: _move,
    Act.HOLD: _move,
}
"""The acts that the supervisor's thread carries out within its next tick. Each may return what a person has to know."""
_MOVES = _IN_TICK.keys() - {Act.ABORT, Act.REMARK}
"""The acts after which the aPad may move."""


@contextmanager
def control_offered(
    run_dir: Path,
    calls: CallQueue,
    gate: Gate,
    *,
    amussels: AMusselOrders = NO_AMUSSELS,
    speed: FlightSpeed | None = None,
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
        return _ANSWER.dump_json(carry_out(request, calls, gate, amussels, speed))

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
