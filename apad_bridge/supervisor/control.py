"""A person's orders to the supervisor of a run, through a socket in the run's directory.

A command connects, writes one request as a line of JSON and reads one answer. A thread of the supervisor's process takes
the request and puts it on the call queue, so the supervisor's own thread acts on it at the next tick. Any process of the
same user may give orders, and nobody else.
"""

from __future__ import annotations

import os
import socket
import socketserver
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, assert_never

from pydantic import Field, FiniteFloat, TypeAdapter, ValidationError

from agents.nursery.protocol import is_of_our_user
from apad_bridge.mission.call_queue import ANSWER_S, CallQueue, FlightMission
from apad_bridge.mission.ending import EndReason, MissionEnd
from apad_bridge.mission.orders import AllowMotion, SwitchMotorsOff
from apad_bridge.mission.values import Refused
from apad_bridge.supervisor.amussel_orders import NO_AMUSSELS, AMusselOrders, AMusselRequest
from apad_bridge.vehicle.commands import GoTo, Hold
from apad_bridge.vehicle.errors import PeerFailed

if TYPE_CHECKING:
    from apad_bridge.vehicle.guards.gate import Gate

SOCKET_NAME = "control.sock"
_MOTORS_OFF = "motors off"
LONGEST_REMARK = 2000
"""Characters."""
LONGEST_LINE = 16_384
_CLIENT_S = 5.0
"""A client that writes nothing for so many wall seconds is left."""


class Act(StrEnum):
    STOP = "stop"
    CONTINUE = "continue"
    ABORT = "abort"
    REMARK = "remark"
    GO_TO = "go to"
    HOLD = "hold"


@dataclass(frozen=True, slots=True)
class Request:
    act: Act
    by: Annotated[str, Field(min_length=1, max_length=100)]
    """The person's name."""
    text: Annotated[str, Field(max_length=LONGEST_REMARK)] = ""
    """The remark."""
    motors_off: bool = False
    """After an abort the controllers of the aPad go off, where it has an order for that; else a pilot is called."""
    goal_m: tuple[FiniteFloat, FiniteFloat] | None = None
    """The goal (north, east) of a go-to or a hold, which need one."""
    speed_m_s: FiniteFloat | None = None
    """The speed of a go-to; None: the scenario's."""


@dataclass(frozen=True, slots=True)
class Answer:
    accepted: bool
    message: str
    """Why it was refused, or that it changed nothing; empty for an order that was carried out."""


class NobodyListens(Exception):
    """No supervisor of the run takes orders."""


AnyRequest = Request | AMusselRequest
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

    def act(mission: FlightMission) -> str:
        if request.act is Act.REMARK:
            mission.note("remark", text=request.text, by=request.by)
            return ""
        if request.act is Act.GO_TO or request.act is Act.HOLD:
            _move(request, mission, gate)
            return ""
        mission.note("operator", order=request.act.value, by=request.by)
        match request.act:
            case Act.STOP:
                return mission.stop()
            case Act.CONTINUE:
                mission.order(AllowMotion())
                return mission.go_on()
            case Act.ABORT:
                mission.finish(MissionEnd(EndReason.CALL, f"{EndReason.CALL}: abort by {request.by}"))
                if request.motors_off:  # after the hold with which every mission ends
                    mission.note("operator", order=_MOTORS_OFF, by=request.by)
                    mission.order(SwitchMotorsOff(request.by))
                return ""
            case _:
                assert_never(request.act)

    try:
        return Answer(True, calls.call_mission(act))
    except Refused as refused:
        return Answer(False, str(refused))


def _move(request: Request, mission: FlightMission, gate: Gate) -> None:
    """A go-to or a hold, as by a person who takes the aPad over. Where a guard objects, it changes nothing."""
    if request.goal_m is None:
        raise Refused(f"an order to {request.act} needs a goal")
    north_m, east_m = request.goal_m
    target = mission.go_to_target(north_m, east_m, request.speed_m_s)
    command: GoTo | Hold = Hold(0, north_m, east_m)
    if request.act is Act.GO_TO:
        command = GoTo(0, north_m, east_m, target.speed_m_s, target.victory_radius_m)
    if (refusal := gate.refusal(command, mission.now_ms)) is not None:
        gate.note_refused(command, refusal)
        raise Refused(f"refused: {refusal.reason}")
    mission.note("operator", order=request.act.value, by=request.by, north_m=north_m, east_m=east_m)
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
    with short_path(run_dir) as path:
        with suppress(FileNotFoundError):
            os.unlink(path)
        server = _Server(path, calls, gate, amussels)
    thread = threading.Thread(target=server.serve_forever, name="control", daemon=True)
    thread.start()
    try:
        yield server.dropped
    finally:
        server.shutdown()
        server.server_close()
        (run_dir / SOCKET_NAME).unlink(missing_ok=True)


def listens(run_dir: Path) -> bool:
    """True while the run has a supervisor that takes orders."""
    try:
        with _connected(run_dir, _CLIENT_S):
            return True
    except NobodyListens:
        return False
    except BlockingIOError:  # the queue of a supervisor that is there is full
        return True


def ask(run_dir: Path, request: AnyRequest) -> Answer:
    """The supervisor's answer. NobodyListens without a supervisor; PeerFailed if it does not answer in time."""
    try:
        # The supervisor itself answers within ANSWER_S, so silence for longer is not the mission's.
        with _connected(run_dir, ANSWER_S + _CLIENT_S) as link:
            link.sendall(_REQUEST.dump_json(request) + b"\n")
            line = link.makefile("rb").readline(LONGEST_LINE)
            return _ANSWER.validate_json(line)
    except (OSError, ValidationError) as error:
        raise PeerFailed(f"the supervisor of {run_dir} does not answer: {error}") from error


def answer_of(run_dir: Path, request: AnyRequest) -> Answer:
    """Like `ask`, with a refusal in place of an error."""
    try:
        return ask(run_dir, request)
    except NobodyListens:
        return Answer(False, "no supervisor takes orders: the run has ended, or its supervisor died")
    except PeerFailed as error:
        return Answer(False, str(error))


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


@contextmanager
def _connected(run_dir: Path, timeout_s: float) -> Iterator[socket.socket]:
    """A link to the run's supervisor; NobodyListens without one."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
        link.settimeout(timeout_s)
        try:
            with short_path(run_dir) as path:
                link.connect(path)
        except (FileNotFoundError, ConnectionRefusedError) as error:
            raise NobodyListens(str(run_dir)) from error
        yield link


@contextmanager
def short_path(run_dir: Path) -> Iterator[str]:
    """A path within a Unix socket's 107 bytes; a run directory's may be longer."""
    directory = os.open(run_dir, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{directory}/{SOCKET_NAME}"
    finally:
        os.close(directory)


class _Server(socketserver.ThreadingUnixStreamServer):
    """A thread for each client, so that a silent one delays nobody's stop."""

    request_queue_size = 64
    daemon_threads = True
    block_on_close = False

    def __init__(self, path: str, calls: CallQueue, gate: Gate, amussels: AMusselOrders) -> None:
        self.calls = calls
        self.gate = gate
        self.amussels = amussels
        self.dropped: Counter[str] = Counter()
        super().__init__(path, _Handler)

    def verify_request(self, request: object, client_address: object) -> bool:
        assert isinstance(request, socket.socket)
        if is_of_our_user(request):
            return True
        self.dropped["orders of another user"] += 1
        return False


class _Handler(socketserver.StreamRequestHandler):
    timeout = _CLIENT_S
    server: _Server

    def handle(self) -> None:
        with suppress(OSError):  # the client left: its order stands
            if not (line := self.rfile.readline(LONGEST_LINE)):
                return  # it looked whether anybody listens
            try:
                request = _REQUEST.validate_json(line)
            except ValidationError as error:
                self.server.dropped["orders that cannot be read"] += 1
                answer = Answer(False, _unreadable(error))
            else:
                answer = carry_out(request, self.server.calls, self.server.gate, self.server.amussels)
            self.wfile.write(_ANSWER.dump_json(answer) + b"\n")
