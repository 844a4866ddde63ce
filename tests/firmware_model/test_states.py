"""Every state with every trigger, against a table written by hand from the firmware's rules."""

import pytest

from firmware_model.states import TABLE, Refused, State, Trigger, next_state

# One row a state: trigger initial -> next state; every pair that is not named must be refused.
ALLOWED = {
    "OFF": {"POWER_CAME_ON": "BOOTING"},
    "BOOTING": {
        "BOOTED_ON_BOTTOM": "ACTIVE",
        "BOOTED_AT_SURFACE": "FLOATING",
        "BOOTED_ON_CHARGER": "CHARGING",
    },
    "ACTIVE": {
        "PERMISSION_HEARD": "SURFACING",
        "BATTERY_EMPTIED": "EMPTY",
        "CHARGE_EDGE_ROSE": "CHARGING",
        "SURFACE_REACHED": "FLOATING",
    },
    "SURFACING": {"SURFACE_REACHED": "FLOATING", "CHARGE_EDGE_ROSE": "CHARGING"},
    "FLOATING": {
        "CHARGE_EDGE_ROSE": "CHARGING",
        "FLOAT_TIMED_OUT": "SINKING",
        "CLEAR_TO_SINK": "SINKING",
    },
    "CHARGING": {"CHARGE_EDGE_FELL": "RELEASED"},
    "RELEASED": {"CHARGE_EDGE_ROSE": "CHARGING", "CLEAR_TO_SINK": "SINKING"},
    "SINKING": {
        "BOTTOM_REACHED": "ACTIVE",
        "CHARGE_EDGE_ROSE": "CHARGING",
        "PERMISSION_HEARD": "SURFACING",
    },
    "EMPTY": {
        "PERMISSION_HEARD": "SURFACING",
        "CHARGE_EDGE_ROSE": "CHARGING",
        "SURFACE_REACHED": "FLOATING",
    },
}


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("trigger", Trigger)
def test_every_state_with_every_trigger(state: State, trigger: Trigger) -> None:
    expected = ALLOWED[state.name].get(trigger.name)
    if expected is None:
        with pytest.raises(Refused, match=f"{state.name} does not take {trigger.name}"):
            next_state(state, trigger)
    else:
        assert next_state(state, trigger) is State[expected]


def test_every_state_can_be_left_and_every_trigger_is_used() -> None:
    assert {state for state, _ in TABLE} == set(State)
    assert {trigger for _, trigger in TABLE} == set(Trigger)
