"""First given, then taken: the parent of several aPads and its members, with late, refused and lost transfers."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.runs.parent_protocol import (
    APadView,
    Gave,
    Kept,
    Orders,
    TransferredBelief,
)
from apad_bridge.runs.several.reassignment import Reassigner

HOMES = {"a": (1, 2, 3), "b": (4, 5, 6), "c": (7, 8)}
IDS = tuple(agent_id for ids in HOMES.values() for agent_id in ids)


class Member:
    """A supervisor with its link: `obey` reads and applies its orders, `report` adds a view to its reports."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder
        self.served = set(HOMES[name])
        self.is_down = False
        self.reports: list[APadView | Gave | Kept] = []

    def obey(self, busy: frozenset[int]) -> None:
        orders = Orders.load(self.folder)
        if orders is None:
            return
        self.is_down |= orders.stands_down is not None
        gave = sorted(self.served - orders.serves.keys() - busy)
        estimate = sorted((self.served - orders.serves.keys()) & busy)
        self.served = (self.served & orders.serves.keys()) | set(estimate) | orders.serves.keys()
        self.reports += [Gave({it: TransferredBelief(0, {"of": it}) for it in gave}), Kept(tuple(estimate))]

    def report(self, busy: frozenset[int]) -> None:
        places_m = {it: (10.0 * it, 0.0) for it in self.served}
        self.reports.append(
            APadView(self.name, self.is_down, (0.0, 0.0), places_m, frozenset(self.served - busy))
        )


def opened(folder: Path) -> tuple[Reassigner, dict[str, Member]]:
    members = {}
    for name in HOMES:
        (folder / name).mkdir()
        members[name] = Member(name, folder / name)
    return Reassigner(HOMES, {name: it.folder for name, it in members.items()}), members


ACTS = st.tuples(
    st.sampled_from(list(HOMES)),
    st.sampled_from(["obey", "report", "receive", "down", "end"]),
    st.frozensets(st.sampled_from(IDS), max_size=3),
)


# Orders are files that are synced to a disk, and a busy disk must not fail this test.
@settings(deadline=None)
@given(st.lists(ACTS, max_size=40))
def test_nobody_is_ever_served_twice_and_in_the_end_everybody_once(
    acts: list[tuple[str, str, frozenset[int]]],
) -> None:
    with tempfile.TemporaryDirectory() as path:
        reassigner, members = opened(Path(path))
        ended: set[str] = set()

        def act(name: str, what: str, busy: frozenset[int]) -> None:
            member = members[name]
            if name in ended:
                return
            if what == "obey":
                member.obey(busy)
            elif what == "report":
                member.report(busy)
            elif what == "receive" and member.reports:
                reassigner.receive(name, member.reports.pop(0))
            elif what == "down":
                reassigner.stand_down(name, "a test")
            elif what == "end" and name == "c":
                # A pipe still delivers the reports that were written before the end.
                while member.reports:
                    reassigner.receive(name, member.reports.pop(0))
                ended.add(name)
                member.served = set()
                reassigner.member_ended(name)
            served = [agent_id for it in members.values() for agent_id in it.served]
            assert len(served) == len(set(served))
            assert sorted(it for ids in reassigner.shares.values() for it in ids) == list(IDS)

        for it in acts:
            act(*it)
        # Then there are no more faults: all orders are obeyed, and all reports are received.
        for _ in range(4):
            for name in HOMES:
                for what in ("obey", "report", *["receive"] * (len(members[name].reports) + 3)):
                    act(name, what, frozenset())
        alive = [it for it in members.values() if it.name not in ended]
        assert all(it.served == reassigner.shares[it.name] for it in alive)
        lost = set(HOMES["c"]) if ended else set()
        served = {agent_id for it in alive for agent_id in it.served}
        assert set(IDS) - served <= lost
        if any(not it.is_down for it in alive):
            assert all(not it.served for it in alive if it.is_down)


def test_what_was_believed_goes_with_it(tmp_path: Path) -> None:
    reassigner, members = opened(tmp_path)
    reassigner.stand_down("a", "its node ended")
    for _ in range(3):
        for name, member in members.items():
            member.obey(frozenset({2}))
            member.report(frozenset({2}))
            while member.reports:
                reassigner.receive(name, member.reports.pop(0))
    assert members["a"].served == {2} and reassigner.handed_on >= {1, 3}
    taken = {
        it: transfer
        for name in ("b", "c")
        for it, transfer in Orders.load(members[name].folder).serves.items()
    }  # type: ignore[union-attr]
    assert taken[1] == TransferredBelief(0, {"of": 1}) and 2 not in taken
    assert Orders.load(members["a"].folder) == Orders({2: TransferredBelief()}, "its node ended")


def test_orders_of_another_version_are_an_error(tmp_path: Path) -> None:
    assert Orders.load(tmp_path) is None
    (tmp_path / "squad.json").write_text("{}")
    with pytest.raises(KeyError):
        Orders.load(tmp_path)
