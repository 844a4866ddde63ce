"""The place of an aPad's local (0, 0), from a master that has only parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from apad_bridge.doctor.finding import CheckStatus, Finding
from apad_bridge.doctor.origin_check import ReportedPlace, check_origin
from apad_bridge.scenario.schema import Origin
from tests.apad_bridge.doctor.test_graph_checks import answering

BIOGRAD = Origin(latitude_deg=43.9330937, longitude_deg=15.4443468)


Parameters = dict[str, object]


@pytest.fixture
def parameters() -> Parameters:
    return {}


def found_of(parameters: Parameters, apad: str, told: Sequence[ReportedPlace] = ()) -> Finding:
    has, get = (lambda _, name: [1, "", name in parameters]), (lambda _, name: [1, "", parameters[name]])
    with answering(hasParam=has, getParam=get) as uri:
        return check_origin(uri, apad, BIOGRAD, list(told))


@pytest.mark.parametrize("namespace", ["/bay/apad1", "/bay", ""])
def test_the_same_origin_is_found_in_its_namespace_or_above(parameters: Parameters, namespace: str) -> None:
    parameters |= {f"{namespace}/LocalOriginLat": 43.933094, f"{namespace}/LocalOriginLon": 15.444347}
    found = found_of(parameters, "/bay/apad1")
    assert found.status is CheckStatus.OK and "43.9330940, 15.4443470, as the scenario does" in found.found


def test_another_origin_is_said_with_its_distance_and_its_mend(parameters: Parameters) -> None:
    """A hundredth of a degree of latitude is 1111 m there (111.11 km a degree at 44 degrees north, WGS-84)."""
    parameters |= {
        "/apad1/LocalOriginLat": 43.9430937,
        "/apad1/LocalOriginLon": 15.4443468,
        "/LocalOriginLat": 0,
    }
    found = found_of(parameters, "/apad1")
    assert found.status is CheckStatus.FAIL and "1111 m from the scenario's" in found.found
    assert "latitude_deg: 43.9430937, longitude_deg: 15.4443468" in str(found)


@pytest.mark.parametrize("wrong", ["north", [43.9], 91.0])
def test_what_is_no_place_is_said(parameters: Parameters, wrong: object) -> None:
    parameters |= {"/apad1/LocalOriginLat": wrong, "/apad1/LocalOriginLon": 15.4}
    assert found_of(parameters, "/apad1").status is CheckStatus.FAIL


def test_without_parameters_nothing_is_claimed(parameters: Parameters) -> None:
    found = found_of(parameters, "/apad1")
    assert found.status is CheckStatus.CANNOT_TELL and "/apad1/LocalOriginLat is not set" in found.found


NORTH_DEG = 100 / 111_111
"""A hundred metres north are some 0.0009 degrees of latitude anywhere (111.1 km a degree at 44 degrees north)."""


@pytest.mark.parametrize(
    ("told", "status", "words"),
    [
        (ReportedPlace("its origin", 43.9330937, 15.4443468), CheckStatus.OK, "as the scenario does"),
        (ReportedPlace("its origin", 43.9420937, 15.4443468), CheckStatus.FAIL, "1000 m from the scenario's"),
        (ReportedPlace("its origin", -43.9330937, -15.4443468), CheckStatus.FAIL, "m from the scenario's"),
        (
            ReportedPlace("its origin", 15.4443468, 43.9330937),
            CheckStatus.FAIL,
            "look swapped in area.origin",
        ),
        (
            ReportedPlace("it", 43.9330937 + NORTH_DEG, 15.4443468, 100.0),
            CheckStatus.OK,
            "as the scenario does",
        ),
        (
            ReportedPlace("it", 43.9330937 + NORTH_DEG, 15.4443468, -100.0),
            CheckStatus.FAIL,
            "north has the wrong sign",
        ),
        (ReportedPlace("it", math.nan, 15.4443468), CheckStatus.FAIL, "no latitude and longitude"),
    ],
)
def test_places_that_the_positions_name_are_compared(
    parameters: Parameters, told: ReportedPlace, status: CheckStatus, words: str
) -> None:
    found = found_of(parameters, "/apad1", [told])
    assert found.status is status and words in found.found


def test_positions_are_compared_even_where_the_parameters_agree(parameters: Parameters) -> None:
    parameters |= {"/LocalOriginLat": BIOGRAD.latitude_deg, "/LocalOriginLon": BIOGRAD.longitude_deg}
    elsewhere = ReportedPlace("its positions' origin", 43.9420937, 15.4443468)
    assert found_of(parameters, "/apad1").status is CheckStatus.OK
    assert found_of(parameters, "/apad1", [elsewhere]).status is CheckStatus.FAIL
