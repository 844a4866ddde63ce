"""The aPad's modem as a queue."""

import pytest

from agents.modem.frames import FrameKind, ModemFrame
from agents.water.apad_modem import APadModem, ModemSend, Unanswered

WORDS = ModemFrame(FrameKind.UNICAST, 255, 3, bytes(16))
PING = ModemFrame(FrameKind.PING, 255, 3)


@pytest.fixture
def keel() -> APadModem:
    return APadModem()


def test_it_sends_one_after_the_other(keel: APadModem) -> None:
    assert keel.next_due_ms is None
    assert keel.ask(3, WORDS) and keel.ask(4, WORDS)
    assert keel.advance(1000) == [ModemSend(0, 3, WORDS), ModemSend(505, 4, WORDS)]
    keel.ask(5, WORDS)
    assert keel.next_due_ms == 1010 and keel.advance(5000) == [ModemSend(1010, 5, WORDS)]


def test_asked_late_it_sends_at_once(keel: APadModem) -> None:
    keel.advance(700)
    keel.ask(3, WORDS)
    assert keel.advance(700) == [ModemSend(700, 3, WORDS)]


def test_nothing_is_sent_while_an_answer_is_awaited(keel: APadModem) -> None:
    keel.ask(3, PING)
    keel.ask(4, WORDS)
    assert keel.advance(1000) == [ModemSend(0, 3, PING)] and not keel.answered(4, 1000)
    assert keel.answered(3, 1000) and keel.advance(1000) == [ModemSend(1000, 4, WORDS)]


def test_an_answer_that_does_not_come_is_given_up_after_four_seconds(keel: APadModem) -> None:
    keel.ask(3, PING)
    keel.ask(4, WORDS)
    assert keel.advance(9000) == [ModemSend(0, 3, PING), Unanswered(4105, 3), ModemSend(4105, 4, WORDS)]
    assert not keel.answered(3, 9000)


def test_it_takes_only_so_much(keel: APadModem) -> None:
    assert [keel.ask(3, WORDS) for _ in range(257)] == [*[True] * 256, False]
    with pytest.raises(ValueError, match="time went back"):
        keel.advance(-1)


def test_what_waits_for_a_node_can_be_dropped() -> None:
    modem = APadModem()
    for node in (1, 2, None):
        assert modem.ask(node, WORDS, 1000)
    modem.forget(1)
    assert [it.node for it in modem.advance(10_000) if isinstance(it, ModemSend)] == [2, None]
