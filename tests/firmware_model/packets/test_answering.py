"""Answers to pings: their states and times, their cost, and that the board continues its work afterwards."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import pytest

from firmware_model.actions import Dropped, RunBuoyancy, SendAnswer, SendStatus, SetRail, StateChanged
from firmware_model.bench import Bench
from firmware_model.bench.trace import line
from firmware_model.config import FullFirmware
from firmware_model.packets import EVERYONE, CommandPacket, Kind
from firmware_model.power.charge import FULL
from firmware_model.power.rails import Rail
from firmware_model.states import State
from firmware_model.stimuli import ModemSpoke
from firmware_model.table_one import FIELD, HOURLY, LOADS, WORST_CASE, board, power
from tests.firmware_model.conftest import asleep as after_boot
from tests.firmware_model.conftest import lives

asleep = partial(after_boot, minutes=30)
"""Between two wakes."""


@pytest.fixture
def bench() -> Bench:
    return asleep()


def test_a_sleeper_wakes_reads_its_batteries_answers_and_sleeps_on(bench: Bench) -> None:
    lives(bench, "ping 5min")
    assert [line(it) for it in bench.trace] == [
        # The modem receives for 105 ms, the MU is awake for half a second before the answer and while it is sent.
        "  0:30:00.000      MODEM_LISTENING off",
        "  0:30:00.000      MODEM_RECEIVING on",
        "  0:30:00.000  SLEEPING -PING_HEARD-> SLEEPING",
        "  0:30:00.000      MU_ASLEEP off",
        "  0:30:00.000      MU_ACTIVE on",
        "  0:30:00.105      MODEM_LISTENING on",
        "  0:30:00.105      MODEM_RECEIVING off",
        "  0:30:00.500      MODEM_LISTENING off",
        "  0:30:00.500      MODEM_TRANSMITTING on",
        "  0:30:00.500      asked, and answered by MODEM_TRANSMITTING",
        "  0:30:00.893      MU_ASLEEP on",
        "  0:30:00.893      MU_ACTIVE off",
        "  0:30:00.893      MODEM_LISTENING on",
        "  0:30:00.893      MODEM_TRANSMITTING off",
    ]


def test_an_answer_costs_what_its_rails_draw_and_the_ledger_knows() -> None:
    bench, other = asleep(), asleep()
    bench.command(Kind.PING)
    for it in (bench, other):
        it.run(minutes=5)
    receiving = 105 * (LOADS.of[Rail.MODEM_RECEIVING] - LOADS.of[Rail.MODEM_LISTENING])
    awake = 893 * (LOADS.of[Rail.MU_ACTIVE] - LOADS.of[Rail.MU_ASLEEP])
    sending = 393 * (LOADS.of[Rail.MODEM_TRANSMITTING] - LOADS.of[Rail.MODEM_LISTENING])
    assert other.primary - bench.primary == receiving + awake + sending
    # By hand, of 7400 mWh: 393 ms at 1500 - 12.5 mW are 0.162 mWh, and the MU awake for 893 ms 0.11 more.
    assert (other.primary - bench.primary) / FULL * 7400 == pytest.approx(0.162 + 0.110, abs=0.004)
    assert bench.ledger is not None and other.ledger is not None
    for it in (bench.ledger, other.ledger):
        it.settle(bench.now_ms)
    assert (
        bench.ledger.grains()[State.SLEEPING, Rail.MODEM_TRANSMITTING]
        == 393 * LOADS.of[Rail.MODEM_TRANSMITTING]
    )
    spent = sum(bench.ledger.by_rail().values()) - sum(other.ledger.by_rail().values())
    assert spent == receiving + awake + sending


def test_a_wake_under_way_is_neither_broken_off_nor_made_longer() -> None:
    """After a ping in any part of a long wake, it samples, processes and transmits in its timeslot at the usual time."""
    bench, other = (Bench(board(FIELD, power())) for _ in range(2))
    for at_ms in (3_605_000, 3_650_000, 3_700_000):
        bench.run_until(at_ms)
        bench.command(Kind.PING)
    for it in (bench, other):
        it.run_until(4_000_000)
    assert [it.at_ms for it in bench.did(SendAnswer)] == [3_605_500, 3_650_500, 3_700_500]
    assert [it for it in bench.did(StateChanged) if it.old is not it.new] == other.did(StateChanged)
    assert bench.did(SendStatus) == other.did(SendStatus) != []


@pytest.mark.parametrize("kind", [Kind.PERMISSION, Kind.HOVER])
def test_on_its_way_and_at_a_depth_it_answers_and_its_motors_do_not_run_again(
    bench: Bench, kind: Kind
) -> None:
    bench.command(kind)
    lives(bench, "30s ping 5s")
    assert len(bench.did(SendAnswer)) == 1 and len(bench.did(RunBuoyancy)) == 1


def test_on_its_backup_battery_it_answers_and_that_battery_pays() -> None:
    bench = asleep(primary=0.0, secondary=0.5)
    assert bench.state is State.EMPTY
    before = bench.secondary
    lives(bench, "ping 1min")
    assert len(bench.did(SendAnswer)) == 1 and bench.state is State.EMPTY
    assert before - bench.secondary > 393 * LOADS.of[Rail.MODEM_TRANSMITTING]


def test_afloat_docked_and_released_it_does_not_answer_by_sound(bench: Bench) -> None:
    refused = []
    for script in ("permission 2min", "rises 2min", "falls 100ms"):
        lives(bench, script)
        refused += bench.command(Kind.PING)
    assert [it.reason for it in refused if isinstance(it, Dropped)] == [
        f"{state} does not take PING_HEARD" for state in ("FLOATING", "CHARGING", "RELEASED")
    ]
    assert bench.did(SendAnswer) == []


def test_one_that_was_lifted_out_before_it_could_answer_does_not(bench: Bench) -> None:
    lives(bench, "ping 100ms rises 5s")
    assert bench.did(SendAnswer) == [] and bench.state is State.CHARGING
    assert [it.reason for it in bench.did(Dropped)] == ["an answer: it is CHARGING by now"]
    assert bench.board.rails == 1 << Rail.MU_ASLEEP | 1 << Rail.MODEM_LISTENING


def test_it_answers_one_question_at_a_time_and_hears_nothing_while_it_does(bench: Bench) -> None:
    drops = bench.command(Kind.PING) + bench.command(Kind.PING)
    bench.run(ms=600)
    drops += bench.command(Kind.PERMISSION)
    bench.run(minutes=1)
    assert [it.reason for it in drops if isinstance(it, Dropped)] == [
        "a ping before the last one was answered",
        "the modem is not listening",
    ]
    assert len(bench.did(SendAnswer)) == 1 and bench.state is State.SLEEPING


def test_a_question_to_everyone_is_answered_by_nobody(bench: Bench) -> None:
    (dropped,) = (it for it in bench.hear(CommandPacket(Kind.PING, EVERYONE)) if isinstance(it, Dropped))
    assert dropped.reason == "a ping for everyone: all would answer at once"
    bench.run(minutes=1)
    assert bench.did(SendAnswer) == []


def test_the_worst_case_says_nothing() -> None:
    bench = Bench(replace(board(None, power()), whole=None, charge=WORST_CASE))
    bench.run(minutes=1)
    (change,) = bench.command(Kind.PING)
    assert isinstance(change, StateChanged) and change.new is State.ACTIVE
    bench.tell(ModemSpoke(105))
    bench.run(minutes=1)
    assert bench.did(SendAnswer) == bench.did(SetRail) == []


def test_a_reset_forgets_what_it_was_asked(bench: Bench) -> None:
    lives(bench, "ping 100ms")
    bench.reset(bench.board.reset_cause)  # type: ignore[arg-type]
    bench.run(minutes=1)
    assert bench.did(SendAnswer) == []


def test_what_the_modem_sends_by_itself_is_drawn_without_waking_the_board(bench: Bench) -> None:
    bench.tell(ModemSpoke(105))
    assert not bench.board.is_modem_listening
    bench.run(minutes=1)
    rails = [(it.at_ms - 1_800_000, it.rail, it.on) for it in bench.did(SetRail)]
    assert rails == [
        (0, Rail.MODEM_LISTENING, False),
        (0, Rail.MODEM_TRANSMITTING, True),
        (105, Rail.MODEM_LISTENING, True),
        (105, Rail.MODEM_TRANSMITTING, False),
    ]
    assert bench.did(StateChanged) == []


@pytest.mark.parametrize(("first_ms", "second_ms", "ends_ms"), [(1000, 105, 1000), (105, 1000, 1050)])
def test_a_modem_that_is_told_to_send_while_it_sends_ends_with_the_later_one(
    bench: Bench, first_ms: int, second_ms: int, ends_ms: int
) -> None:
    """Only a user who opened the modem can tell it so: while it sends, it hears no ping. A short one ends no long one."""
    bench.tell(ModemSpoke(first_ms))
    bench.run(ms=50)
    bench.tell(ModemSpoke(second_ms))
    bench.run(minutes=1)
    rails = [(it.at_ms - 1_800_000, it.on) for it in bench.did(SetRail) if it.rail is Rail.MODEM_TRANSMITTING]
    assert rails == [(0, True), (ends_ms, False)]


def test_of_the_modes_of_the_mu_and_the_modem_never_two_are_on() -> None:
    bench = Bench(board(FIELD, power()))
    for minutes in range(1, 90, 3):
        bench.run_until(minutes * 60_000)
        bench.command(Kind.PING)
        bench.tell(ModemSpoke(105))
    on: set[Rail] = set()
    modes = ({Rail.MU_ASLEEP, Rail.MU_ACTIVE}, {it for it in Rail if it.name.startswith("MODEM")})
    for it, after in pairwise([*bench.did(SetRail), SetRail(1 << 60, Rail.PI, False)]):
        (on.add if it.on else on.discard)(it.rail)
        if after.at_ms > it.at_ms:
            assert [len(on & mode) for mode in modes] == [1, 1]


@pytest.mark.parametrize("wrong", [{"turnaround_ms": -1}, {"answer_ms": 0}])
def test_a_turnaround_and_an_answer_take_time(wrong: dict[str, int]) -> None:
    whole = board(HOURLY, power()).whole
    assert isinstance(whole, FullFirmware)
    with pytest.raises(ValueError, match="turnaround_ms must not be negative, and answer_ms positive"):
        replace(whole, **wrong)
