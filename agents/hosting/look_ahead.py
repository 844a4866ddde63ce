"""Look-ahead of a fleet in virtual time: its agents run many windows at once, instead of one at each tick.

As long as nothing happens to an aMussel, its windows are known before they are granted: each ends at the mission second
in which it next acts by itself. So agents compute the next windows while the supervisor still works on those before, and
a tick costs no round trip. A window with a stimulus, or with another end, is asked for in the ordinary way, and the agent
goes back to where it was. The outcomes are the same, by the law that cuts of time change nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from agents.hosting.agent_links import AgentLinks
from agents.hosting.agent_loop import MOST_AHEAD
from agents.hosting.host import Death, Grant
from agents.hosting.link_protocol import AheadWindow, Key, RunAhead

_AT_ONCE = MOST_AHEAD // 2
"""While the supervisor uses these, the agent runs as many more."""
_APART = 24
"""Orders to agents that began together are spread over so many ticks: all at once they would take the processor from the
supervisor that gave them."""


@dataclass(slots=True)
class _Lead:
    """The lead of one agent over the windows that count."""

    windows: deque[tuple[Key, AheadWindow]] = field(default_factory=deque)
    lived_ms: int | None = None
    """The end of its last window that counts."""
    asked: Key | None = None
    """The order to run ahead that is still unanswered."""
    at_once: int = 0
    """It doubles with each window in which nothing happened to the agent, so that a docked one seldom goes back."""


class LookAhead:
    """The windows that the agents of one host have run ahead."""

    def __init__(self, next_key: Callable[[], Key]) -> None:
        self._next_key = next_key
        self._leads: dict[int, _Lead] = {}

    def take(self, links: AgentLinks, grants: Mapping[int, Grant]) -> dict[int, tuple[Key, AheadWindow]]:
        """The outcomes that are there already, with the key of each; an agent without one is to be asked."""
        leads = self._leads
        waited = [
            agent_id
            for agent_id, grant in grants.items()
            if (lead := leads.get(agent_id)) and lead.asked and not lead.windows and not grant.stimuli
        ]
        if waited:
            self._await(links, waited)
        found: dict[int, tuple[Key, AheadWindow]] = {}
        for agent_id, grant in grants.items():
            if (lead := leads.get(agent_id)) is None:
                continue
            if not grant.stimuli and lead.windows and lead.windows[0][1].until_ms == grant.until_ms:
                found[agent_id] = lead.windows.popleft()
            else:
                self.forget(links, agent_id)
        return found

    def _await(self, links: AgentLinks, agent_ids: list[int]) -> None:
        """Waits for these agents, whose windows are all used up."""
        for agent_id, outcome in links.take_ahead(agent_ids).items():
            lead = self._leads[agent_id]
            if not isinstance(outcome, Death):
                lead.windows.extend([(outcome.key, window) for window in outcome.windows])
            lead.asked = None

    def lived_ms(self, agent_id: int) -> int | None:
        """The agent time that counts, to which an agent that ran ahead goes back; None before its first window."""
        lead = self._leads.get(agent_id)
        return None if lead is None else lead.lived_ms

    def run_on(self, links: AgentLinks, agent_id: int, grant: Grant) -> None:
        """Lets an agent that has just been granted this window run ahead of it."""
        if (lead := self._leads.get(agent_id)) is None:
            lead = self._leads[agent_id] = _Lead()
        lead.lived_ms = grant.until_ms
        lead.at_once = 0 if grant.stimuli else min(_AT_ONCE, 2 * lead.at_once + 1)
        fewest = MOST_AHEAD - _AT_ONCE - agent_id % _APART
        if lead.at_once and lead.asked is None and len(lead.windows) <= fewest:
            lead.asked = self._next_key()
            links.run_ahead(agent_id, lead.asked, RunAhead(lead.asked, lead.at_once, grant.until_ms).encode())

    def forget(self, links: AgentLinks, agent_id: int) -> None:
        """The windows that this agent ran ahead do not count."""
        links.forget_ahead(agent_id)
        if (lead := self._leads.get(agent_id)) is not None:
            lead.windows.clear()
            lead.asked = None
