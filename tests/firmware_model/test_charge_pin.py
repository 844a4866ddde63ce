from hypothesis import given
from hypothesis import strategies as st

from firmware_model.charge_pin import ChargePin, Edge


def edges(levels: list[tuple[int, bool]], debounce_ms: int, until_ms: int) -> list[tuple[int, Edge]]:
    pin, found = ChargePin(debounce_ms, high=False), []

    def fire(by_ms: int) -> None:
        while pin.next_due_ms is not None and pin.next_due_ms <= by_ms:
            at_ms = pin.next_due_ms
            edge = pin.due(at_ms)
            assert edge is not None
            found.append((at_ms, edge))

    for at_ms, high in levels:
        fire(at_ms)
        pin.level(high, at_ms)
    fire(until_ms)
    return found


def test_an_edge_comes_after_the_debounce_time() -> None:
    assert edges([(100, True), (500, False)], 50, 1000) == [(150, Edge.ROSE), (550, Edge.FELL)]


def test_a_bounce_shorter_than_the_debounce_time_never_was() -> None:
    assert edges([(100, True), (149, False), (160, True), (180, False)], 50, 1000) == []


def test_chatter_delays_the_edge_until_it_has_settled() -> None:
    chatter = [(100, True), (110, False), (120, True), (130, False), (140, True)]
    assert edges(chatter, 50, 1000) == [(190, Edge.ROSE)]


@given(
    st.lists(st.tuples(st.integers(0, 2000), st.booleans()), max_size=30),
    st.integers(0, 200),
)
def test_edges_alternate_and_end_at_the_last_level(raw: list[tuple[int, bool]], debounce_ms: int) -> None:
    levels = sorted(raw, key=lambda it: it[0])
    found = edges(levels, debounce_ms, 10_000)
    kinds = [edge for _, edge in found]
    assert kinds == [Edge.ROSE if n % 2 == 0 else Edge.FELL for n in range(len(kinds))]
    last_high = levels[-1][1] if levels else False
    assert (kinds[-1] is Edge.ROSE if kinds else False) == last_high
