"""Nearest job next with pre-emption (NJNP), the usual baseline of on-demand mobile charging.

Source: L. He, Y. Gu, J. Pan, T. Zhu, "On-Demand Charging in Wireless Sensor Networks: Theories and Applications", MASS
2013. A node asks when its charge falls below a threshold (here: it enters the pool), and the charger serves the nearest
request. It decides anew when a service ends or a request comes.

An aPad decides anew after each docking, over the whole pool as it is then, requests that came on the way included. It does
not turn round on its way: the aMussel that it goes to was called up, and has paid for its surfacing.
"""

from __future__ import annotations

from apad_bridge.planning.greedy import Greedy


class NearestJobNext(Greedy):
    """Plans as Greedy does, and lets the mission plan the rest of a batch again after each docking."""

    pre_empts = True
