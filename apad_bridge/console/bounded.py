"""Bounds the connections of a console's web server: strangers who only connect take no place from a person's stop."""

from __future__ import annotations

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol

SILENT_S = 5.0
"""A connection that has sent no whole request after so many wall seconds is closed."""


class _Bounded(H11Protocol):
    most: int
    _closing: asyncio.TimerHandle

    @property
    def awaits_answer(self) -> bool:
        """True between a whole request and the end of its answer: the stream of an open page has no end."""
        return self.cycle is not None and not self.cycle.response_complete

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._closing = self.loop.call_later(SILENT_S, self._close_silent)
        if len(self.connections) > self.most:
            # Their timers began with them: uvicorn keeps them without an order.
            others = [it for it in self.connections if isinstance(it, _Bounded) and not it.awaits_answer]
            min(others, key=lambda it: it._closing.when(), default=self).abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._closing.cancel()
        super().connection_lost(exc)

    def abort(self) -> None:
        self.connections.discard(self)
        self.transport.abort()

    def _close_silent(self) -> None:
        if self.cycle is None:
            self.abort()


def bounded(most: int) -> type[asyncio.Protocol]:
    """The protocol of a server with at most so many connections.

    With one more, the oldest of those that await no answer is closed.
    """
    return type("Bounded", (_Bounded,), {"most": most})
