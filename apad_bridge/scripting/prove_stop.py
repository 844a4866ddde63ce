"""A script that proves a stop: a short go-to inside the fence, an order to hold under way, and the aPad comes to rest.

`musselbed preflight --prove-stop` flies it by every part that a mission flies by. It has to be run as a script.
"""
# ruff: noqa: F821
# mypy: ignore-errors

import math

WAY_M, MOVED_M, REST_M_S = 6.0, 1.0, 0.15
"""The go-to's length; it is stopped after so much of it; slower than this is at rest."""
STARTS_WITHIN_S, RESTS_WITHIN_S, RESTS_FOR_S = 30, 20, 5


def place():
    here = api.get_location(id_self)
    return here.north_m, here.east_m


start = place()
for step in ((WAY_M, 0), (0, WAY_M), (-WAY_M, 0), (0, -WAY_M)):
    api.go_to_local(start[0] + step[0], start[1] + step[1])
    if api.wait_until(lambda: math.dist(place(), start) > MOVED_M or api.goto_status() != 1, STARTS_WITHIN_S):
        if math.dist(place(), start) > MOVED_M:
            break
    else:
        raise RuntimeError(f"it did not move {MOVED_M:g} m within {STARTS_WITHIN_S} s")
else:
    raise RuntimeError(f"no go-to of {WAY_M:g} m was taken: {api.failure}")
stopped_at, stopped_s, at_rest_s, before = place(), api.now(), 0, place()
api.hold()
while at_rest_s < RESTS_FOR_S:
    time.sleep(1)
    here = place()
    at_rest_s = at_rest_s + 1 if math.dist(here, before) <= REST_M_S else 0
    before = here
    if api.now() - stopped_s > RESTS_WITHIN_S + RESTS_FOR_S:
        raise RuntimeError(f"it was not at rest {RESTS_WITHIN_S} s after the stop")
rest_s, way_m = api.now() - stopped_s - RESTS_FOR_S, math.dist(stopped_at, before)
api.note("stop_proven", rest_s=rest_s, way_m=round(way_m, 2))
print(f"it came to rest within {rest_s:.0f} s and {way_m:.1f} m of the stop")
