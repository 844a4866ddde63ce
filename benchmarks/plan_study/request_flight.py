"""Flies a collection strategy on the queue of nearest_job.py: requests at random places, and one aPad that charges them.

The strategy gets the situations that a mission would give it, with each request as an aMussel in the pool. It is
charged where it is, as in the model, so all docks are free again for the next plan. As in a mission, a plan is flown to its
end, and a strategy that pre-empts plans the rest anew after each service.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import dist
from random import Random

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.strategy import CollectionStrategy
from benchmarks.plan_study.nearest_job import RequestQueue

_DOCKS = 4
_LEFT_OUT = 0.1
"""The share of the services, from the first on, that is not counted."""


@dataclass(frozen=True, slots=True)
class Served:
    latency_s: float
    """The mean time from a request until its charging ends."""
    rate_per_s: float


class RequestFlight:
    """One flight of a strategy.

    `busy_with` keeps so many requests waiting: the next one comes when a service ends. With `turns` the strategy plans at
    each request, too, from the place on the way. With `redrawn` the aPad and all that wait have new random places at each
    service, as the chain assumes.
    """

    def __init__(
        self,
        strategy: CollectionStrategy,
        queue: RequestQueue,
        seed: int,
        *,
        busy_with: int | None = None,
        turns: bool = False,
        redrawn: bool = False,
    ) -> None:
        self._strategy, self._queue, self._random = strategy, queue, Random(seed)
        self._is_busy, self._turns, self._redrawn = busy_with is not None, turns, redrawn
        self._pool: dict[int, Candidate] = {}
        self._asked_s: dict[int, float] = {}
        self._planned: list[int] = []
        self._last_id = 0
        self._now_s, self._next_s = 0.0, self._random.expovariate(queue.rate_per_s)
        self._place_m = self._anywhere()
        for _ in range(busy_with or 0):
            self._ask(self._now_s)

    def served(self, services: int) -> Served:
        begin_s, latency_s = 0.0, 0.0
        first = round(_LEFT_OUT * services)
        for count in range(services):
            if count == first:
                begin_s, latency_s = self._now_s, 0.0
            latency_s += self._serve()
        counted = services - first
        return Served(latency_s / counted, counted / (self._now_s - begin_s))

    def _serve(self) -> float:
        """Goes to one request and charges it; its latency."""
        if not self._pool:
            self._now_s = max(self._now_s, self._next_s)
        self._ask_until_now()
        if self._redrawn:
            self._place_m = self._anywhere()
            self._pool = {agent_id: self._request(agent_id) for agent_id in self._pool}
        agent_id = self._chosen()
        while self._turns and self._next_s < self._now_s + self._way_s(agent_id):
            share = (self._next_s - self._now_s) / self._way_s(agent_id)
            here_m, there_m = self._place_m, self._pool[agent_id].place_m
            self._place_m = (
                here_m[0] + share * (there_m[0] - here_m[0]),
                here_m[1] + share * (there_m[1] - here_m[1]),
            )
            self._now_s = self._next_s
            self._ask_until_now()
            self._planned.clear()
            agent_id = self._chosen()
        self._now_s += self._way_s(agent_id) + self._queue.charge_s
        self._planned.pop(0)
        self._place_m = self._pool.pop(agent_id).place_m
        if self._is_busy:
            self._ask(self._now_s)
        return self._now_s - self._asked_s.pop(agent_id)

    def _chosen(self) -> int:
        """The next aMussel of the plan, which is made anew as a mission does."""
        if not self._planned or getattr(self._strategy, "pre_empts", False):
            count = len(self._planned) or _DOCKS
            situation = Situation(*self._place_m, tuple(self._pool.values()), tuple(range(count)))
            self._planned = [step.agent_id for step in self._strategy.plan(situation, count).steps]
        return self._planned[0]

    def _way_s(self, agent_id: int) -> float:
        return dist(self._place_m, self._pool[agent_id].place_m) / self._queue.speed_m_s

    def _ask_until_now(self) -> None:
        while not self._is_busy and self._next_s <= self._now_s:
            self._ask(self._next_s)
            self._next_s += self._random.expovariate(self._queue.rate_per_s)

    def _ask(self, at_s: float) -> None:
        self._last_id += 1
        self._asked_s[self._last_id] = at_s
        self._pool[self._last_id] = self._request(self._last_id)

    def _request(self, agent_id: int) -> Candidate:
        place_m = self._anywhere()
        return Candidate(agent_id, *place_m, 0.3, 1.0, *place_m)

    def _anywhere(self) -> tuple[float, float]:
        return self._queue.side_m * self._random.random(), self._queue.side_m * self._random.random()
