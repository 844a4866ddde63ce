"""Rules for links that are cut, black out for a while or lose packets, on top of the water's own effects.

A rule has a direction, so a link may be worse one way than the other. Times are agent milliseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from agents.water.csv_table import number_of, read_rows

COLUMNS = ("from", "to", "loss", "since_s", "until_s")
ANY = "*"


@dataclass(frozen=True, slots=True)
class LinkRule:
    """A packet from `sender` to `receiver` (None is any) is lost with probability `loss`; 1 cuts the link.

    The rule holds for packets that begin from `since_ms` on and before `until_ms`; None is for ever.
    """

    sender: int | None
    receiver: int | None
    loss: float
    since_ms: int = 0
    until_ms: int | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.loss <= 1:
            raise ValueError(f"loss must lie in 0 to 1, not {self.loss:g}")
        if self.until_ms is not None and self.until_ms <= self.since_ms:
            raise ValueError("until_s must be after since_s")

    def holds(self, sender: int, receiver: int, at_ms: int) -> bool:
        return (
            self.sender in (None, sender)
            and self.receiver in (None, receiver)
            and self.since_ms <= at_ms
            and (self.until_ms is None or at_ms < self.until_ms)
        )


class Topology:
    """A set of rules. A packet gets through if it survives every rule that holds.

    A rule for the node 0 holds for every aPad: those of further aPads are negative.
    """

    def __init__(self, rules: Sequence[LinkRule] = ()) -> None:
        self.rules = tuple(rules)

    def loss(self, sender: int, receiver: int, at_ms: int) -> float:
        """The probability that a packet that begins at `at_ms` is lost on this link; 1 if there is no link."""
        if not self.rules:
            return 0.0
        passes = 1.0
        sender, receiver = max(0, sender), max(0, receiver)
        for rule in self.rules:
            if rule.holds(sender, receiver, at_ms):
                passes *= 1 - rule.loss
        return 1 - passes


def parse_topology(text: str, nodes: dict[str, int], agent_ms_per_s: int) -> Topology:
    """Reads rules from a CSV with a header of `COLUMNS`, of which `since_s` and `until_s` may be left out.

    `from` and `to` are an aMussel's id, a name in `nodes` or `*`; seconds are mission time, of `agent_ms_per_s` each.
    Raises ValueError, `line N: ...`.
    """
    rules: list[LinkRule] = []
    if not read_rows(text, _check_header, lambda texts: rules.append(_rule(texts, nodes, agent_ms_per_s))):
        raise ValueError(f"no header: needs {','.join(COLUMNS)}")
    return Topology(rules)


def _check_header(cells: list[str]) -> None:
    if len(set(cells)) != len(cells) or not {"from", "to", "loss"} <= set(cells) <= set(COLUMNS):
        raise ValueError(f"the columns must be {', '.join(COLUMNS)} (the last two may be left out)")


def _rule(texts: dict[str, str], nodes: dict[str, int], agent_ms_per_s: int) -> LinkRule:
    until = texts.get("until_s", "")
    return LinkRule(
        _node(texts["from"], nodes),
        _node(texts["to"], nodes),
        _number("loss", texts["loss"]),
        round(_number("since_s", texts.get("since_s") or "0") * agent_ms_per_s),
        round(_number("until_s", until) * agent_ms_per_s) if until else None,
    )


def _node(text: str, nodes: dict[str, int]) -> int | None:
    if text == ANY:
        return None
    if text in nodes:
        return nodes[text]
    if not (text.isascii() and text.isdecimal()) or int(text) < 1:
        raise ValueError(f"{text!r} is no aMussel's id, {', '.join(sorted(nodes))} or {ANY}")
    return int(text)


def _number(name: str, text: str) -> float:
    try:
        number = number_of(text)
    except ValueError:
        raise ValueError(f"{name}: must be a number, not {text!r}") from None
    if not 0 <= number < 1e9:
        raise ValueError(f"{name}: must be a number from 0 on, not {text}")
    return number
