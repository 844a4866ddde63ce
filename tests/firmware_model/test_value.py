from dataclasses import replace

from firmware_model.value import value


@value
class Reading:
    at_ms: int
    charge: float = 1.0


def test_values_with_the_same_fields_are_one_key() -> None:
    assert {Reading(5): "first", Reading(5, 1.0): "second", Reading(6): "third"} == {
        Reading(5): "second",
        Reading(6): "third",
    }


def test_a_change_makes_another_value() -> None:
    before = Reading(5)
    assert (replace(before, charge=0.5), before) == (Reading(5, 0.5), Reading(5, 1.0))


def test_a_value_has_no_room_for_other_fields() -> None:
    assert not hasattr(Reading(5), "__dict__")
