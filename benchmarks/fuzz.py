"""A million seeded inputs to the modem's serial line, to its receiver and to the packets: no exception, no state lost.

Inputs are noise, commands and packets that are whole, cut, mutated or run together, and frames. After each the modem must
still answer a valid command with the correct address; a packet that decodes must encode to the same bytes.
"""

from __future__ import annotations

import random
import time
from collections import Counter
from typing import Any

from rich.console import Console

from agents.modem.commands import GRAMMAR, Field
from agents.modem.facts import FrameArrived, PowerCame, PowerWent, SerialBytes, SerialOut, SoundBegan
from agents.modem.firmware import Firmware, ModemConfig
from agents.modem.frames import (
    ANSWERS,
    PAYLOAD_BYTES,
    TO_ALL,
    V2_KINDS,
    WITH_DATA,
    Frame,
    FrameKind,
    Generation,
)
from agents.modem.modem import Modem
from firmware_model import packets
from firmware_model.packets import AcousticStatus, CommandPacket, Kind, StatusPacket, WifiStatus
from firmware_model.packets.wire import sealed
from firmware_model.states import State

INPUTS = 1_000_000
SEED = 20260101
_KINDS = [*(int(kind) for kind in Kind), 0, 255]
_STATES = [int(state) for state in State]
_SIZES = (2, 4, 5, 6, 7, 8, 12, 13, 20, 29, 41, 43, AcousticStatus.SIZE, WifiStatus.SIZE, 130)
"""Sizes of bodies: most of them of some packet, the others of none."""
_SETTLED_MS = 10_000
"""Longer than any transmission with its deferral and the wait for an answer."""


class Broken(AssertionError):
    """An input had an effect that no input may have."""


def measure(inputs: int = INPUTS, seed: int = SEED) -> dict[str, Any]:
    """Three fifths of the inputs go to modems of every firmware, the rest to the packets. Broken at the first failure."""
    rng = random.Random(seed)
    began_s = time.perf_counter()
    counts: Counter[str] = Counter()
    to_modems = inputs * 3 // 5
    modems = [_Fuzzed(firmware, rng) for firmware in Firmware]
    for n in range(to_modems):
        modems[n % len(modems)].once(counts)
    modems_s = time.perf_counter() - began_s
    for _ in range(inputs - to_modems):
        _packet(rng, counts)
    packets_s = time.perf_counter() - began_s - modems_s
    return {
        "inputs": inputs,
        "seed": seed,
        "failures": 0,
        "modem_inputs_per_s": to_modems / modems_s,
        "packet_inputs_per_s": (inputs - to_modems) / packets_s,
        "came": dict(sorted(counts.items())),
    }


class _Fuzzed:
    """One modem that gets a sequence of inputs."""

    def __init__(self, firmware: Firmware, rng: random.Random) -> None:
        self._rng = rng
        self._generation = firmware.generation
        self._modem = Modem(ModemConfig(firmware), 1)
        self._now_ms = 0
        self._address = 1

    def once(self, counts: Counter[str]) -> None:
        rng, modem = self._rng, self._modem
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
        wakes = (b"$W", b"$W") if self._generation is Generation.V3 else ()
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


def _serial(rng: random.Random, generation: Generation) -> bytes:
    name, fields = rng.choice(list(GRAMMAR[generation].items()))
    data = b"$" + name.encode()
    for field in fields:
        if field is Field.ADDRESS:
            data += b"%03d" % rng.choice((0, 1, 2, 255, 256, 999))
        elif field is Field.DATA:
            fewest, most = PAYLOAD_BYTES[generation]
            size = rng.randint(fewest, most)
            data += str(size).zfill(1 if generation is Generation.V2 else 2).encode() + rng.randbytes(size)
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


def _frame(rng: random.Random) -> Frame:
    generation = rng.choice(list(Generation))
    kind = rng.choice(sorted(V2_KINDS) if generation is Generation.V2 else list(FrameKind))
    fewest, most = PAYLOAD_BYTES[generation] if kind in WITH_DATA else (0, 0)
    return Frame(
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


def show(result: dict[str, Any], console: Console) -> None:
    console.print(
        f"{result['inputs']} inputs, seed {result['seed']}: no exception, no state lost "
        f"({result['modem_inputs_per_s']:.0f} modem inputs/s, {result['packet_inputs_per_s']:.0f} packets/s)"
    )
    for what, count in result["came"].items():
        console.print(f"  {what}: {count}")
