"""A run's systems as IMC knows them: an id, a name and a type for the aPad and for each aMussel.

Ids follow the ranges of IMC's addressing scheme (IMC_Addressing_Scheme.txt of the protocol's definition), other surface
vehicles from 0x2800 and self-contained sensors from 0x9000, where LSTS' list of addresses (IMC_Addresses.xml) has nobody.
A range is cut into blocks. Of the runs that a machine shows at the same time each has blocks of its own.
"""

from __future__ import annotations

import fcntl
import os
import re
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from apad_bridge.imc import protocol as imc
from apad_bridge.records.run_directory import RunDirectoryError
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.text.text_file import write_atomically

APADS, AMUSSELS = 0x2A00, 0x9A00
_APADS_RANGE, _AMUSSELS_RANGE = 0x0200, 0x0600
"""Ids up to the ends of the scheme's ranges."""
_APADS_BLOCK, _AMUSSELS_BLOCK = 0x10, 0x40
_BLOCKS = _AMUSSELS_RANGE // _AMUSSELS_BLOCK
NOBODY = 0xFFFF
"""The null id: no owner, and as a destination everybody."""
_PORTS = 6001
_CLAIM = re.compile(r"@musselbed imc (\d+) (\d+) (\S+) \S+$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class System:
    imc_id: int
    name: str
    kind: imc.SystemType


@dataclass(frozen=True, slots=True)
class Systems:
    """The systems of one run, by the number that it has on this machine: 0 for the first run, and the only one."""

    number: int = 0

    def apad(self, name: str) -> System:
        """The aPad with this name; the number at the name's end is that of its id, 1 for a name without one."""
        within = (self.number * _APADS_BLOCK + apad_number(name)) % _APADS_RANGE
        return System(APADS + within, self._named(name.strip("/").replace("/", "-")), imc.SystemType.USV)

    def amussel(self, agent_id: int) -> System:
        """The aMussel with this id. Ids beyond the range share those of lower ones; a fleet so large is not announced."""
        within = (self.number * _AMUSSELS_BLOCK + agent_id) % _AMUSSELS_RANGE
        return System(AMUSSELS + within, self._named(f"amussel{agent_id}"), imc.SystemType.MOBILESENSOR)

    def port(self, apad: str) -> int:
        """The port at which the gateway of this aPad listens where it was not told another."""
        return _PORTS + self.apad(apad).imc_id - APADS

    def _named(self, name: str) -> str:
        return name if self.number == 0 else f"{name}-run{self.number + 1}"


def apad_number(name: str) -> int:
    """The number at the end of an aPad's name, 1 for a name without one or with one that no id can carry."""
    found = re.search(r"[1-9]\d*$", name)
    number = 1 if found is None else int(found[0])
    return number if number < _APADS_RANGE else 1


class RunNumber:
    """A run's number on this machine, held until `close`: meanwhile gateways of other runs take ids of other blocks.

    The run keeps its number in `path`, and gets it again unless another run has it by then. The gateways of a run of
    several aPads share it. A held number is the name of an abstract socket, which ends with its process.
    """

    def __init__(self, run: Path, scenario: Scenario) -> None:
        """`run` is the directory of the whole run. RunDirectoryError where no block is left."""
        self.path = run / "imc" / "number"
        self._kept = self._read()
        blocks, status = _blocks_of(scenario), run.stat()
        key = f"{status.st_dev:x}-{status.st_ino:x}"
        self._held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        # All abstract names of a network namespace are seen under one lock, which nobody holds for longer than this.
        with open("/proc/self/ns/net", "rb") as namespace:
            fcntl.flock(namespace, fcntl.LOCK_EX)
            if (first := _free(blocks, key, self._kept)) is None:
                self._held.close()
                raise RunDirectoryError(f"{run}: gateways of other runs use all IMC ids: end one of them")
            self.systems = Systems(first)
            self._held.bind(f"\0musselbed imc {first} {blocks} {key} {os.urandom(4).hex()}")
        self.path.parent.mkdir(exist_ok=True)
        write_atomically(self.path, f"{first}\n")

    @property
    def was_taken(self) -> bool:
        """True where the run had another number before, which another run has now."""
        return self._kept is not None and self._kept != self.systems.number

    def close(self) -> None:
        self._held.close()

    def _read(self) -> int | None:
        try:
            text = self.path.read_text(encoding="ascii").strip()
        except (OSError, UnicodeDecodeError):
            return None
        return int(text) if re.fullmatch(r"\d{1,2}", text) else None


def _blocks_of(scenario: Scenario) -> int:
    """The number of blocks in a row that the ids of all of a run's systems lie in."""
    apads = max(map(apad_number, scenario.apad_names))
    return min(_BLOCKS, 1 + max(apads // _APADS_BLOCK, scenario.fleet.ids[-1] // _AMUSSELS_BLOCK))


def _free(blocks: int, key: str, kept: int | None) -> int | None:
    """The first of so many blocks that no other run has: those that the run had, if it can have them, else the lowest."""
    names = Path("/proc/net/unix").read_text(encoding="utf-8", errors="replace")
    taken: set[int] = set()
    for first, theirs, whose in _CLAIM.findall(names):
        if whose != key:
            taken.update(range(int(first), int(first) + int(theirs)))
    candidates: Iterable[int] = range(_BLOCKS - blocks + 1)
    if kept is not None:
        candidates = (kept, *candidates)
    return next(
        (it for it in candidates if it + blocks <= _BLOCKS and taken.isdisjoint(range(it, it + blocks))), None
    )
