"""Who may be asked, and whose answer is late."""

from __future__ import annotations

from apad_bridge.acoustics.schedule import PendingPings


def test_the_first_that_may_be_asked_is_and_not_again_before_ten_minutes() -> None:
    inquiries = PendingPings()
    # The most urgent one does not answer: the others have their turn meanwhile.
    asked = [inquiries.next([3, 1, 2], now_ms) for now_ms in (0, 1000, 2000, 3000, 599_999, 600_000, 601_000)]
    assert asked == [3, 1, 2, None, None, 3, 1]
    assert inquiries.next([], 9_000_000) is None


def test_an_answer_is_awaited_for_as_long_again_as_a_modem_waits() -> None:
    inquiries = PendingPings()
    for agent_id, until_ms in ((2, 1500), (1, 1500), (3, 2000)):
        inquiries.await_answer(agent_id, until_ms)
    assert inquiries.answered(2) and not inquiries.answered(2) and not inquiries.answered(9)
    assert inquiries.given_up(5500) == []
    assert inquiries.given_up(5501) == [1]
    assert not inquiries.answered(1)
    assert inquiries.given_up(60_000) == [3]
    assert inquiries.given_up(90_000) == []
