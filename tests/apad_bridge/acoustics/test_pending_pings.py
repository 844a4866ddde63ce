"""Tests which aMussel may be asked, and which answer is late."""

from __future__ import annotations

from apad_bridge.acoustics.schedule import PendingPings


def test_the_first_that_may_be_asked_is_and_not_again_before_ten_minutes() -> None:
    pending = PendingPings()
    # The most urgent aMussel does not answer; the others are asked meanwhile.
    asked = [pending.next([3, 1, 2], now_ms) for now_ms in (0, 1000, 2000, 3000, 599_999, 600_000, 601_000)]
    assert asked == [3, 1, 2, None, None, 3, 1]
    assert pending.next([], 9_000_000) is None


def test_an_answer_is_awaited_for_as_long_again_as_a_modem_waits() -> None:
    pending = PendingPings()
    for agent_id, until_ms in ((2, 1500), (1, 1500), (3, 2000)):
        pending.await_answer(agent_id, until_ms)
    assert pending.answered(2) and not pending.answered(2) and not pending.answered(9)
    assert pending.given_up(5500) == [] and pending.given_up(5501) == [1]
    assert not pending.answered(1) and pending.given_up(60_000) == [3]
    assert pending.given_up(90_000) == []
