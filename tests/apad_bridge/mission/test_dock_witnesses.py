"""A docking counts where no witness of it stands alone, and one that is false changes nothing."""

from itertools import product

import pytest

from apad_bridge.beliefs.belief import Belief, Source
from apad_bridge.mission.docking.dock_witnesses import doubt, says_docked
from firmware_model.states import State


def heard(state: State, learned_from: Source = Source.PACKET) -> Belief:
    return Belief(7, 1000, state, 1.0, 1.0, 0.0, 0.0, learned_from=learned_from)


@pytest.mark.parametrize(
    ("belief", "said"),
    [
        (None, None),
        (heard(State.CHARGING), True),
        (heard(State.REPORTING), True),
        (heard(State.FLOATING), None),
        (heard(State.SLEEPING), False),
        (heard(State.CALLING), False),
        (heard(State.CHARGING, Source.PACKET | Source.DOCKING), None),
        (heard(State.ACTIVE, Source.PACKET | Source.DOCKING), None),
    ],
)
def test_an_amussel_says_nothing_of_a_dock_before_it_is_heard_in_it(
    belief: Belief | None, said: bool | None
) -> None:
    assert says_docked(belief) is said


def test_one_false_witness_of_three_neither_makes_a_docking_nor_takes_one_away() -> None:
    words = {True: heard(State.CHARGING), False: heard(State.ACTIVE), None: heard(State.FLOATING)}
    counted = {
        (own, named)
        for own, named in product((True, False, None), repeat=2)
        if doubt(words[own], named) is None
    }
    # The vehicle says that a dock holds it. So where it is held one other may be false, and where it is not the vehicle is.
    assert counted == {(True, True), (True, False), (False, True), (True, None), (None, True)}
