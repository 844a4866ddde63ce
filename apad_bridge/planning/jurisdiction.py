"""Lets several aPads agree by themselves which of them serves which aMussel, over a network that loses messages.

Each aPad gossips the newest state of every aPad that it knows of. Of two states of one aPad the later stamp wins, so the
states may arrive in any order, repeatedly, or not at all. The shares are a function of these states (`fleet_shares.py`),
and aPads that know the same compute the same.

Shares differ for a while after a change, so a share alone permits nothing. An aPad serves an aMussel while its claim is
granted, by the votes of a majority. A voter has one vote for each aMussel, and is bound to it until the claimer drops the
claim, or the lease ends. Two majorities have a voter in common, so no two claims of one aMussel are granted at a time. The
leases are those of Gray and Cheriton (1989), the majorities those of Gifford (1979).

A granted claim is kept by any votes that leave no majority to the others: each of two aPads keeps its own without the
other. Pure: time and messages are arguments. Times are milliseconds of the aPad's own clock.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import dist

from apad_bridge.planning.fleet_shares import Point, allocate

MOVED_M = 5.0
"""An aMussel's place is told anew when it lies so far from the place that was told: drift alone changes no share."""


@dataclass(frozen=True, slots=True)
class Terms:
    """The times on which all aPads agree before the mission, in milliseconds."""

    lease_ms: int
    """A vote binds its voter for so long after the stamp of the claimer's state. One without a newer state is silent."""
    clock_error_ms: int
    """No two aPads' clocks differ by more at one instant."""
    margin_ms: int
    """A claim is granted only while its lease lasts for longer than this. A docking, and the time between two calls of
    `advance`, must fit into it."""


@dataclass(frozen=True, slots=True)
class Vote:
    claimer: str
    since_ms: int
    """The time of the claim that it is given to: a later claim of the same aPad needs another vote."""
    until_ms: int
    """The end of the lease, by the claimer's clock."""


@dataclass(frozen=True, slots=True)
class PeerState:
    """The state that one aPad tells the others; only that aPad makes it."""

    name: str
    start_m: Point
    """Its place at the start, where its share begins."""
    stamp_ms: int = -1
    is_down: bool = False
    """It stands down: it votes, and claims nothing anew."""
    places_m: Mapping[int, tuple[int, Point]] = field(default_factory=dict)
    """The aMussels that it has told the place of: when, and the place."""
    docked: frozenset[int] = frozenset()
    claims: Mapping[int, int] = field(default_factory=dict)
    """The aMussels that it claims, and the time at which each claim began."""
    votes: Mapping[int, Vote] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class OwnSight:
    """The knowledge that an aPad has by itself, at one time."""

    is_down: bool = False
    movable_m: Mapping[int, Point] = field(default_factory=dict)
    """The believed places of the aMussels that it serves and that may be moved."""
    busy: frozenset[int] = frozenset()
    """The aMussels in its plan or in its docks."""
    docked: frozenset[int] = frozenset()


class Jurisdiction:
    """One aPad's part. `receive` takes the states that others sent, `advance` makes its own, and `known` is to be sent."""

    def __init__(
        self,
        name: str,
        known: Iterable[PeerState],
        names: Sequence[str],
        terms: Terms,
        votes_from_ms: int = 0,
    ) -> None:
        """`names` are all aPads, which vote; `known` are the states known at the start, its own among them.

        An aPad that begins anew in the middle of a mission has forgotten the votes that it gave: `votes_from_ms` is then
        that of `votes_again_ms`.
        """
        self.known = {it.name: it for it in known}
        self.granted: frozenset[int] = frozenset()
        """The aMussels whose claim is granted, up to the next call of `advance`."""
        self._name = name
        self._names = tuple(names)
        self._terms = terms
        self._votes_from_ms = votes_from_ms
        self._majority = len(self._names) // 2 + 1
        self._keeps = len(self._names) - self._majority + 1
        """So many votes leave the others no majority."""

    @staticmethod
    def votes_again_ms(begun_ms: int, terms: Terms) -> int:
        """The time at which no vote binds any more that an aPad gave before it began anew at `begun_ms`."""
        return begun_ms + terms.lease_ms + 2 * terms.clock_error_ms

    def receive(self, states: Iterable[PeerState]) -> None:
        """Keeps of each other aPad the state with the latest stamp."""
        for it in states:
            known = self.known.get(it.name)
            if it.name != self._name and (known is None or it.stamp_ms > known.stamp_ms):
                self.known[it.name] = it

    def shares(self, now_ms: int) -> dict[str, tuple[int, ...]]:
        """The aMussels' ids by aPad, over the aPads that were heard of within a lease and do not stand down.

        An aMussel in a dock of another aPad is in no share.
        """
        up = [it for it in self._in_order() if not it.is_down and self._is_heard(it, now_ms)]
        away = {agent_id for it in self.known.values() if it not in up for agent_id in it.docked}
        places_m = tuple((i, at) for i, (_, at) in sorted(self._places_m().items()) if i not in away)
        if not up:
            return {}
        found = _allocated(tuple(it.start_m for it in up), places_m)
        return {it.name: share for it, share in zip(up, found, strict=True)}

    def advance(self, sight: OwnSight, now_ms: int) -> None:
        """Claims, votes, and finds out which claims are granted. ValueError if time did not go on."""
        own = self.known[self._name]
        if now_ms <= own.stamp_ms:
            raise ValueError(f"time did not go on: {now_ms} after {own.stamp_ms}")
        if now_ms > own.stamp_ms + self._terms.margin_ms:
            self.granted = (
                frozenset()
            )  # the votes that were counted then may have ended, and others been given
        known_m = self._places_m()
        moved_m = {
            agent_id: (now_ms, at)
            for agent_id, at in sight.movable_m.items()
            if agent_id not in known_m or dist(known_m[agent_id][1], at) > MOVED_M
        }
        own = self.known[self._name] = replace(
            own,
            stamp_ms=now_ms,
            is_down=sight.is_down,
            places_m={**own.places_m, **moved_m},
            docked=sight.docked,
        )
        shares = self.shares(now_ms)
        kept = (self.granted - sight.movable_m.keys()) | sight.busy
        claimed = sorted(kept.union(shares.get(self._name, ())))
        own = self.known[self._name] = replace(own, claims={i: own.claims.get(i, now_ms) for i in claimed})
        server_of = {agent_id: name for name, ids in shares.items() for agent_id in ids}
        votes = self._votes(server_of, now_ms) if now_ms >= self._votes_from_ms else {}
        self.known[self._name] = replace(own, votes=votes)
        self.granted = frozenset(it for it in claimed if self._is_granted(it, now_ms))

    def _votes(self, server_of: Mapping[int, str], now_ms: int) -> dict[int, Vote]:
        """Renews the votes that bind, and gives one for each aMussel whose claimers were heard of.

        An aPad whose dock holds the aMussel goes before the one whose share has it, and that one before all others.
        """
        votes, given = {}, self.known[self._name].votes
        for agent_id in sorted({it for peer in self.known.values() for it in peer.claims}):
            vote = given.get(agent_id)
            if vote is not None and self._binds(agent_id, vote, now_ms):
                chosen = self.known[vote.claimer]
            else:
                claimers = [
                    it for it in self._in_order() if agent_id in it.claims and self._is_heard(it, now_ms)
                ]
                if not claimers:
                    continue
                chosen = min(
                    claimers,
                    key=lambda it: (
                        agent_id not in it.docked,
                        it.name != server_of.get(agent_id),
                        it.claims[agent_id],
                    ),
                )
            until_ms = chosen.stamp_ms + self._terms.lease_ms
            votes[agent_id] = Vote(chosen.name, chosen.claims[agent_id], until_ms)
        return votes

    def _binds(self, agent_id: int, vote: Vote, now_ms: int) -> bool:
        is_dropped = self.known[vote.claimer].claims.get(agent_id) != vote.since_ms
        return not is_dropped and now_ms <= vote.until_ms + self._terms.clock_error_ms

    def _is_granted(self, agent_id: int, now_ms: int) -> bool:
        since_ms = self.known[self._name].claims[agent_id]
        votes = [it.votes[agent_id] for it in self.known.values() if agent_id in it.votes]
        until_ms = now_ms + self._terms.margin_ms
        count = sum(
            it.claimer == self._name and it.since_ms == since_ms and it.until_ms > until_ms for it in votes
        )
        return count >= (self._keeps if agent_id in self.granted else self._majority)

    def _is_heard(self, peer: PeerState, now_ms: int) -> bool:
        return now_ms <= peer.stamp_ms + self._terms.lease_ms + self._terms.clock_error_ms

    def _in_order(self) -> list[PeerState]:
        return [self.known[it] for it in self._names if it in self.known]

    def _places_m(self) -> dict[int, tuple[int, Point]]:
        """The newest place of each aMussel; of two told at one time the greater one, so that all take the same."""
        newest: dict[int, tuple[int, Point]] = {}
        for peer in self.known.values():
            for agent_id, told in peer.places_m.items():
                newest[agent_id] = max(told, newest.get(agent_id, told))
        return newest


@lru_cache(maxsize=64)
def _allocated(
    starts_m: tuple[Point, ...], places_m: tuple[tuple[int, Point], ...]
) -> tuple[tuple[int, ...], ...]:
    """Remembers the last divisions, because places seldom change, and aPads that agree divide alike."""
    return allocate(starts_m, dict(places_m))
