"""A million seeded malformed inputs to each door of the bench: no exception, no hang, no growth, no state lost.

The doors are the modem (serial line, sound, power), the packets, an agent's link both ways, the nursery's socket, ROS
messages, scenarios, journals, bags, and the console with the socket for orders. Inputs are noise, and whole ones that are
cut, mutated or run together. A door may refuse an input only in the way that it states.
"""

from __future__ import annotations

import asyncio
import gc
import json
import random
import resource
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractAsyncContextManager, ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack

from agents.fleet_config import resting_on_bottom
from agents.hosting import agent_links, link_protocol
from agents.hosting.host import Grant, Reply
from agents.modem.commands import GRAMMAR, CommandField
from agents.modem.facts import FrameArrived, PowerCame, PowerWent, SerialBytes, SerialOut, SoundBegan
from agents.modem.frames import (
    ANSWERS,
    PAYLOAD_BYTES,
    TO_ALL,
    V2_KINDS,
    WITH_DATA,
    FrameKind,
    ModemFrame,
    ModemGeneration,
)
from agents.modem.modem import Modem
from agents.modem.modem_model import ModemConfig, ModemFirmware
from agents.mussel.outputs import SoundSent, StimulusDropped, Truth, WifiSent
from agents.mussel.stimuli import ContactClosed, ContactOpened, DockMoved, SoundArrived
from agents.nursery import protocol as nursery
from agents.time_scale import MissionMs
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.console.server import ConsoleEnding, app_of
from apad_bridge.records.bag import recorded_messages, repair_bag
from apad_bridge.records.journal import JournalDamaged, read_journal
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import open_in_process, prepare
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.control_server import answered_line
from apad_bridge.supervisor.packet_relay import PacketOrigin, PacketRelay, whole_flight
from benchmarks.rows import told
from firmware_model import packets
from firmware_model.packets import AcousticStatus, CommandPacket, Kind, StatusPacket, WifiStatus
from firmware_model.packets.wire import sealed
from firmware_model.states import State

INPUTS = 1_000_000
MINUTES, SHORT_MINUTES = 5.0, 0.05
SEED = 20260101
SCENARIO = Path(__file__).parents[3] / "launch_scripts" / "scenarios" / "pool-12.yaml"
_KINDS = [*(int(kind) for kind in Kind), 0, 255]
_STATES = [int(state) for state in State]
_SIZES = (
    2,
    4,
    5,
    6,
    7,
    8,
    12,
    13,
    20,
    29,
    41,
    43,
    *(29 + it.TAIL.format.size for it in (AcousticStatus, WifiStatus)),
    130,
)
"""Sizes of bodies: most of them of some packet, the others of none."""
_SETTLED_MS = 10_000
"""Longer than any transmission with its deferral and the wait for an answer."""
_HANG_S = 30
"""Wall seconds in which no input may take a processor to its end, however busy the machine is."""
_RUN_S = 60
"""The flight whose records and console are tried."""
_TOKEN = "token"
_CONTACTS = (ContactClosed, DockMoved, ContactOpened)
"""The stimuli that a dock of another aPad causes."""


class Broken(AssertionError):
    """An input had an effect that no input may have."""


Door = Callable[[random.Random, Counter[str]], None]
"""Takes one input, and counts its outcome."""


def measure(
    tries: int = INPUTS, minutes: float = MINUTES, seed: int = SEED, short: bool = False
) -> dict[str, Any]:
    """Up to so many inputs to each door, for so many minutes at most. Broken, or the door's own error, at a failure."""
    minutes = SHORT_MINUTES if short else minutes
    return {"seed": seed, "rows": [told(tried(name, tries, minutes, seed)) for name in DOORS]}


def tried(name: str, tries: int, minutes: float = MINUTES, seed: int = SEED) -> dict[str, Any]:
    """One door's row. The first tenth of its inputs warm it up: growth is that of the resident memory after it."""
    rng, counts = random.Random(f"{seed} {name}"), Counter[str]()
    slowest_s, warm_kb, done = 0.0, 0, 0
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder, ExitStack() as stack, _no_hang():
        once = stack.enter_context(DOORS[name](Path(folder)))
        began_s = before_s = time.perf_counter()
        began_cpu_s = time.process_time()
        while done < tries and before_s < began_s + 60 * minutes:
            signal.setitimer(signal.ITIMER_VIRTUAL, _HANG_S)
            once(rng, counts)
            done += 1
            now_s = time.perf_counter()
            slowest_s, before_s = max(slowest_s, now_s - before_s), now_s
            if not warm_kb and (10 * done >= tries or now_s > began_s + 6 * minutes):
                warm_kb = _resident_kb()
        took_s = time.process_time() - began_cpu_s
    return {
        "door": name,
        "inputs": done,
        "inputs_per_processor_s": done / took_s,
        "slowest_ms": 1000 * slowest_s,
        "growth_kb": _resident_kb() - warm_kb,
        "came": dict(sorted(counts.items())),
    }


@contextmanager
def _no_hang() -> Iterator[None]:
    """Breaks an input that takes a processor for `_HANG_S`."""

    def broken(*_: object) -> None:
        raise Broken(f"an input took a processor for more than {_HANG_S} s")

    before = signal.signal(signal.SIGVTALRM, broken)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def _resident_kb() -> int:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() // 1024


@contextmanager
def _modems(_: Path) -> Iterator[Door]:
    """Modems of every firmware, in turn. After each input the modem must answer a valid command."""
    modems, turn = [_Fuzzed(firmware) for firmware in ModemFirmware], 0

    def once(rng: random.Random, counts: Counter[str]) -> None:
        nonlocal turn
        modems[turn % len(modems)].once(rng, counts)
        turn += 1

    yield once


class _Fuzzed:
    """One modem that gets a sequence of inputs."""

    def __init__(self, firmware: ModemFirmware) -> None:
        self._generation = firmware.generation
        self._modem = Modem(ModemConfig(firmware), 1)
        self._now_ms = 0
        self._address = 1

    def once(self, rng: random.Random, counts: Counter[str]) -> None:
        modem = self._modem
        printed: list[bytes] = []
        kind = rng.choice(("bytes", "bytes", "bytes", "frame", "power"))
        counts[f"modem: {kind}"] += 1
        if kind == "bytes":
            data = b"".join(_serial(rng, self._generation) for _ in range(rng.randint(1, 3)))
            cut = rng.randrange(len(data) + 1)
            self._stimulate(SerialBytes(data[:cut]), printed)
            self._now_ms += rng.choice((0, 1, 2, 3, 30, 400))
            self._stimulate(SerialBytes(data[cut:]), printed)
        elif kind == "frame":
            frame = _frame(rng)
            self._stimulate(SoundBegan(frame.duration_ms), printed)
            self._now_ms += rng.choice((0, 50, frame.duration_ms, 3000))
            arrived = FrameArrived(frame, rng.randrange(2_000_000), rng.uniform(-90, 200), rng.randrange(99))
            self._stimulate(arrived, printed)
        else:
            self._stimulate(PowerWent(), printed)
            self._stimulate(SerialBytes(_serial(rng, self._generation)), printed)
            self._stimulate(PowerCame(), printed)
        self._now_ms += _SETTLED_MS
        self._note(modem.advance(self._now_ms), printed)
        self._address = _confirmed_address(printed, self._address)
        self._answers(counts)

    def _stimulate(self, stimulus: Any, printed: list[bytes]) -> None:
        self._note(self._modem.receive(stimulus, self._now_ms), printed)

    def _note(self, actions: list[Any], printed: list[bytes]) -> None:
        printed += [action.data for action in actions if isinstance(action, SerialOut)]

    def _answers(self, counts: Counter[str]) -> None:
        printed: list[bytes] = []
        wakes = (b"$W", b"$W") if self._generation is ModemGeneration.V3 else ()
        for command in (*wakes, b"$?"):
            self._stimulate(SerialBytes(command), printed)
            self._now_ms += 100
            self._note(self._modem.advance(self._now_ms), printed)
        if not printed or not printed[-1].startswith(b"#A%03dV" % self._address):
            raise Broken(f"$? is answered with {printed[-1:]}, the address being {self._address}")
        if not all(answer.endswith(b"\r\n") for answer in printed):
            raise Broken(f"an answer without its end: {printed}")
        counts["modem: answered afterwards"] += 1


def _confirmed_address(printed: list[bytes], address: int) -> int:
    """The address that the modem has confirmed last: #Axxx alone on its line."""
    for answer in printed:
        if len(answer) == 7 and answer.startswith(b"#A"):
            address = int(answer[2:5])
    return address


def _serial(rng: random.Random, generation: ModemGeneration) -> bytes:
    name, fields = rng.choice(list(GRAMMAR[generation].items()))
    data = b"$" + name.encode()
    for field in fields:
        if field is CommandField.ADDRESS:
            data += b"%03d" % rng.choice((0, 1, 2, 255, 256, 999))
        elif field is CommandField.DATA:
            fewest, most = PAYLOAD_BYTES[generation]
            size = rng.randint(fewest, most)
            data += str(size).zfill(1 if generation is ModemGeneration.V2 else 2).encode() + rng.randbytes(
                size
            )
        elif rng.random() < 0.5:
            data += b"T%014d" % rng.randrange(3_000_000)
    return _spoiled(rng, data)


def _spoiled(rng: random.Random, data: bytes) -> bytes:
    """The bytes unchanged, cut, with one changed, with some inserted, or noise instead."""
    match rng.randrange(6):
        case 0:
            return data[: rng.randrange(len(data) + 1)]
        case 1:
            at = rng.randrange(len(data))
            return data[:at] + rng.randbytes(1) + data[at + 1 :]
        case 2:
            at = rng.randrange(len(data))
            return data[:at] + rng.randbytes(rng.randint(1, 4)) + data[at:]
        case 3:
            return rng.randbytes(rng.randrange(100))
        case _:
            return data


def _frame(rng: random.Random) -> ModemFrame:
    generation = rng.choice(list(ModemGeneration))
    kind = rng.choice(sorted(V2_KINDS) if generation is ModemGeneration.V2 else list(FrameKind))
    fewest, most = PAYLOAD_BYTES[generation] if kind in WITH_DATA else (0, 0)
    return ModemFrame(
        kind,
        rng.randrange(256),
        None if kind in TO_ALL else rng.choice((1, rng.randrange(256))),
        rng.randbytes(rng.randint(fewest, most)),
        generation,
        rng.randrange(2_000_000) if kind in ANSWERS else 0,
    )


def _packet(rng: random.Random, counts: Counter[str]) -> None:
    if rng.random() < 0.5:
        whole = CommandPacket(rng.choice((Kind.PERMISSION, Kind.RELEASE)), rng.randrange(65536)).encode()
    else:
        whole = StatusPacket(
            rng.randrange(65536),
            rng.randrange(65536),
            rng.choice(list(State)),
            rng.random(),
            rng.random(),
            rng.uniform(-20e3, 20e3),
            rng.uniform(-20e3, 20e3),
            rng.uniform(0, 650),
            rng.randrange(1 << 63),
        ).encode()
    data = _sealed_noise(rng) if rng.random() < 0.5 else _spoiled(rng, whole)
    packet = packets.decode(data)
    counts["packet: none" if packet is None else f"packet: {type(packet).__name__}"] += 1
    if data == whole and packet is None:
        raise Broken(f"a whole packet does not decode: {data.hex()}")
    if packet is not None and packet.encode() != data:
        raise Broken(f"{data.hex()} decodes to {packet}, which is {packet.encode().hex()}")


def _sealed_noise(rng: random.Random) -> bytes:
    """Any bytes of any kind with a correct checksum, so that the packet's content decides."""
    body = bytes([rng.choice((1, 2, rng.randrange(256))), rng.choice(_KINDS)])
    body += rng.randbytes(max(0, rng.choice(_SIZES) - len(body)))
    if rng.random() < 0.5 and len(body) > 6:
        body = body[:6] + bytes([rng.choice(_STATES)]) + body[7:]
    return sealed(body)


@contextmanager
def _packets(_: Path) -> Iterator[Door]:
    """The decoder; a packet that decodes must encode to the same bytes."""
    yield _packet


def _value(rng: random.Random, depth: int = 0) -> Any:
    """Plain data of any shape."""
    match rng.randrange(9 if depth < 4 else 6):
        case 0:
            return rng.choice((0, 1, -1, 2**31, 2**63, 2**64 - 1, -(2**63), rng.randrange(1 << 20)))
        case 1:
            return rng.choice((True, False, None))
        case 2:
            return rng.choice((0.0, -1.5, float("nan"), float("inf"), 1e308, 5e-324))
        case 3:
            return rng.randbytes(rng.randrange(20))
        case 4 | 5:
            return rng.choice(("", "x", "0", "\x00", "é\u202e", "A" * rng.randrange(300)))
        case 6:
            return {str(_value(rng, 9))[:8]: _value(rng, depth + 1) for _ in range(rng.randrange(4))}
        case _:
            return [_value(rng, depth + 1) for _ in range(rng.randrange(12))]


def _replaced(rng: random.Random, data: Any) -> Any:
    """The data with one value, at any depth, replaced or left out."""
    if isinstance(data, list | tuple) and data and rng.random() < 0.9:
        at = rng.randrange(len(data))
        changed = [] if rng.random() < 0.1 else [_replaced(rng, data[at])]
        return [*data[:at], *changed, *data[at + 1 :]]
    if isinstance(data, dict) and data and rng.random() < 0.9:
        key = rng.choice(sorted(data, key=str))
        rest = {name: it for name, it in data.items() if name != key}
        return rest if rng.random() < 0.1 else {**rest, key: _replaced(rng, data[key])}
    return _value(rng)


def _msgpack(rng: random.Random, whole: bytes) -> bytes:
    """A frame that is whole, spoiled as bytes, or packed again with another value in it; or one of any shape."""
    match rng.randrange(4):
        case 0:
            return _spoiled(rng, whole)
        case 1:
            return b"\x91" * rng.randrange(3000)
        case _:
            with suppress(OverflowError):
                return bytes(msgpack.packb(_replaced(rng, msgpack.unpackb(whole))))
            return whole


@contextmanager
def _agent_link(_: Path) -> Iterator[Door]:
    """An agent's link, both ways; an answer is put together from its parts, as the supervisor does."""
    facts = ((1, SoundArrived(b"abc")), (2, ContactClosed(1, 2)))
    to_agent = [
        link_protocol.WindowGrant((1, 2), Grant(100, facts)).encode(),
        link_protocol.WindowGrant((1, 3), Grant(100, facts), 40).encode(),
        link_protocol.Repeat((1, 2)).encode(),
        link_protocol.RunAhead((1, 2), 7, 100).encode(),
    ]
    reply = Reply(5, (WifiSent(1, 7, b"ab"), SoundSent(2, 7, b""), StimulusDropped(3, 7, "why")))
    truth = Truth(130, 7, State.ACTIVE, resting_on_bottom(1.0, 2.0, 3.0, 0.5, 1.0))
    from_agent = [
        *link_protocol.encode_answer((1, 2), (1, 2), 100, 3, reply),
        link_protocol.WindowRefusal((1, 2), False, "why").encode(),
        link_protocol.Ahead((1, 2), (link_protocol.AheadWindow(130, reply, (truth,)),)).encode(),
    ]

    def once(rng: random.Random, counts: Counter[str]) -> None:
        try:
            if rng.random() < 0.5:
                message: Any = link_protocol.decode_to_agent(_msgpack(rng, rng.choice(to_agent)))
            else:
                message = link_protocol.decode_from_agent(_msgpack(rng, rng.choice(from_agent)), 7)
                if isinstance(message, link_protocol.WindowAnswer):
                    agent_links._assemble(agent_links._Open((1, 2), b""), message)
        except link_protocol.LinkError:
            counts["refused"] += 1
        else:
            counts[type(message).__name__] += 1

    yield once


@contextmanager
def _nursery_socket(_: Path) -> Iterator[Door]:
    """The messages between a supervisor and its nursery; one that decodes must encode to what decodes alike."""
    wholes = [
        nursery.encode(it)
        for it in (
            nursery.Hello(3),
            nursery.StartAgents(1, ((1, 0, 0, 1, 1), (2, 5, 1, 1, 1))),
            nursery.Kill(1, 2),
            nursery.End(),
            nursery.ChildList(((1, 2, 3, 4, 5),)),
            nursery.StartRefused(1, 2, False, "why"),
        )
    ]

    def once(rng: random.Random, counts: Counter[str]) -> None:
        try:
            message = nursery.decode(_msgpack(rng, rng.choice(wholes)))
        except link_protocol.LinkError:
            counts["refused"] += 1
            return
        counts[type(message).__name__] += 1
        if nursery.decode(nursery.encode(message)) != message:
            raise Broken(f"{message} comes back as another one")

    yield once


@contextmanager
def _ros_messages(_: Path) -> Iterator[Door]:
    """Packets of other nodes: bytes that a publisher may send, and any content of a message that can be read."""
    import genpy

    from apad_bridge.ros.links.packet_topics import PacketTopics
    from apad_bridge.ros.types.messages import use_generated_messages

    use_generated_messages()
    from auv_msgs.msg import NavSts
    from diagnostic_msgs.msg import DiagnosticArray
    from musselbed_msgs.msg import Packet

    topics = PacketTopics(range(1, 13), ())
    relay = PacketRelay(whole_flight(frozenset), [topics.take], {})
    contacts = [[0, 1_000_000, 2_000_000], [1, 5, 5], [2], [8, 1], [7, 1, 2, 3, 4, 5]]

    def once(rng: random.Random, counts: Counter[str]) -> None:
        if rng.random() < 0.4:
            kind = rng.choice((Packet, NavSts, DiagnosticArray))
            buffer = _io(kind())
            try:
                kind().deserialize(_spoiled(rng, buffer))
                counts["bytes: read"] += 1
            except genpy.DeserializationError:
                counts["bytes: refused"] += 1
            return
        data = rng.choice(
            (
                json.dumps(_jsonable(_replaced(rng, rng.choice(contacts)))).encode(),
                json.dumps(rng.choice(contacts)).encode(),
                b"[" * rng.randrange(1100),
                b"[0,%d,%d]" % (rng.getrandbits(rng.choice((40, 70, 200))), -rng.getrandbits(70)),
                rng.randbytes(rng.randrange(1100)),
            )
        )
        agent_id = rng.choice((1, 5, 12, 13, 0, -1, 2**31 - 1))
        medium = rng.choice(("contact", "wifi", "sound", "", "water"))
        source = rng.choice(
            (PacketOrigin.REMOTE_AMUSSEL, PacketOrigin.REMOTE_SUPERVISOR, PacketOrigin.REMOTE_DOCK)
        )
        topics._put(Packet(agent=agent_id, medium=medium, data=data), source)
        for event in relay.advance(MissionMs(1000)):
            counts[type(event).__name__] += 1
            stimulus = getattr(event, "stimulus", None)
            if stimulus is not None:
                link_protocol.WindowGrant((1, 1), Grant(1, ((1, stimulus),))).encode()
                if not isinstance(stimulus, _CONTACTS):
                    raise Broken(f"a dock of another aPad sent {stimulus}")
        counts["messages"] += 1

    yield once


def _io(message: Any) -> bytes:
    from io import BytesIO

    buffer = BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def _jsonable(data: Any) -> Any:
    return json.loads(json.dumps(data, default=lambda it: it.hex() if isinstance(it, bytes) else str(it)))


@contextmanager
def _scenarios(folder: Path) -> Iterator[Door]:
    """YAML files: one that is refused says so in ScenarioError's lines.

    Each is a small scenario with one block, of some shipped scenario, in all its keys. The time goes with the text.
    """
    shipped = [resolve(load(it)) for it in sorted(SCENARIO.parent.glob("*.yaml"))]
    small = resolve(load(SCENARIO))
    _leave_out_defaults(small, small)
    blocks = [(key, block) for data in shipped for key, block in data.items() if block]
    path = folder / "scenario.yaml"

    def once(rng: random.Random, counts: Counter[str]) -> None:
        data = dict([*small.items(), rng.choice(blocks)])
        match rng.randrange(5):
            case 0:
                raw = _spoiled(rng, json.dumps(data, indent=1).encode())
            case 1:
                raw = rng.choice((b"[", b"{a: ", b"- ", b"&a [*a, ", b"? ")) * rng.randrange(400)
            case _:
                raw = json.dumps(_jsonable(_replaced(rng, data))).encode()
        path.write_bytes(raw)
        try:
            load(path)
            counts["loaded"] += 1
        except ScenarioError as error:
            counts["refused"] += 1
            if not error.lines or any("\n" in line for line in error.lines):
                raise Broken(f"a refusal of {len(error.lines)} lines: {error.lines!r}") from error

    yield once


def _leave_out_defaults(block: dict[str, Any], whole: dict[str, Any]) -> None:
    """Leaves out each key of a block without which the whole is still a scenario."""
    for key, value in list(block.items()):
        del block[key]
        try:
            from_data(whole, "")
        except ScenarioError:
            block[key] = value
            if isinstance(value, dict):
                _leave_out_defaults(value, whole)


@contextmanager
def _flown(folder: Path) -> Iterator[RunDirectory]:
    """A short run of the paper's pool, with all its records."""
    whole = load(SCENARIO)
    scenario = replace(whole, duration_s=_RUN_S, fleet=replace(whole.fleet, hosting=Hosting.ONE_PROCESS))
    directory, starts = RunDirectory(folder / "run"), starts_of(scenario)
    directory.path.mkdir()
    directory.write_inputs(scenario, starts)
    with ExitStack() as stack:
        progress = stack.enter_context(FlightProgress(scenario.name, 1000 * _RUN_S, quiet=True))
        config = flight_config(scenario)
        context, recorder = open_in_process(stack, config, starts, directory)
        prepared = prepare(config, context, recorder, progress)
        prepared.flight.run()
        prepared.finish()
    RunOptions(BenchPart.WHOLE, APadKind.SIM, TimeSource.WALL, 1.0, OnDeath.WAIT).save(directory.path)
    yield directory


@contextmanager
def _journals(folder: Path) -> Iterator[Door]:
    """Journals with damaged lines: read, or JournalDamaged."""
    with _flown(folder) as directory:
        lines = directory.journal.read_bytes().splitlines(keepends=True)
        kinds = {json.loads(it)["kind"]: it for it in lines}
        path = folder / "journal.jsonl"

        def once(rng: random.Random, counts: Counter[str]) -> None:
            line = rng.choice(list(kinds.values()))
            match rng.randrange(4):
                case 0:
                    line = _spoiled(rng, line)
                case 1:
                    line = rng.choice((b"[", b'{"t":')) * rng.randrange(3000) + b"\n"
                case _:
                    line = json.dumps(_jsonable(_replaced(rng, json.loads(line)))).encode() + b"\n"
            path.write_bytes(lines[0] + line + lines[-1])
            try:
                counts[f"dropped {min(2, read_journal(path).dropped)}"] += 1
            except JournalDamaged:
                counts["damaged"] += 1

        yield once


@contextmanager
def _bags(folder: Path) -> Iterator[Door]:
    """Bags with damaged bytes: their whole messages are read, and one that was not closed is repaired."""
    with _flown(folder) as directory:
        (bag,) = directory.bags
        whole = bag.read_bytes()
        path = folder / "damaged.bag"

        def once(rng: random.Random, counts: Counter[str]) -> None:
            raw = bytearray(whole[: rng.choice((len(whole), rng.randrange(len(whole))))])
            for _ in range(rng.randrange(4)):
                # The heads of records decide how the rest is read.
                at = rng.randrange(min(len(raw), rng.choice((200, 20_000, len(raw)))) + 1)
                raw[at : at + rng.choice((1, 4))] = rng.randbytes(rng.choice((1, 4)))
            path.write_bytes(raw)
            counts["messages"] += sum(1 for _ in recorded_messages(path))
            repaired = repair_bag(path)
            counts["closed" if repaired is None else "repaired"] += 1
            if repaired is not None and sum(1 for _ in recorded_messages(path)) != repaired["messages"]:
                raise Broken(f"a bag with other messages than its repair kept: {repaired}")

        yield once


@contextmanager
def _console(folder: Path) -> Iterator[Door]:
    """Requests to the console, and lines to the socket for orders: each is answered."""
    with _flown(folder) as directory, asyncio.Runner() as runner, ExitStack() as stack:
        failures: list[Exception] = []
        app = app_of(directory.path, _TOKEN, ConsoleEnding(lambda _: None, lambda: False, failures.append))
        running = app.router.lifespan_context(app)
        runner.run(_begun(running))
        stack.callback(lambda: runner.run(_ended(running)))
        orders = [
            {"act": "stop", "by": "Anna"},
            {"act": "go to", "by": "Anna", "goal_m": [1.0, 2.0], "speed_m_s": 0.5},
            {"act": "cause a fault", "by": "Anna", "agent": 3, "fault": "bit_flip", "value": 0.1, "for_s": 5},
        ]

        def order(rng: random.Random) -> bytes:
            whole = rng.choice(orders)
            if rng.random() < 0.3:
                return rng.choice((_spoiled(rng, json.dumps(whole).encode()), b"[" * rng.randrange(3000)))
            return json.dumps(_jsonable(_replaced(rng, whole))).encode()

        def once(rng: random.Random, counts: Counter[str]) -> None:
            body = order(rng)
            if rng.random() < 0.5:
                answer = json.loads(answered_line(directory.path, body))
                counts["line: accepted" if answer["accepted"] else "line: refused"] += 1
                return
            status = runner.run(_asked(app, rng, body))
            counts[f"request: {status}"] += 1
            if status >= 500:
                raise Broken(f"{body!r} is answered with {status}")
            if failures:
                raise Broken("the console's polling ended") from failures[0]

        yield once


async def _begun(context: AbstractAsyncContextManager[Any]) -> None:
    await context.__aenter__()


async def _ended(context: AbstractAsyncContextManager[Any]) -> None:
    await context.__aexit__(None, None, None)


async def _asked(app: Any, rng: random.Random, body: bytes) -> int:
    """The status of one request's answer."""
    length = rng.choice((str(len(body)), str(len(body)), "-1", "x", "", "9" * 30, "\u00b2")).encode("latin-1")
    counts = rng.choice(("0,0,0,0,0", "-1,-9,5,5,5", "9" * 5000, f"{2**70},1,1,1,1", "a", "1,2,3", ""))
    token = rng.choice((_TOKEN, _TOKEN, _TOKEN, "", "\u00e9", "x" * 3000)).encode("latin-1")
    known = b"token=" + _TOKEN.encode() + b"&counts=" + counts.encode()
    query = rng.choice((b"", b"token=", b"token=" + rng.randbytes(5), known, known))
    origin = rng.choice((b"http://127.0.0.1:80", b"http://127.0.0.1:80", b"http://[::1", b"null", b"\xff"))
    path = rng.choice(("/live", "/orders", "/orders", "/favicon.ico", "/nowhere", "/live/../orders"))
    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": rng.choice(("GET", "POST", "POST", "PUT")),
        "scheme": "http",
        "path": path,
        "raw_path": path.encode(),
        "query_string": query,
        "headers": [
            (b"content-length", length),
            (b"x-musselbed-token", token),
            (b"host", b"127.0.0.1:80"),
            (b"origin", origin),
        ],
        "server": ("127.0.0.1", 80),
        "client": ("127.0.0.1", 1),
    }
    statuses: list[int] = []
    messages = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> dict[str, Any]:
        return messages.pop() if messages else {"type": "http.disconnect"}

    async def send(message: dict[str, Any]) -> None:
        if message["type"] == "http.response.start":
            statuses.append(message["status"])

    await app(scope, receive, send)
    return statuses[0]


DOORS: Mapping[str, Callable[[Path], Any]] = {
    "modem": _modems,
    "packets": _packets,
    "agent link": _agent_link,
    "nursery socket": _nursery_socket,
    "ROS messages": _ros_messages,
    "scenario": _scenarios,
    "journal": _journals,
    "bag": _bags,
    "console": _console,
}
