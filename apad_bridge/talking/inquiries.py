"""Who was asked when, and whose answer is still awaited. Agent time."""

from __future__ import annotations

from collections.abc import Sequence

from agents.water.apad_modem import ANSWER_TIMEOUT_MS

ASK_AGAIN_MS = 600_000
"""Before one that did not answer, or that too little is known of still, is asked again."""


class Inquiries:
    """Questions of one kind to many aMussels, one of which is asked at a time."""

    def __init__(self) -> None:
        self._asked_ms: dict[int, int] = {}
        self._awaited: dict[int, int] = {}

    def kept(self) -> list[tuple[int, int]]:
        """Who was asked when. What is awaited is left out: it dies with the water that it is on its way in."""
        return list(self._asked_ms.items())

    def restore(self, kept: list[tuple[int, int]]) -> None:
        self._asked_ms = dict(kept)

    def next(self, wanted: Sequence[int], now_ms: int) -> int | None:
        """The first of the `wanted` that may be asked now, which it so is."""
        for agent_id in wanted:
            if self._asked_ms.get(agent_id, now_ms - ASK_AGAIN_MS) + ASK_AGAIN_MS <= now_ms:
                self._asked_ms[agent_id] = now_ms
                return agent_id
        return None

    def await_answer(self, agent_id: int, until_ms: int) -> None:
        """The question goes out; its answer has come by `until_ms`, and as long again as a modem waits is allowed for."""
        self._awaited[agent_id] = until_ms + ANSWER_TIMEOUT_MS

    def answered(self, agent_id: int) -> bool:
        """It said how it is; whether that was awaited."""
        return self._awaited.pop(agent_id, None) is not None

    def given_up(self, now_ms: int) -> list[int]:
        """Whose answer did not come in time, by id."""
        late = sorted(agent_id for agent_id, until_ms in self._awaited.items() if until_ms < now_ms)
        for agent_id in late:
            del self._awaited[agent_id]
        return late
