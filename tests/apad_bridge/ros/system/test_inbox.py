from __future__ import annotations

import threading

from apad_bridge.ros.system.inbox import Inbox


def test_a_full_inbox_counts_what_it_drops_and_takes_what_must_not_be_lost() -> None:
    inbox: Inbox[int] = Inbox(capacity=2)
    for item in range(5):
        inbox.put(item)
    inbox.put(99, always=True)
    assert inbox.take() == [0, 1, 99] and inbox.dropped.total() == 3
    assert inbox.take() == []


def test_who_waits_is_woken_by_the_first_item() -> None:
    inbox: Inbox[int] = Inbox()
    got: list[int] = []
    waiter = threading.Thread(target=lambda: got.extend(inbox.take(wait_s=20.0)))
    waiter.start()
    inbox.put(1)
    waiter.join(10)
    assert got == [1]
