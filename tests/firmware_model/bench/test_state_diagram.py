"""The pages of states show the firmware's own transition table, and explain each state."""

import re
from pathlib import Path

from firmware_model.bench.state_diagram import blocks, mermaid, numbers
from firmware_model.power.rails import Rail
from firmware_model.states import TABLE, State, Trigger

PAGE = Path(__file__).parents[3] / "docs/firmware-states.md"
MADE = PAGE.parent / "reference/states.md"


def test_the_page_is_current() -> None:
    assert blocks() in MADE.read_text(), "run docs/reference/make"


def test_the_diagram_says_the_whole_table_and_nothing_else() -> None:
    drawn = {}
    for old, new, triggers in re.findall(r"^ +(\w+) --> (\w+): (.+)$", mermaid(), re.MULTILINE):
        for trigger in triggers.split(", "):
            drawn[State[old], Trigger[trigger]] = State[new]
    assert drawn == TABLE


def test_the_page_has_the_numbers_of_states_and_the_bits_of_rails() -> None:
    for names in (State, Rail):
        assert f"```text\n{numbers(names)}\n```" in MADE.read_text(), "run docs/reference/make"


def test_the_page_explains_every_state() -> None:
    text = PAGE.read_text()
    assert set(re.findall(r"^- `(\w+)`", text, re.MULTILINE)) == {state.name for state in State}
