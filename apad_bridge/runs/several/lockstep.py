"""Several aPads' flights in step: a tick of mission time is flown by one after another, then it is seen who serves whom.

What passes between the flights of several aPads in one process, because one serves another's aMussels.

An aMussel stays where it is simulated, and its truth and its samples are recorded there and nowhere else. What changes is
who serves it: its packets are handed on to that flight, whose words, and what its docks do, come back.

Several aPads' flights in virtual time and in this process, tick by tick side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

from agents.packet_medium import Medium
from apad_bridge.assembly import parts
from apad_bridge.assembly.division import Member
from apad_bridge.mission.breakdown import Breakdown
from apad_bridge.mission.events import Send, SoundHeard, WifiHeard
from apad_bridge.records.recorder import Recorder as RunRecorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs import flying
from apad_bridge.runs.nurseries import FOLDER
from apad_bridge.runs.progress import Shows
from apad_bridge.runs.several.assignment import Move, Sharing, seen_of
from apad_bridge.runs.several.summary import together
from apad_bridge.runs.status import Status
from apad_bridge.scenario.another_apad import Sharing as Rules
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.packet_relay import Came, Felt
from apad_bridge.supervisor.recorder_interface import Recorder


class Exchange:
    """`own` are the aMussels simulated beside each aPad."""

    def __init__(self, own: Mapping[str, Iterable[int]]) -> None:
        self.home = {agent_id: name for name, ids in own.items() for agent_id in ids}
        self.server = dict(self.home)
        self.ethers = {name: MemberRelay(name, self) for name in own}


class MemberRelay:
    """One flight's end: an PacketRelay, and what lets guests feel. What comes is handled at this flight's next tick."""

    def __init__(self, name: str, exchange: Exchange) -> None:
        self._name = name
        self._exchange = exchange
        self._waiting: list[Came] = []

    def advance(self, now_ms: int) -> list[Came]:
        waiting, self._waiting = self._waiting, []
        return waiting

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        """An aMussel of this fleet was heard: so is it by who serves it."""
        server = self._exchange.server[agent_id]
        if server != self._name:
            heard = WifiHeard(now_ms, data) if medium is Medium.WIFI else SoundHeard(now_ms, data)
            self._exchange.ethers[server].put(heard)

    def said(self, send: Send, now_ms: int) -> None:
        self._pass_on(send.agent_id, send)

    def felt(self, felt: Felt, now_ms: int) -> None:
        self._pass_on(felt.agent_id, felt)

    def put(self, came: Came) -> None:
        self._waiting.append(came)

    def _pass_on(self, agent_id: int, word: Send | Felt) -> None:
        home = self._exchange.home.get(agent_id)
        if home is not None and home != self._name:
            self._exchange.ethers[home].put(word)


LOOK_MS = 10_000
"""So often, in mission time, it is seen who serves whom. One that stood down is so given time to hear whom it called up."""


@dataclass(frozen=True, slots=True)
class Flown:
    """One of them: where it starts, its flight over the exchange's ether, and its records."""

    start_m: tuple[float, float]
    flight: Flight
    recorder: Recorder


class LockstepRunner:
    """Without a `sharing` each serves its own to the end."""

    def __init__(self, flown: Mapping[str, Flown], exchange: Exchange, sharing: Sharing | None) -> None:
        self._flown = dict(flown)
        self._exchange = exchange
        self._sharing = sharing
        self.moves: list[tuple[int, Move]] = []
        """(mission ms, move), as they were made."""

    @property
    def moved(self) -> int:
        """How many aMussels were handed on at least once."""
        return len({move.agent_id for _, move in self.moves})

    def run(self) -> None:
        """To the end of every mission."""
        flying = dict(self._flown)
        while flying:
            now_ms = min(it.flight.now_ms for it in flying.values())
            ended = [name for name, it in flying.items() if it.flight.step()]
            for name in ended:
                del flying[name]
            if self._sharing is not None and now_ms % LOOK_MS == 0:
                self._share(self._sharing, flying, now_ms)

    def _share(self, sharing: Sharing, flying: Mapping[str, Flown], now_ms: int) -> None:
        seen = [seen_of(name, it.start_m, it.flight.supervisor) for name, it in flying.items()]
        for move in sharing.look(seen):
            giver, taker = self._flown[move.giver], self._flown[move.taker]
            belief = giver.flight.supervisor.beliefs.get(move.agent_id)
            giver.flight.supervisor.hand_on(move.agent_id)
            taker.flight.supervisor.take_on(move.agent_id, belief)
            self._exchange.server[move.agent_id] = move.taker
            sharing.moved(move)
            self.moves.append((now_ms, move))
            giver.recorder.event(now_ms, "handed_on", id=move.agent_id, to=move.taker)
            taker.recorder.event(now_ms, "took_on", id=move.agent_id, of=move.giver)


def fly_in_step(
    members: Sequence[Member], rules: Rules, directories: Mapping[str, RunDirectory], progress: Shows
) -> tuple[dict[str, dict[str, Any]], int]:
    """By aPad the summaries; and how many aMussels were handed on to another one. SIGINT and SIGTERM end all in order."""
    served = {member.name: member.scenario.fleet.ids for member in members}
    exchange = Exchange(served)
    now: dict[str, Status] = {}

    def shown_as(name: str) -> Callable[[Status], None]:
        def show(status: Status) -> None:
            now[name] = status
            if name == members[-1].name:
                progress.show(together(list(now.values()), len(members)))

        return show

    with ExitStack() as stack:
        prepared, flown = {}, {}
        for member in members:
            name, scenario = member.name, member.scenario
            directory = directories[name]
            recorder = RunRecorder(directory, scenario, parts.agent_ids(scenario))
            stack.callback(recorder.close)
            flying.journal_start(recorder, scenario, member.starts)
            fleet = flying.open_fleet(scenario, member.starts, directory.path / FOLDER)
            stack.callback(fleet.host.close)
            context = replace(
                flying.in_process(scenario, fleet),
                relay=exchange.ethers[name],
                tell_served_elsewhere=exchange.ethers[name].felt,
                breakdown=Breakdown(rules.failed_go_tos),
            )
            prepared[name] = flying.prepare(scenario, context, recorder, shown_as(name))
            flown[name] = Flown(scenario.apad.start_m, prepared[name].flight, recorder)
        formation = LockstepRunner(flown, exchange, Sharing(served) if rules.transfers else None)
        with flying.stopped_by_signals(*(it.flight for it in flown.values())):
            formation.run()
        return {name: it.finish() for name, it in prepared.items()}, formation.moved
