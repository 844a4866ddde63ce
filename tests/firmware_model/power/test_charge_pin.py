from hypothesis import given
from hypothesis import strategies as st

from firmware_model.power.charge_pin import ChargePin, Edge, PinFault

CHATTER_MS = 2000
NEVER_CHECKED_MS = 1 << 40


def edges(
    levels: list[tuple[int, bool]], debounce_ms: int, until_ms: int, chatter_ms: int = CHATTER_MS
) -> list[tuple[int, Edge]]:
    pin, found = ChargePin(debounce_ms, False, chatter_ms, NEVER_CHECKED_MS), []

    def fire(by_ms: int) -> None:
        while pin.next_due_ms is not None and pin.next_due_ms <= by_ms:
            at_ms = pin.next_due_ms
            edge, _ = pin.due(at_ms)
            if edge is not None:
                found.append((at_ms, edge))

    for at_ms, high in levels:
        fire(at_ms)
        pin.level(high, at_ms)
    fire(until_ms)
    return found


def flips(high_ms: int, low_ms: int, times: int) -> list[tuple[int, bool]]:
    return [
        (1000 + n * (high_ms + low_ms) + after, high)
        for n in range(times)
        for after, high in ((0, True), (high_ms, False))
    ]


def test_chatter_without_end_is_decided_by_the_greater_part_of_the_time() -> None:
    # 40 ms high and 10 ms low never stays for 50 ms: 2 s after the first flip it was high for 1.6 s.
    assert edges(flips(40, 10, 200), 50, 20_000) == [
        (3000, Edge.ROSE),
        (1000 + 199 * 50 + 40 + 50, Edge.FELL),
    ]
    # In the opposite case it was high for 0.4 s of 2 s, and then it stays low.
    assert edges(flips(10, 40, 200), 50, 20_000) == []
    # Equal times high and low: the level stays as it was.
    assert edges(flips(25, 25, 200), 50, 20_000) == []


def test_chatter_and_a_missed_edge_are_said() -> None:
    pin = ChargePin(50, False, 100, 1000)
    pin.level(True, 0)
    pin.level(False, 40)
    pin.level(True, 60)
    # High for 40 ms and 40 ms of the first 100 ms.
    assert (pin.next_due_ms, pin.due(100)) == (100, (Edge.ROSE, PinFault.CHATTER))
    # It has been high since 60: certain at 110, without a new edge.
    assert (pin.next_due_ms, pin.due(110)) == (110, (None, None))
    pin.level_unseen(False, 2500)
    assert (pin.high, pin.wire_high, pin.next_due_ms) == (True, False, 3000)
    assert pin.due(3000) == (None, PinFault.MISSED)
    assert (pin.next_due_ms, pin.due(3050)) == (3050, (Edge.FELL, None))


def test_a_missed_edge_that_went_back_never_was() -> None:
    pin = ChargePin(50, False, 2000, 1000)
    pin.level_unseen(True, 100)
    pin.level_unseen(False, 900)
    assert pin.next_due_ms is None and not pin.sample_level(5000)


def test_a_check_finds_a_missed_edge_while_a_level_is_to_hold() -> None:
    """By hand: high from 980, and low unseen from 990: the check at 1000 finds it, and 50 ms begin there and at 1050."""
    pin = ChargePin(50, False, 2000, 1000)
    pin.level(True, 980)
    pin.level_unseen(False, 990)
    assert (pin.next_due_ms, pin.due(1000)) == (1000, (None, PinFault.MISSED))
    pin.level_unseen(True, 1010)
    assert (pin.next_due_ms, pin.due(1050)) == (1050, (None, PinFault.MISSED))
    assert (pin.next_due_ms, pin.due(1100)) == (1100, (Edge.ROSE, None))


def test_checks_go_on_as_the_counter_wraps_until_a_reset() -> None:
    """2^32 ticks of 32 768 Hz are 131 072 s. By hand: 131 100 s is the next whole minute, and after a reset 131 132 s."""
    pin = ChargePin(50, False, 2000, 60_000)
    pin.level_unseen(True, 131_073_000)
    assert pin.next_due_ms == 131_100_000
    pin.restart(False, 131_073_000)
    pin.level_unseen(True, 131_073_000)
    assert pin.next_due_ms == 131_132_000


def sampled(levels: list[tuple[int, bool]], debounce_ms: int, chatter_ms: int) -> list[tuple[int, Edge]]:
    """The same rules, millisecond by millisecond."""
    certain = seen = False
    found = []
    unsettled: list[bool] | None = None
    stayed_ms = 0
    for now_ms in range(1500):
        if unsettled is not None:
            unsettled.append(seen)
            stayed_ms += 1
            if stayed_ms == debounce_ms or len(unsettled) == chatter_ms:
                high = seen if stayed_ms == debounce_ms else certain
                if stayed_ms != debounce_ms and 2 * sum(unsettled) != len(unsettled):
                    high = 2 * sum(unsettled) > len(unsettled)
                if high != certain:
                    certain = high
                    found.append((now_ms, Edge.ROSE if high else Edge.FELL))
                unsettled = None if stayed_ms == debounce_ms else []
        for at_ms, high in levels:
            if at_ms == now_ms and high != seen:
                seen, stayed_ms = high, 0
                unsettled = [] if unsettled is None else unsettled
    return found


@given(
    st.lists(st.tuples(st.integers(0, 400), st.booleans()), max_size=40),
    st.integers(1, 40),
    st.integers(41, 100),
)
def test_edges_are_those_of_a_debouncer_that_samples_every_millisecond(
    raw: list[tuple[int, bool]], debounce_ms: int, chatter_ms: int
) -> None:
    levels = sorted(raw, key=lambda it: it[0])
    assert edges(levels, debounce_ms, 1400, chatter_ms) == sampled(levels, debounce_ms, chatter_ms)
