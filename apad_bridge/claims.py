"""What claims on the graph mean for a fleet that was there before and comes back: the graph goes before the journal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from apad_bridge.supervisor.roster import Became, Presence


@dataclass(frozen=True, slots=True)
class Claim:
    """A node's word that it speaks for these aMussels, `real` ones or simulated ones."""

    node: str
    real: bool
    since_s: float
    """Of the wall clock."""
    ids: frozenset[int]
    until_s: float
    """Of the monotonic clock."""


def given_back(before: Mapping[int, Became], claims: Iterable[Claim]) -> dict[int, str]:
    """The real aMussels that their claimant, which still claims real ones, claims no more; and who that is."""
    real = {claim.node: claim.ids for claim in claims if claim.real}
    return {
        agent_id: it.by
        for agent_id, it in before.items()
        if it.presence is Presence.REAL and it.by in real and agent_id not in real[it.by]
    }


def conflicts(
    presence_of: Callable[[int], Presence | None], before: Mapping[int, Became], claims: Iterable[Claim]
) -> list[str]:
    """A line for a person on each aMussel of which living claims say something else than the journal does."""
    claims = list(claims)
    lines = [
        f"aMussel {agent_id} was real by {node}, which claims it no more: it is taken back"
        for agent_id, node in sorted(given_back(before, claims).items())
    ]
    for claim in claims:
        for agent_id in sorted(claim.ids):
            was, what = presence_of(agent_id), "real" if claim.real else "simulated"
            outcome = _OUTCOMES.get((was, claim.real))
            if outcome is not None:
                lines.append(
                    f"aMussel {agent_id} was {was}, and {claim.node} claims it as {what} now: {outcome}"
                )
    return lines


_OUTCOMES: dict[tuple[Presence | None, bool], str] = {
    (Presence.SIMULATED, True): "it is handed over",
    (Presence.RETIRED, True): "it is handed over",
    (Presence.SIMULATED, False): "ours is retired",
    (Presence.REAL, False): "here it stays real",
}
"""By what an aMussel was and whether the claim is of a real one; a retired one that others simulate is as it should be."""
