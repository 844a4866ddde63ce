"""What passes between the flights of several aPads in one process, because one serves another's aMussels.

An aMussel stays where it is simulated, and its truth and its samples are recorded there and nowhere else. What changes is
who serves it: its packets are handed on to that flight, whose words, and what its docks do, come back.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from agents.packet_medium import Medium
from apad_bridge.mission.events import Send, SoundHeard, WifiHeard
from apad_bridge.supervisor.packet_relay import Came, Felt


class Exchange:
    """`own` are the aMussels simulated beside each aPad."""

    def __init__(self, own: Mapping[str, Iterable[int]]) -> None:
        self.home = {agent_id: name for name, ids in own.items() for agent_id in ids}
        self.server = dict(self.home)
        self.ethers = {name: MemberEther(name, self) for name in own}


class MemberEther:
    """One flight's end: an Ether, and what lets guests feel. What comes is handled at this flight's next tick."""

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
