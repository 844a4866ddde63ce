"""First given, then taken: the parent of several aPads and their seats, whatever is late, kept back or gone."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.runs.several.protocol import Handed, Orders
from apad_bridge.runs.several.reassignment import Reassigner

HOMES = {"a": (1, 2, 3), "b": (4, 5, 6), "c": (7, 8)}
IDS = tuple(agent_id for ids in HOMES.values() for agent_id in ids)


class Member:
    """A supervisor with its seat: it reads its orders when it is let, and says what it did when it is asked."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder
        self.served = set(HOMES[name])
        self.is_down = False
        self.said: list[dict[str, Any]] = []

    def obey(self, busy: frozenset[int]) -> None:
        orders = Orders.load(self.folder)
        if orders is None:
            return
        self.is_down |= orders.stands_down is not None
        gave = sorted(self.served - orders.serves.keys() - busy)
        kept = sorted((self.served - orders.serves.keys()) & busy)
        self.served = (self.served & orders.serves.keys()) | set(kept) | orders.serves.keys()
        self.said += [{"gave": [[it, 0, {"of": it}] for it in gave]}, {"kept": kept}]

    def tell(self, busy: frozenset[int]) -> None:
        seen = {
            "name": self.name,
            "is_down": self.is_down,
            "place_m": [0.0, 0.0],
            "places_m": {str(it): [10.0 * it, 0.0] for it in self.served},
            "movable": sorted(self.served - busy),
            "served": sorted(self.served),
        }
        self.said.append({"seen": seen})


def squad(folder: Path) -> tuple[Reassigner, dict[str, Member]]:
    members = {}
    for name in HOMES:
        (folder / name).mkdir()
        members[name] = Member(name, folder / name)
    return Reassigner(HOMES, {name: it.folder for name, it in members.items()}), members


ACTS = st.tuples(
    st.sampled_from(list(HOMES)),
    st.sampled_from(["obey", "tell", "hear", "down", "gone"]),
    st.frozensets(st.sampled_from(IDS), max_size=3),
)


# Orders are files that are synced to a disk, and what else that disk does is not the law's.
@settings(deadline=None)
@given(st.lists(ACTS, max_size=40))
def test_nobody_is_ever_served_twice_and_in_the_end_everybody_once(
    acts: list[tuple[str, str, frozenset[int]]],
) -> None:
    with tempfile.TemporaryDirectory() as path:
        dispatch, members = squad(Path(path))
        gone: set[str] = set()

        def act(name: str, what: str, busy: frozenset[int]) -> None:
            member = members[name]
            if name in gone:
                return
            if what == "obey":
                member.obey(busy)
            elif what == "tell":
                member.tell(busy)
            elif what == "hear" and member.said:
                dispatch.hear(name, member.said.pop(0))
            elif what == "down":
                dispatch.stand_down(name, "a test")
            elif what == "gone" and name == "c":
                # What it said before it ended was heard, as of a pipe.
                while member.said:
                    dispatch.hear(name, member.said.pop(0))
                gone.add(name)
                member.served = set()
                dispatch.gone(name)
            served = [agent_id for it in members.values() for agent_id in it.served]
            assert len(served) == len(set(served))
            assert sorted(it for ids in dispatch.shares.values() for it in ids) == list(IDS)

        for it in acts:
            act(*it)
        # Then all is quiet: orders are obeyed, and what was said is heard.
        for _ in range(4):
            for name in HOMES:
                for what in ("obey", "tell", *["hear"] * (len(members[name].said) + 3)):
                    act(name, what, frozenset())
        alive = [it for it in members.values() if it.name not in gone]
        assert all(it.served == dispatch.shares[it.name] for it in alive)
        lost = set(HOMES["c"]) if gone else set()
        served = {agent_id for it in alive for agent_id in it.served}
        assert set(IDS) - served <= lost
        if any(not it.is_down for it in alive):
            assert all(not it.served for it in alive if it.is_down)


def test_what_was_believed_goes_with_it(tmp_path: Path) -> None:
    dispatch, members = squad(tmp_path)
    dispatch.stand_down("a", "its node ended")
    for _ in range(3):
        for name, member in members.items():
            member.obey(frozenset({2}))
            member.tell(frozenset({2}))
            while member.said:
                dispatch.hear(name, member.said.pop(0))
    assert members["a"].served == {2} and dispatch.handed_on >= {1, 3}
    taken = {
        it: handed for name in ("b", "c") for it, handed in Orders.load(members[name].folder).serves.items()
    }  # type: ignore[union-attr]
    assert taken[1] == Handed(0, {"of": 1}) and 2 not in taken
    assert Orders.load(members["a"].folder) == Orders({2: Handed()}, "its node ended")


def test_orders_of_another_version_are_an_error(tmp_path: Path) -> None:
    assert Orders.load(tmp_path) is None
    (tmp_path / "squad.json").write_text("{}")
    with pytest.raises(KeyError):
        Orders.load(tmp_path)
