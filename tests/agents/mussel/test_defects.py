"""Defects of one aMussel: what it does with each, and that it does as before when it is healed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from fleets import PAPER
from hypothesis import given
from hypothesis import strategies as st
from seas import FLEET as WHOLE

from agents.fleet_config import FleetConfig, resting_on_bottom
from agents.mussel.agent import Agent
from agents.mussel.board_parts import BoardPart
from agents.mussel.failing_flash import FailingFlash
from agents.mussel.outputs import StimulusDropped
from agents.mussel.stimuli import (
    AgentStimulus,
    BuoyancyJammed,
    ChargeLost,
    ClockShifted,
    ContactBounced,
    ContactClosed,
    CrystalSkewed,
    PartFailed,
    PinDisturbed,
    SoundArrived,
    WasReset,
)
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.charge import Flow, grains
from firmware_model.power.charge_pin import PinFault
from firmware_model.sampling.flash import MemoryFlash
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

CODEC = MusselbedCodec()
PERMISSION = SoundArrived(CODEC.encode(CommandPacket(Kind.PERMISSION, 7)))
HOUR_MS = 3_600_000
HALF_MS = HOUR_MS // 2
"""A whole board samples each hour; a defect half an hour later lies between two samples."""


def agent(fleet: FleetConfig = PAPER, charge: float = 0.5, secondary: float = 1.0) -> Agent:
    physical = resting_on_bottom(1.0, 2.0, 3.0, charge, secondary)
    return Agent(fleet.maker().config(7), CODEC, physical, 0, ResetCause.POWER_ON)


def charge(mussel: Agent, now_ms: int) -> int:
    return mussel.config.board.charge.charge_at(mussel.board.primary, now_ms)


def records(mussel: Agent) -> list[Any]:
    assert mussel._logbook is not None
    return list(mussel._logbook.log.read(0, 99))


def first_alike(values: list[Any]) -> list[int]:
    """For each value the place of the first one that equals it."""
    return [values.index(it) for it in values]


FACTS: dict[str, Callable[[Agent, int], Any]] = {
    "state": lambda it, now_ms: it.board.state,
    "depth_m": lambda it, now_ms: it.body.depth_at_um(now_ms) / 1e6,
    "flow": lambda it, now_ms: it.board.primary.flow,
    "feed": lambda it, now_ms: it.board.feed,
    "anchor_ms": lambda it, now_ms: it.physical.primary.anchor_ms,
    "pin": lambda it, now_ms: (it.body.pin_high, it.body.pin_due_ms),
    "cause": lambda it, now_ms: it.board.reset_cause,
    "records": lambda it, now_ms: [record.sequence for record in records(it)],
    "counts": lambda it, now_ms: first_alike([record.counts for record in records(it)]),
    "samples": lambda it, now_ms: it.physical.samples,
    "torn": lambda it, now_ms: it._logbook is not None and it._logbook.log.torn,
    "boots_ms": lambda it, now_ms: [of.at_ms for of in it.take_truths() if of.state is State.BOOTING],
}
Step = tuple[int, list[AgentStimulus], dict[str, Any]]
"""A time in ms, what happens to the aMussel then, and facts afterwards; `drops` are reasons of what it did not take."""
ASKED: Step = (3_000, [PERMISSION], {})
FLOATS: list[Step] = [ASKED, (70_000, [], {"state": State.FLOATING})]
DOCKED: list[Step] = [
    *FLOATS,
    (70_000, [ContactClosed(0, 0)], {}),
    (71_000, [], {"state": State.CHARGING}),
]
CHECK_MS, TIMEOUT_MS = 60_000, 180_000
"""The board's periods: of its looks at the pin's level, and of its wait for the surface."""
NO_DEPTH: Step = (1_000, [PartFailed(BoardPart.DEPTH, 1)], {})
SPOILT = {"records": [0, 1, 4], "samples": 5}


def between(first: PartFailed, last: PartFailed, facts: dict[str, Any]) -> list[Step]:
    """A part fails after the second of five samples, and is healed after the fourth."""
    after = [(hour * HOUR_MS + HALF_MS, part) for hour, part in ((2, first), (4, last))]
    return [*((at_ms, [part], {}) for at_ms, part in after), (5 * HOUR_MS + HALF_MS, [], facts)]


STORIES: dict[str, tuple[FleetConfig, list[Step]]] = {
    "a jam holds the body where it is and then lets the last run be done": (
        PAPER,
        [
            (1_000, [BuoyancyJammed(1)], {}),
            ASKED,
            (20_000, [BuoyancyJammed(0)], {"state": State.SURFACING, "depth_m": 3.0}),
            (80_000, [], {"state": State.FLOATING, "depth_m": 0.0}),
        ],
    ),
    "a false edge deceives the board and charges nothing": (
        PAPER,
        [
            *FLOATS,
            (70_000, [PinDisturbed(1, 0)], {}),
            (100_000, [PinDisturbed(0, 0)], {"state": State.CHARGING, "flow": Flow.DISCHARGING}),
            (101_000, [], {"state": State.RELEASED}),
        ],
    ),
    "a missed edge is found by the level": (
        PAPER,
        [
            *FLOATS,
            (70_000, [PinDisturbed(0, 1), ContactClosed(0, 0)], {}),
            (70_000 + 2 * CHECK_MS, [], {"drops": [PinFault.MISSED.value], "state": State.CHARGING}),
        ],
    ),
    "a bouncing contact chatters until it holds": (
        PAPER,
        [
            *DOCKED,
            (71_000, [ContactBounced(50)], {}),
            (73_000, [], {"drops": [PinFault.CHATTER.value]}),
            (74_000, [], {"state": State.CHARGING, "pin": (True, 0)}),
        ],
    ),
    "a contact bounces in a dock only": (
        PAPER,
        [
            *FLOATS,
            (
                70_000,
                [ContactBounced(20)],
                {"drops": ["a contact bounced in a dock that does not hold this aMussel"], "others": 0},
            ),
        ],
    ),
    "the worst case is empty at once when it lost all its charge": (
        PAPER,
        [(60_000, [ChargeLost(grains(1.0), 0)], {}), (60_000, [], {"state": State.EMPTY})],
    ),
    "a whole board is fed by its other battery until that is lost too": (
        WHOLE,
        [
            (60_000, [ChargeLost(grains(1.0), 0)], {}),
            (60_000, [], {"state": State.EMPTY, "feed": ActiveBattery.SECONDARY}),
            (61_000, [ChargeLost(0, grains(1.0))], {}),
            (61_000, [], {"feed": ActiveBattery.NEITHER}),
        ],
    ),
    **{
        f"the worst case has none: {it!r}": (
            PAPER,
            [(0, [it], {"drops": [f"a defect of {whose}: the worst case has none"], "others": 0})],
        )
        for it, whose in [
            (ClockShifted(60_000), "the clock"),
            *(
                (PartFailed(getattr(BoardPart, part), 1), f"its {part.lower()}")
                for part in ("BUS", "WRITES", "CELLS", "SUPPLY", "FLASH")
            ),
        ]
    },
    "a pressure sensor that stands shows the surface once it is healed": (
        PAPER,
        [
            NO_DEPTH,
            ASKED,
            (100_000, [], {"state": State.SURFACING, "depth_m": 0.0}),
            (100_000, [PartFailed(BoardPart.DEPTH, 0)], {"state": State.FLOATING}),
        ],
    ),
    "a board that never notices the surface sinks again in time and then stays sinking": (
        PAPER,
        [
            NO_DEPTH,
            ASKED,
            (3_000 + 2 * TIMEOUT_MS, [], {"state": State.SINKING, "depth_m": 3.0}),
            (3_000 + 2 * TIMEOUT_MS, [PartFailed(BoardPart.DEPTH, 0)], {"state": State.ACTIVE}),
        ],
    ),
    **{
        f"a packet that overruns the UART is dropped: {name}": (
            fleet,
            [
                (3_000, [PartFailed(BoardPart.UARTS, 4)], {}),
                (4_000, [PERMISSION], {"drops": ["not a command"]}),
                (5_000, [PartFailed(BoardPart.UARTS, 0)], {}),
                (6_000, [PERMISSION], {"state": State.SURFACING}),
            ],
        )
        for name, fleet in (("worst case", PAPER), ("whole", WHOLE))
    },
    "a silent bus repeats the last counts as another record": (
        WHOLE,
        between(PartFailed(BoardPart.BUS, 1), PartFailed(BoardPart.BUS, 0), {"counts": [0, 1, 1, 1, 4]}),
    ),
    **{
        f"a write that fails spoils its record alone: {part.name} {value}": (
            WHOLE,
            between(PartFailed(part, value), PartFailed(part, 0), SPOILT),
        )
        for part, value in ((BoardPart.WRITES, 10), (BoardPart.WRITES, 1), (BoardPart.CELLS, 16))
    },
    "a flash that does not answer misses its records and keeps the others": (
        WHOLE,
        [
            *between(PartFailed(BoardPart.FLASH, 1), PartFailed(BoardPart.FLASH, 0), SPOILT),
            (6 * HOUR_MS, [PartFailed(BoardPart.FLASH, 1)], {"records": []}),
        ],
    ),
    # The third sample is torn at 3 h and 10 s; the board boots at once, and its next record is the fourth.
    **{
        f"a brown-out in a write tears one record and boots the board: {written} bytes": (
            WHOLE,
            [
                (2 * HOUR_MS + HALF_MS, [PartFailed(BoardPart.SUPPLY, written)], {}),
                (
                    5 * HOUR_MS + HALF_MS,
                    [],
                    {
                        **{"boots_ms": [0, 3 * HOUR_MS + 10_000], "cause": ResetCause.BROWN_OUT},
                        **{"torn": 1, "records": [0, 1, 3, 4]},
                    },
                ),
            ],
        )
        for written in (1, 10, 23)
    },
    "a brown-out that found no write is forgotten": (
        WHOLE,
        [
            (1_000, [PartFailed(BoardPart.SUPPLY, 10)], {}),
            (2_000, [PartFailed(BoardPart.SUPPLY, 0)], {}),
            (2 * HOUR_MS, [], {"cause": ResetCause.POWER_ON}),
        ],
    ),
}


@pytest.mark.parametrize(("fleet", "steps"), STORIES.values(), ids=STORIES)
def test_what_an_aMussel_does_with_its_defects(fleet: FleetConfig, steps: list[Step]) -> None:
    lived(agent(fleet), steps)


def lived(mussel: Agent, steps: list[Step]) -> None:
    """Plays the steps, and compares the facts after each."""
    for at_ms, stimuli, facts in steps:
        came = [*mussel.advance(at_ms), *(out for it in stimuli for out in mussel.receive(it, at_ms))]
        drops = [it.reason for it in came if isinstance(it, StimulusDropped)]
        seen = {"drops": drops, "others": len(came) - len(drops)}
        assert facts == {it: seen[it] if it in seen else FACTS[it](mussel, at_ms) for it in facts}, at_ms


@given(
    st.sampled_from([PAPER, WHOLE]),
    st.sampled_from([0.0, 0.01, 0.5, 1.0]),
    st.lists(st.tuples(st.integers(0, 10**6), st.sampled_from([0.0, 0.001, 0.3, 1.0])), max_size=6),
)
def test_a_loss_takes_its_charge_and_no_more_than_there_is(
    fleet: FleetConfig, at_first: float, losses: list[tuple[int, float]]
) -> None:
    mussel = agent(fleet, at_first)
    for at_ms, loss in sorted(losses):
        mussel.advance(at_ms)
        held, other = charge(mussel, at_ms), mussel.board.secondary
        mussel.receive(ChargeLost(grains(loss), 0), at_ms)
        assert charge(mussel, at_ms) == max(0, held - grains(loss))
        assert mussel.config.board.charge.charge_at(other, at_ms) == mussel.board.secondary.charge


def test_a_clock_jumps_and_runs_fast_until_it_is_healed() -> None:
    """Off by so much at four times: before, after the jump, after 1000 s that run fast, and 1000 s later."""
    mussel, off_ms = agent(WHOLE), []
    acts = (ClockShifted(0), ClockShifted(60_000), CrystalSkewed(10**6), CrystalSkewed(0), ClockShifted(0))
    for at_ms, act in zip((10_000, 10_000, 10_000, 1_010_000, 2_010_000), acts, strict=True):
        mussel.receive(act, at_ms)
        off_ms.append(mussel.board.clock_ms(at_ms) - at_ms)
    _, jumped, _, fast, _ = off_ms
    assert off_ms == [0, jumped, jumped, jumped + 1000, fast] and abs(jumped - 60_000) <= 1


@given(st.sampled_from([PAPER, WHOLE]), st.integers(0, 10**7))
def test_readings_scatter_within_their_noise_and_the_charge_does_not(fleet: FleetConfig, at_ms: int) -> None:
    noisy, healthy = agent(fleet), agent(fleet)
    noisy.receive(PartFailed(BoardPart.CONVERTER, grains(0.05)), 0)
    for mussel in (noisy, healthy):
        mussel.advance(at_ms)
    assert noisy.board.primary == healthy.board.primary
    for read, exact in zip(noisy.board.readings(at_ms), healthy.board.readings(at_ms), strict=True):
        assert abs(read - exact) <= grains(0.05) and 0 <= read <= grains(1.0)
    noisy.receive(PartFailed(BoardPart.CONVERTER, 0), at_ms)
    assert noisy.board.readings(at_ms) == healthy.board.readings(at_ms)


def test_noise_outlives_a_reset_of_the_board_and_differs_from_time_to_time() -> None:
    mussel = agent(PAPER)
    mussel.receive(PartFailed(BoardPart.CONVERTER, grains(0.05)), 0)
    mussel.receive(WasReset(ResetCause.BROWN_OUT), 1_000)
    times_ms = range(10_000, 20_000, 1_000)
    assert len({mussel.board.readings(it)[0] - charge(mussel, it) for it in times_ms}) == 10


@pytest.mark.parametrize(
    ("fleet", "act"),
    [
        pytest.param(PAPER, PartFailed(BoardPart.HOLD, 0), id="worst case: until it is healed"),
        pytest.param(WHOLE, PartFailed(BoardPart.HOLD, 0), id="whole: until it is healed"),
        pytest.param(PAPER, WasReset(ResetCause.BROWN_OUT), id="a reset reads the batteries once"),
    ],
)
def test_a_converter_that_stands_holds_its_readings(fleet: FleetConfig, act: AgentStimulus) -> None:
    mussel, seen = agent(fleet), []
    stands = PartFailed(BoardPart.HOLD, 1)
    for at_ms, acts in ((60_000, [stands]), (4_000_000, []), (4_000_000, [act]), (8_000_000, [])):
        mussel.advance(at_ms)
        for it in acts:
            mussel.receive(it, at_ms)
        seen.append((mussel.board.readings(at_ms)[0], charge(mussel, at_ms)))
    (stood, _), (still, _), (after, exact), (last, falls_to) = seen
    assert still == stood > after == exact > falls_to
    assert last == (exact if isinstance(act, WasReset) else falls_to)


def test_a_page_whose_erasure_failed_takes_no_record_until_it_is_erased() -> None:
    failing: dict[BoardPart, int] = {}
    flash = FailingFlash(MemoryFlash(pages=3, page_bytes=96), failing)
    flash.program(96, b"old")
    failing[BoardPart.FLASH] = 1
    flash.erase(1)
    flash.program(0, b"lost")
    failing.clear()
    flash.program(96, b"new")
    flash.program(100, b"free")
    assert flash.read(0, 4) == bytes(4) and flash.read(96, 8) == b"old\0free"
    flash.erase(1)
    flash.program(96, b"new")
    assert flash.read(96, 8) == b"new" + bytes(5)
