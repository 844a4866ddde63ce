"""The place of an aPad's local (0, 0), from a master that has only parameters."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.origin_check import ReportedPlace, check_origin
from apad_bridge.scenario.schema import Origin

BIOGRAD = Origin(latitude_deg=43.9330937, longitude_deg=15.4443468)


class Parameters(dict[str, object]):
    uri = ""


@pytest.fixture
def parameters() -> Iterator[Parameters]:
    known = Parameters()
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.register_function(lambda _, name: [1, "", name in known], "hasParam")
        server.register_function(lambda _, name: [1, "", known[name]], "getParam")
        known.uri = f"http://127.0.0.1:{server.server_address[1]}/"
        serving = threading.Thread(target=server.serve_forever, args=(0.01,))
        serving.start()
        yield known
        server.shutdown()
        serving.join()


@pytest.mark.parametrize("namespace", ["/bay/apad1", "/bay", ""])
def test_the_same_origin_is_found_in_its_namespace_or_above(parameters: Parameters, namespace: str) -> None:
    parameters |= {f"{namespace}/LocalOriginLat": 43.933094, f"{namespace}/LocalOriginLon": 15.444347}
    found = check_origin(parameters.uri, "/bay/apad1", BIOGRAD)
    assert found.status is CheckStatus.OK and "43.9330940, 15.4443470, as the scenario does" in found.found


def test_another_origin_is_said_with_its_distance_and_its_mend(parameters: Parameters) -> None:
    """A hundredth of a degree of latitude is 1111 m there (111.11 km a degree at 44 degrees north, WGS-84)."""
    parameters |= {
        "/apad1/LocalOriginLat": 43.9430937,
        "/apad1/LocalOriginLon": 15.4443468,
        "/LocalOriginLat": 0,
    }
    found = check_origin(parameters.uri, "/apad1", BIOGRAD)
    assert found.status is CheckStatus.FAIL and "1111 m from the scenario's" in found.found
    assert "latitude_deg: 43.9430937, longitude_deg: 15.4443468" in str(found)


@pytest.mark.parametrize("wrong", ["north", [43.9], 91.0])
def test_what_is_no_place_is_said(parameters: Parameters, wrong: object) -> None:
    parameters |= {"/apad1/LocalOriginLat": wrong, "/apad1/LocalOriginLon": 15.4}
    assert check_origin(parameters.uri, "/apad1", BIOGRAD).status is CheckStatus.FAIL


def test_without_parameters_nothing_is_claimed(parameters: Parameters) -> None:
    found = check_origin(parameters.uri, "/apad1", BIOGRAD)
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
    found = check_origin(parameters.uri, "/apad1", BIOGRAD, [told])
    assert found.status is status and words in found.found


def test_positions_are_compared_even_where_the_parameters_agree(parameters: Parameters) -> None:
    parameters |= {"/LocalOriginLat": BIOGRAD.latitude_deg, "/LocalOriginLon": BIOGRAD.longitude_deg}
    elsewhere = ReportedPlace("its positions' origin", 43.9420937, 15.4443468)
    assert check_origin(parameters.uri, "/apad1", BIOGRAD).status is CheckStatus.OK
    assert check_origin(parameters.uri, "/apad1", BIOGRAD, [elsewhere]).status is CheckStatus.FAIL
