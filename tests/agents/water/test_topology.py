"""Rules for links, and files that are refused."""

import pytest

from agents.water.topology import LinkRule, Topology, parse_topology

TEXT = """
from, to, loss, since_s, until_s   # a link that fades, a blackout, and one that is worse one way
3, apad, 0.5, ,
apad, 3, 0.1, ,
*, apad, 1, 60, 120
"""


def parsed(text: str = TEXT) -> Topology:
    return parse_topology(text, {"apad": 0}, 1000)


def test_a_link_may_be_worse_one_way() -> None:
    assert parsed().loss(3, 0, 0) == 0.5
    assert parsed().loss(0, 3, 0) == pytest.approx(0.1)
    assert parsed().loss(4, 0, 0) == 0.0


def test_a_blackout_begins_and_ends() -> None:
    assert [parsed().loss(4, 0, at_ms) for at_ms in (59_999, 60_000, 119_999, 120_000)] == [0, 1, 1, 0]


def test_rules_that_hold_together_are_survived_one_by_one() -> None:
    both = Topology([LinkRule(None, 2, 0.5), LinkRule(1, None, 0.2)])
    assert both.loss(1, 2, 0) == pytest.approx(1 - 0.5 * 0.8)


def test_seconds_are_mission_time() -> None:
    rule = parse_topology("from,to,loss,since_s\n*,*,1,2", {}, 30_000).rules[0]
    assert rule == LinkRule(None, None, 1.0, 60_000, None)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "no header"),
        ("from,to\n1,2", "line 1: the columns must be"),
        ("from,to,loss\n1,2", "line 2: 2 values for 3 columns"),
        ("from,to,loss\nboat,2,1", "line 2: 'boat' is no aMussel's id, apad or \\*"),
        ("from,to,loss\n1,2,1.5", "line 2: loss must lie in 0 to 1"),
        ("from,to,loss\n1,2,much", "line 2: loss: must be a number, not 'much'"),
        ("from,to,loss,since_s\n1,2,1,24_0", "line 2: since_s: must be a number, not '24_0'"),
        ("from,to,loss,since_s,until_s\n1,2,1,5,5", "line 2: until_s must be after since_s"),
        ("from,to,loss,since_s\n1,2,1,-5", "line 2: since_s: must be a number from 0 on"),
    ],
)
def test_what_is_no_rule_is_refused_with_its_line(text: str, error: str) -> None:
    with pytest.raises(ValueError, match=error):
        parsed(text)
