"""A run's systems as IMC knows them: an id, a name and a type for the aPad and for each aMussel.

Ids follow the ranges of IMC's addressing scheme (IMC_Addressing_Scheme.txt of the protocol's definition), other surface
vehicles from 0x2800 and self-contained sensors from 0x9000, where LSTS' list of addresses (IMC_Addresses.xml) has nobody.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from apad_bridge.imc import protocol as imc

APADS, AMUSSELS = 0x2A00, 0x9A00
_APADS_RANGE, _AMUSSELS_RANGE = 0x0200, 0x0600
"""Ids up to the ends of the scheme's ranges."""
NOBODY = 0xFFFF
"""The null id: no owner, and as a destination everybody."""


@dataclass(frozen=True, slots=True)
class System:
    imc_id: int
    name: str
    kind: imc.SystemType


def apad_system(name: str) -> System:
    """The aPad with this name; the number at the name's end is that of its id, 1 for a name without one."""
    return System(APADS + apad_number(name), name.strip("/").replace("/", "-"), imc.SystemType.USV)


def apad_number(name: str) -> int:
    """The number at the end of an aPad's name, 1 for a name without one or with one that no id can carry."""
    found = re.search(r"[1-9]\d*$", name)
    number = 1 if found is None else int(found[0])
    return number if number < _APADS_RANGE else 1


def amussel_system(agent_id: int) -> System:
    """The aMussel with this id. Ids beyond the range share those of lower ones; a fleet so large is not announced."""
    return System(AMUSSELS + agent_id % _AMUSSELS_RANGE, f"amussel{agent_id}", imc.SystemType.MOBILESENSOR)
