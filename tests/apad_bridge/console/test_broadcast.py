"""The part of the console that sends news to every open page."""

from __future__ import annotations

import asyncio
from typing import Any

from apad_bridge.console.server import Broadcast, ConsoleEnding


class Feed:
    """Gives what a page lacks once, and breaks at the first look for news."""

    def since(self, counts: Any) -> dict[str, Any]:
        return {"sample": 1}

    def poll(self) -> dict[str, Any]:
        raise ZeroDivisionError("a defect")


def test_a_defect_ends_the_streams_of_all_pages_and_is_told() -> None:
    told: list[Exception] = []

    async def story() -> list[bytes]:
        broadcast = Broadcast(Feed(), ConsoleEnding(lambda why: None, lambda: False, told.append))  # type: ignore[arg-type]
        stream = broadcast.stream((0, 0, 0, 0, 0))
        first = await anext(stream)
        await broadcast.run()
        return [first, *[data async for data in stream]]

    assert asyncio.run(asyncio.wait_for(story(), 30)) == [b'data: {"sample":1}\n\n']
    assert [str(it) for it in told] == ["a defect"]
