"""A thousand aMussels on two machines, served by one mission before and after a cut of the link between them.

The machines are network namespaces. The first has the master, an aPad of generation B, the mission and half of the
aMussels; the second has the other half. So three supervisors are on one master, with disjoint ids, all in real time. The
link is cut once the mission has heard every aMussel, and has brought one of each machine back full. `silent` counts the
aMussels of each machine whose packets the mission has not heard for three report periods at the end of the cut; `again_s`
is the wall time from the healing until the mission has heard every one of the second machine again. The flight ends when
it has brought back one more of each machine.

`services` counts those that left a dock full, by machine. `rate` is the mission's time over the wall's before the cut, and
`processors` the number of processors that each part kept busy then, with all its processes.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from network.campaign import MUSSELBED, ON_RED, ROOT
from soak.campaign import tree_of
from two_machines import (
    Link,
    Machine,
    Programs,
    interrupt,
    linked_machines,
    master_uri,
    why_no_two_machines,
)

from apad_bridge.events.fleet_events import BeliefChanged
from apad_bridge.events.mission_events import AMusselReleased
from apad_bridge.records.bag_messages import BELIEFS
from apad_bridge.records.bag_samples import definitions_in, open_bag
from apad_bridge.records.journal import JournalTail
from apad_bridge.scenario.loader import from_data, load, resolve, write_resolved
from benchmarks.rows import told


@dataclass(frozen=True, slots=True)
class Tier:
    on_each: int
    """aMussels on each machine."""
    theta: int
    period_s: float
    """Mission time between two reports of an aMussel."""
    changes: Mapping[str, Mapping[str, Any]]
    """Keys of the scenario's blocks that differ from those of real-apad.yaml."""

    @property
    def silent_s(self) -> float:
        return 3 * self.period_s

    @property
    def cut_s(self) -> float:
        """Mission time of the cut. After a minute of silence, the journal has a line for the next packet at once."""
        return 6 * self.period_s


WHOLE = Tier(
    on_each=500,
    theta=30,
    period_s=10.0,  # a hundred packets a second of all
    changes={
        "fleet": {"start": {"charge": [0.55, 0.9]}},
        # Half of the paper's worst case: one aPad cannot serve a thousand, and none shall be empty before the end.
        "board": {"discharge_per_min": 0.0005},
        # One aMussel in seven is a candidate, and a minute or two in a dock make it full.
        "mission": {"pool_threshold": 0.6, "full_threshold": 0.62, "batch": 2},
        "docking": {"dock_s": 5.0, "undock_s": 2.0},
    },
)
SHORT = Tier(
    on_each=1,
    theta=240,
    period_s=1.0,
    changes={
        "area": {"polygon_m": [[13.5, 10], [14.5, 10], [14.5, 11], [13.5, 11]]},
        "fleet": {"start": {"charge": [0.6, 0.605]}},
        # A belief moves by the hundredth that gives a line in the journal in five seconds. An aMussel that waited for its
        # turn is full again in some more.
        "board": {"discharge_per_min": 0.0005},
        "mission": {"pool_threshold": 0.61, "full_threshold": 0.62, "batch": 1, "permission_repeat_s": 2.0},
        "docking": {"dock_s": 1.0, "undock_s": 1.0},
    },
)
"""All is in real time. The aPad serves one after the other in some ten seconds each, beside which it lies."""
FLEETS = ("fleet-one", "fleet-two")


def measure(minutes: float = 20.0, short: bool = False) -> dict[str, Any]:
    """`minutes` is the patience with each step, of which the longest are some batches of two services.

    The short tier has one aMussel on each machine, both beside the aPad and soon candidates, and a shorter cut.
    """
    if why := why_no_two_machines():
        raise SystemExit(f"this machine cannot play two: {why}")
    with tempfile.TemporaryDirectory(prefix="musselbed-hosts-") as folder:
        return fly(SHORT if short else WHOLE, Path(folder), 60 * minutes)


def written(home: Path, name: str, first_id: int, count: int, tier: Tier) -> Path:
    """A scenario for these aMussels, in one square for all of them."""
    data = resolve(load(ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml"))
    data |= {"theta": tier.theta, "duration_s": 86_400.0}
    data["fleet"] |= {"count": count, "first_id": first_id}
    data["apad"] |= {"generation": "b"}
    data["hearing"]["report_period_s"] = tier.period_s
    for block, keys in tier.changes.items():
        (data["mission"] if block == "docking" else data)[block] |= keys
    write_resolved(home / f"{name}.yaml", from_data(data, name))
    return home / f"{name}.yaml"


class Heard:
    """The mission time of each aMussel's newest packet, and who was served, by the mission's journal."""

    def __init__(self, run: Path) -> None:
        self.newest_ms: dict[int, int] = {}
        self.now_ms = 0
        self.served: list[int] = []
        """Those that left a dock full, in order."""
        self._path = run / "journal.jsonl"
        self._tail: JournalTail | None = None

    def look(self) -> None:
        if self._tail is None and self._path.exists():
            self._tail = JournalTail(self._path)
        for at_ms, event in () if self._tail is None else self._tail.read_new().entries:
            self.now_ms = max(self.now_ms, at_ms)
            match event:
                case BeliefChanged(id=agent_id, heard=heard_ms):
                    self.newest_ms[agent_id] = max(self.newest_ms.get(agent_id, 0), heard_ms)
                case AMusselReleased(full=True):
                    self.served.append(event.agent)


def fly(tier: Tier, home: Path, patience_s: float) -> dict[str, Any]:
    """Flies it, and returns the figures."""
    on_each = tier.on_each
    ids = {FLEETS[n]: range(1 + n * on_each, 1 + (n + 1) * on_each) for n in (0, 1)}
    with ExitStack() as stack:
        one, two, lose = stack.enter_context(linked_machines(Link()))
        programs = Programs(home, master_uri(one), stack, patience_s)
        started: dict[str, subprocess.Popen[bytes]] = {}

        def start(machine: Machine, name: str, *words: str) -> None:
            started[name] = programs.start(machine, name, *words)

        def wait_until(is_so: Callable[[], object], what: str) -> float:
            """Waits until it is so; returns the wall time. SystemExit if a part ended; TimeoutError after `patience_s`."""
            began_s = time.monotonic()
            programs.wait_until(lambda: is_so() or ended(started), f"{what}: it took too long")
            if names := ended(started):
                raise SystemExit("\n".join(f"{what}: {it} ended: {programs.said(it)[-500:]}" for it in names))
            return time.monotonic() - began_s

        programs.start_master(one)
        whole = written(home, "whole", 1, 2 * on_each, tier)
        start(one, "apad", *MUSSELBED, "apad", str(whole))
        wait_until(lambda: "ready" in programs.said("apad"), "no aPad")
        for name, machine in zip(FLEETS, (one, two), strict=True):
            scenario = written(home, name, ids[name].start, on_each, tier)
            start(machine, name, *MUSSELBED, "fleet", str(scenario), "--out", f"{name}-run")
        start(one, "mission", *MUSSELBED, "mission", str(whole), "--out", "run", *ON_RED)
        run = programs.folder(one) / "run"
        heard = Heard(run)

        def look_ms() -> int:
            heard.look()
            return heard.now_ms

        def all_heard(name: str, since_ms: int) -> bool:
            heard.look()
            return all(heard.newest_ms.get(it, -1) >= since_ms for it in ids[name])

        def services(since: int) -> dict[str, int]:
            heard.look()
            return {name: sum(it in ids[name] for it in heard.served[since:]) for name in FLEETS}

        heard_s = wait_until(lambda: all(all_heard(name, 0) for name in FLEETS), "not all are heard")
        told({"heard_s": heard_s})
        parts = (*FLEETS, "mission")
        before_ms, used_before_s = heard.now_ms, {name: used_s(started[name].pid) for name in parts}
        took_s = wait_until(lambda: all(services(0).values()), "a machine was not served before the cut")
        rate = (heard.now_ms - before_ms) / 1000 / took_s
        processors = {name: (used_s(started[name].pid) - used_before_s[name]) / took_s for name in parts}
        memory_mb = {name: pss_mb(started[name].pid) for name in parts}
        told({"rate": rate, "processors": processors, "memory_mb": memory_mb})
        lose(1.0)
        cut_ms = heard.now_ms
        wait_until(lambda: look_ms() >= cut_ms + 1000 * tier.cut_s, "the mission's time stood still")
        lose(0.0)
        healed_ms, before = heard.now_ms, len(heard.served)
        again_s = wait_until(lambda: all_heard(FLEETS[1], healed_ms), "the second fleet is not heard again")
        told({"again_s": again_s})
        wait_until(lambda: all(services(before).values()), "a machine was not served after the cut")
        after = services(before)
        ended_early = ended(started)
        interrupt(started["mission"])
        started["mission"].wait(patience_s)
        silent_ids = [it for it, age_s in ages_s(run / "run.bag", healed_ms).items() if age_s > tier.silent_s]
        silent = {name: sum(it in ids[name] for it in silent_ids) for name in FLEETS}
        return {
            "on_each": on_each,
            "theta": tier.theta,
            "heard_s": heard_s,
            "rate": rate,
            "processors": processors,
            "memory_mb": memory_mb,
            "cut_s": tier.cut_s,
            "silent": silent,
            "again_s": again_s,
            "services": {
                name: {"before": count - after[name], "after": after[name]}
                for name, count in services(0).items()
            },
            "ended": ended_early,
        }


def ages_s(bag: Path, at_ms: int) -> dict[int, float]:
    """The age of each aMussel's newest packet at the first tick from `at_ms` on, by the mission's bag.

    Its journal has a line for a packet only where the belief has changed, or after a minute without one.
    """
    with open_bag(bag) as reader:
        wanted = [it for it in reader.connections if it.msgtype == BELIEFS]
        types = definitions_in(bag, wanted)
        for _, _, data in reader.messages(wanted):
            message: Any = types.deserialize_ros1(data, BELIEFS)
            if message.mission_time_ms >= at_ms:
                return {it.id: it.age_s for it in message.agents}
    raise ValueError(f"{bag} ends before {at_ms / 1000} s")


def ended(started: Mapping[str, subprocess.Popen[bytes]]) -> list[str]:
    return sorted(name for name, it in started.items() if it.poll() is not None)


def read_of_all(root: int, name: str) -> list[str]:
    """The texts of /proc/PID/NAME of a process and all that it started; those that end meanwhile are left out."""
    texts = []
    for pid in tree_of(root):
        with suppress(OSError):
            texts.append(Path(f"/proc/{pid}/{name}").read_text())
    return texts


def pss_mb(root: int) -> float:
    """The proportional set size of a process and all that it started, in MB."""
    lines = [line for text in read_of_all(root, "smaps_rollup") for line in text.splitlines()]
    return sum(int(it.split()[1]) for it in lines if it.startswith("Pss:")) / 1024


def used_s(root: int) -> float:
    """The processor time of a process and all that it started and that is there yet."""
    fields = [text.rpartition(")")[2].split() for text in read_of_all(root, "stat")]
    return sum(int(it[11]) + int(it[12]) for it in fields) / os.sysconf("SC_CLK_TCK")
