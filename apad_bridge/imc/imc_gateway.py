"""Shows a run to consoles that speak IMC, such as Neptus, and takes their orders, until the run has ended.

A process of its own, as the browser's console is: it reads the journal as it grows, and orders go through the socket in the
run's directory. So a console takes no time from the supervisor, and is refused what any person is refused.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from agents.hosting.interrupts import received_by
from apad_bridge.analysis.replay.history import ShownEvent
from apad_bridge.imc import imc_messages
from apad_bridge.imc import protocol as imc
from apad_bridge.imc.console_orders import ConsoleOrder, ConsoleOrders, Unfit
from apad_bridge.imc.picture import RunPicture
from apad_bridge.imc.protocol import Message
from apad_bridge.imc.systems import RunNumber, System
from apad_bridge.imc.wire import Address, ImcConsole, ReceivedMessage, Wire
from apad_bridge.records.journal import await_beginning
from apad_bridge.records.run_directory import RunDirectory, new_folder
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor import control_protocol

# A log as the toolchain's own vehicles write it: `Data.lsf`, the packets that were sent and received, one after the other.
#
# A review of Neptus opens the folder. Its name is the time at which it was begun, as DUNE names its logs.
FOLDER = "imc"


class LsfLog:
    """Appends packets; they reach the file at `flush`. A kill can tear only the last one."""

    def __init__(self, run_dir: Path, begun_s: float) -> None:
        """Makes the log's folder below the run's directory. `begun_s` is Unix time."""
        begun = time.gmtime(begun_s)
        self.folder = new_folder(run_dir / FOLDER / time.strftime("%Y%m%d/%H%M%S", begun))
        self._file = (self.folder / "Data.lsf").open("xb")

    @property
    def name(self) -> str:
        """The log's name, as a review shows it."""
        return f"{self.folder.parent.name}/{self.folder.name}"

    def append(self, packet: bytes) -> None:
        self._file.write(packet)

    def append_received(self, message: Message, now_s: float) -> None:
        """Appends a message that was received, in this machine's byte order, at the time of its arrival.

        Its own time is that of another clock, and of a moment before the newest messages that were sent.
        """
        theirs = message.timestamp
        message.timestamp = now_s
        self.append(imc.packed(message))
        message.timestamp = theirs

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        self._file.close()


HEARTBEAT_S = 1.0
"""A console draws a system that was silent for 2 s as gone."""
ANNOUNCE_S = 10.0
_POLL_S = 0.2
_MOST_ORDERS = 8
"""Orders of which the supervisor's answer is awaited; more are refused."""
_MOST_STRANGERS = 20
_NEWEST_PACKETS = 64
_SUMMARY_S = 10.0
"""Wall seconds between the mission's end and its summary, after which the gateway ends without one."""


@dataclass(frozen=True, slots=True)
class GatewaySettings:
    """Addresses of a gateway and of its consoles."""

    listen: tuple[str, int | None]
    """None for the port that goes with the aPad's id."""
    consoles: tuple[ImcConsole, ...]
    multicast: bool = False
    """Announce by multicast too, and show the run to consoles that announce themselves so. It gives nobody orders."""


@dataclass(frozen=True, slots=True)
class _Answered:
    order: ConsoleOrder
    answer: control_protocol.Answer
    console: Address


class ImcGateway:
    """One run's gateway, which listens from the beginning; the run may begin later."""

    def __init__(
        self, run_dir: Path, scenario: Scenario, settings: GatewaySettings, tell: Callable[[str], None]
    ) -> None:
        """`tell` takes lines for a person. OSError for an address that cannot be used, RunDirectoryError for no ids."""
        self._run_dir = run_dir
        self._scenario = scenario
        self._report = tell
        self._frame = LocalFrame.about(scenario.area.origin)
        self._number = _number_of(run_dir, scenario)
        self._run_systems = self._number.systems
        self.apad = self._run_systems.apad(scenario.apad.name)
        systems = [self.apad, *map(self._run_systems.amussel, scenario.fleet.ids)]
        self._systems = {it.imc_id: it for it in systems}
        self._orders = ConsoleOrders(self._frame, self.apad.name)
        host, port = settings.listen
        listen = (host, self._run_systems.port(scenario.apad.name) if port is None else port)
        try:
            self._wire = Wire(listen, settings.consoles, multicast=settings.multicast)
        except OSError:
            self._number.close()
            raise
        self._newest_s = 0.0
        self._log = LsfLog(run_dir, time.time())
        self._answers: queue.SimpleQueue[_Answered] = queue.SimpleQueue()
        self._awaited = 0
        self._plan_id = ""
        self._takes_orders = False
        self._strangers: set[tuple[int, str]] = set()
        self._newest_orders: dict[bytes, None] = {}
        """The newest orders' packets: UDP may deliver one twice."""

    @property
    def address(self) -> Address:
        return self._wire.address

    @property
    def systems(self) -> dict[int, str]:
        """The names of all systems, by their ids."""
        return {imc_id: it.name for imc_id, it in self._systems.items()}

    @property
    def log_folder(self) -> Path:
        return self._log.folder

    @property
    def dropped(self) -> dict[str, int]:
        """The counts of what was dropped, by reason."""
        return dict(self._wire.dropped)

    def run(self, is_asked_to_end: Callable[[], bool]) -> str | None:
        """Shows the run until it ends, and returns why; or None when `is_asked_to_end` says so before it.

        RunDirectoryError for a run that cannot be read.
        """
        try:
            if not await_beginning(RunDirectory(self._run_dir), is_asked_to_end, self._report):
                return None
            picture = RunPicture(self._run_dir, self._scenario)
            try:
                return self._show(picture, is_asked_to_end)
            finally:
                picture.close()
        finally:
            self._log.close()
            self._wire.close()
            self._number.close()

    def _show(self, picture: RunPicture, is_asked_to_end: Callable[[], bool]) -> str | None:
        if self._number.was_taken:
            self._report("another run has the IMC ids and names that this run had: it has others now")
        self._record([imc_messages.logging_started(self._log.name), imc_messages.entity_list()])
        next_beat_s = next_announce_s = next_poll_s = 0.0
        end_seen_s: float | None = None
        while not is_asked_to_end():
            now_s = time.monotonic()
            if now_s >= next_poll_s:
                next_poll_s = now_s + _POLL_S
                self._show_events(picture.poll())
                self._show_samples(picture)
            if now_s >= next_beat_s:
                next_beat_s = now_s + HEARTBEAT_S
                self._takes_orders = control_protocol.listens(self._run_dir)
                if now_s >= next_announce_s:
                    next_announce_s = now_s + ANNOUNCE_S
                    self._announce(picture)
                self._beat(picture)
                self._log.flush()
            if picture.ended_by is not None:
                end_seen_s = end_seen_s or now_s
                if picture.has_summary or now_s > end_seen_s + _SUMMARY_S:
                    self._beat(picture)
                    return picture.ended_by
            for received in self._wire.receive(_POLL_S / 2):
                self._take(received)
            self._give_answers()
        return None

    def _announce(self, picture: RunPicture) -> None:
        services = self._wire.services
        if (apad := picture.apad) is not None:
            place = imc_messages.place_rad(self._frame, apad.north_m, apad.east_m)
            self._send(self.apad, [imc_messages.announce(self.apad, place, services)], announces=True)
        if len(picture.amussels) <= imc_messages.MOST_ANNOUNCED:
            for amussel in picture.amussels:
                system = self._run_systems.amussel(amussel.agent_id)
                place = imc_messages.place_rad(self._frame, amussel.north_m, amussel.east_m)
                self._send(system, [imc_messages.announce(system, place, services)], announces=True)

    def _beat(self, picture: RunPicture) -> None:
        """Everything that a console is to hear once a second."""
        self._send(self.apad, self._of_apad(picture))
        for amussel in picture.amussels:
            system = self._run_systems.amussel(amussel.agent_id)
            if len(picture.amussels) <= imc_messages.MOST_ANNOUNCED:
                self._send(system, [imc.Heartbeat(), *imc_messages.of_amussel(amussel, self._frame)])
            else:
                self._send(self.apad, imc_messages.reported(system.name, amussel, self._frame))

    def _of_apad(self, picture: RunPicture) -> Iterator[Message]:
        takes_orders = self._takes_orders
        yield imc.Heartbeat()
        if picture.apad is not None:
            yield from imc_messages.of_apad(picture.apad, self._frame)
        yield imc_messages.vehicle_state(picture, takes_orders=takes_orders)
        yield imc_messages.plan_control_state(picture, self._plan_id, takes_orders=takes_orders)

    def _show_events(self, events: Iterable[ShownEvent]) -> None:
        for event in events:
            entry = imc_messages.log_book_entry(
                event.text, self._now_s(), is_warning=event.category.is_trouble
            )
            self._send(self.apad, [entry])

    def _show_samples(self, picture: RunPicture) -> None:
        newest = {it.agent_id: it for it in picture.new_samples()}
        for agent_id, sample in newest.items():
            self._send(self._run_systems.amussel(agent_id), imc_messages.of_sample(sample))

    def _take(self, received: ReceivedMessage) -> None:
        message = received.message
        if isinstance(message, imc.Announce):
            self._wire.discover(received)
        elif isinstance(message, imc.EntityList) and message.op == imc.EntityList.OperationEnum.QUERY:
            self._answer_entities(received)
        elif _is_order(message):
            self._take_order(received)

    def _answer_entities(self, received: ReceivedMessage) -> None:
        """Answers as the system that is asked. A console asks each of them at its every Announce, until it is answered."""
        asked = self._systems.get(received.message.dst)
        if asked is not None and received.sender in self._wire.destinations:
            stamped = imc_messages.stamped(
                imc_messages.entity_list(), asked, self._now_s(), received.message.src
            )
            self._log.append(self._wire.send_to(stamped, received.sender))

    def _take_order(self, received: ReceivedMessage) -> None:
        message, dropped = received.message, self._wire.dropped
        if (why := self._wire.why_not_obeyed(received, self.apad.imc_id)) is not None:
            dropped[why] += 1
            stranger = (message.src, received.sender[0])
            if stranger not in self._strangers and len(self._strangers) < _MOST_STRANGERS:
                self._strangers.add(stranger)
                at = "{}:{}".format(*received.sender)
                self._report(f"dropped {why}: {message.msg_name} of {message.src:#06x} at {at}")
            return
        packet = imc.packed(message)
        if packet in self._newest_orders:
            dropped["an order that came twice"] += 1
            return
        self._newest_orders[packet] = None
        if len(self._newest_orders) > _NEWEST_PACKETS:
            del self._newest_orders[next(iter(self._newest_orders))]
        self._log.append_received(message, self._now_s())
        try:
            order = self._orders.take(message, f"IMC {message.src:#06x}", self._now_s())
        except (Unfit, ValueError) as unfit:
            entry = imc_messages.log_book_entry(
                f"{message.msg_name} refused: {unfit}", self._now_s(), is_warning=True
            )
            self._send_to(received.sender, entry, message.src)
            return
        if isinstance(order, ConsoleOrder):
            self._ask(order, received.sender)
        elif order is not None:
            self._send_to(received.sender, order, message.src)

    def _ask(self, order: ConsoleOrder, console: Address) -> None:
        """Has the supervisor answer in a thread of its own: a stop waits behind no go-to."""
        if self._awaited >= _MOST_ORDERS:
            refusal = control_protocol.Answer(False, "too many orders are awaiting their answer")
            self._send_to(console, order.answer(refusal), order.asked.src)
            return
        self._awaited += 1

        def ask() -> None:
            answer = control_protocol.answer_of(self._run_dir, order.request)
            self._answers.put(_Answered(order, answer, console))

        threading.Thread(target=ask, name="imc order", daemon=True).start()

    def _give_answers(self) -> None:
        while not self._answers.empty():
            answered = self._answers.get()
            self._awaited -= 1
            if answered.answer.accepted and answered.order.plan_id:
                self._plan_id = answered.order.plan_id
            self._send_to(answered.console, answered.order.answer(answered.answer), answered.order.asked.src)

    def _send(self, source: System, said: Iterable[Message], *, announces: bool = False) -> None:
        for message in said:
            stamped = imc_messages.stamped(message, source, self._now_s())
            self._log.append(self._wire.send(stamped, announces=announces))

    def _send_to(self, console: Address, message: Message, imc_id: int) -> None:
        stamped = imc_messages.stamped(message, self.apad, self._now_s(), imc_id)
        self._log.append(self._wire.send_to(stamped, console))

    def _record(self, said: Iterable[Message]) -> None:
        """Writes messages into the log alone."""
        for message in said:
            self._log.append(imc.packed(imc_messages.stamped(message, self.apad, self._now_s())))

    def _now_s(self) -> float:
        """Unix time, which never goes back: a machine's clock may be set back while it serves."""
        self._newest_s = max(self._newest_s, time.time())
        return self._newest_s


def serve(
    run_dir: Path,
    settings: GatewaySettings,
    listening: Callable[[ImcGateway], None],
    tell: Callable[[str], None],
) -> tuple[str | None, dict[str, int]]:
    """Runs a gateway until its run has ended, or SIGINT or SIGTERM comes.

    Returns why the run ended, None where it flies on, and the counts of what was dropped. `listening` is called once the
    gateway listens. RunDirectoryError for no run; OSError for an address that cannot be used.
    """
    scenario = RunDirectory.created(run_dir).load_scenario()
    asked_to_end = threading.Event()
    with received_by(asked_to_end.set):
        gateway = ImcGateway(run_dir, scenario, settings, tell)
        listening(gateway)
        return gateway.run(asked_to_end.is_set), gateway.dropped


def _number_of(run_dir: Path, scenario: Scenario) -> RunNumber:
    """The number of the whole run: that of one of several aPads lies above it."""
    if RunDirectory(run_dir.absolute().parent).scenario.is_file():
        run_dir = run_dir.absolute().parent
        scenario = load(RunDirectory(run_dir).scenario)
    return RunNumber(run_dir, scenario)


def _is_order(message: Message) -> bool:
    match message:
        case imc.Abort() | imc.Goto() | imc.StationKeeping():
            return True
        case imc.PlanControl() | imc.PlanDB():
            return bool(message.type == type(message).TypeEnum.REQUEST)
        case _:
            return False
