from typing import Any

import pytest
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


Steps = list[tuple[tuple[Any, ...], dict[str, Any]]]
CALM = 50, False, 2000
SCENES: dict[str, tuple[tuple[Any, ...], Steps]] = {
    # High for 40 ms and 40 ms of the first 100 ms. It has been high since 60: certain at 110, without a new edge.
    "chatter and a missed edge are said": (
        (50, False, 100, 1000),
        [
            (("level", True, 0), {}),
            (("level", False, 40), {}),
            (("level", True, 60), {"next_ms": 100}),
            (("due", 100), {"told": (Edge.ROSE, PinFault.CHATTER), "next_ms": 110}),
            (("due", 110), {"told": (None, None)}),
            (("level_unseen", False, 2500), {"levels": (True, False), "next_ms": 3000}),
            (("due", 3000), {"told": (None, PinFault.MISSED), "next_ms": 3050}),
            (("due", 3050), {"told": (Edge.FELL, None)}),
        ],
    ),
    "a missed edge that went back never was": (
        (*CALM, 1000),
        [
            (("level_unseen", True, 100), {}),
            (("level_unseen", False, 900), {"next_ms": None}),
            (("sample_level", 5000), {"told": False}),
        ],
    ),
    # By hand: high from 980, and low unseen from 990: the check at 1000 finds it, and 50 ms begin there and at 1050.
    "a check finds a missed edge while a level is to hold": (
        (*CALM, 1000),
        [
            (("level", True, 980), {}),
            (("level_unseen", False, 990), {"next_ms": 1000}),
            (("due", 1000), {"told": (None, PinFault.MISSED)}),
            (("level_unseen", True, 1010), {"next_ms": 1050}),
            (("due", 1050), {"told": (None, PinFault.MISSED), "next_ms": 1100}),
            (("due", 1100), {"told": (Edge.ROSE, None)}),
        ],
    ),
    # 2^32 ticks of 32 768 Hz are 131 072 s. By hand: 131 100 s is the next whole minute, and after a reset 131 132 s.
    "checks go on as the counter wraps until a reset": (
        (*CALM, 60_000),
        [
            (("level_unseen", True, 131_073_000), {"next_ms": 131_100_000}),
            (("restart", False, 131_073_000), {}),
            (("level_unseen", True, 131_073_000), {"next_ms": 131_132_000}),
        ],
    ),
}
"""A pin, calls of it, and what it tells then."""


@pytest.mark.parametrize(("made", "steps"), SCENES.values(), ids=SCENES)
def test_scene(made: tuple[Any, ...], steps: Steps) -> None:
    pin = ChargePin(*made)
    for (method, *values), wanted in steps:
        told = getattr(pin, method)(*values)
        found = {"told": told, "next_ms": pin.next_due_ms, "levels": (pin.high, pin.wire_high)}
        assert {name: found[name] for name in wanted} == wanted, (method, values)


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
