"""Publishes /battery_alert when an aMussel's reported charge falls to that at which the mission wants it collected.

The legacy stack's aMussels publish their own alerts, all on one topic, with their name in `header.frame_id`: `/amussel24/`.
Here the supervisor publishes them, from received packets: nobody learns of a silent aMussel, as of a real one out of reach.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import rospy

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.modes import LIKELY
from apad_bridge.ros.gateway.agent_topics import AgentReport, nav_sts
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import BATTERY_ALERT, amussel_in_full
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.context import Watcher
from apad_bridge.supervisor.supervisor import Supervisor

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402

_QUEUE = 1000
"""A whole fleet may fall at one tick, and alerts are not repeated."""
AGAIN_ABOVE = 0.05
"""An aMussel must report so much above the threshold before it can fall again. Charging brings far more than that; the
noise of a measured charge, 0.015 in `benchmarks/beliefs.py`, is less than a third of it and hardly ever does."""


class Falls:
    """Finds aMussels whose reported charge fell to `threshold`, in [0, 1], and keeps which ones are low since."""

    def __init__(self, threshold: float, known: Iterable[Belief] = ()) -> None:
        """Low beliefs among those `known` to a supervisor that died fell in its time, and cause no alert."""
        self._threshold = threshold
        # Near 1 there is less room than that above the threshold.
        self._again_above = min(threshold + AGAIN_ABOVE, (threshold + 1) / 2)
        self._judged_ms: dict[int, int] = {}
        """By aMussel, the stamp of the packet that was judged last."""
        self._low: set[int] = set()
        self.hear(known)

    def hear(self, beliefs: Iterable[Belief]) -> list[Belief]:
        """The beliefs that fell since the last call. `beliefs` are all that there are.

        Only a new packet counts: an estimate carried on without one causes no alert. A charge that sways about the
        threshold fell once. An aMussel whose belief was deleted begins anew.
        """
        fallen = []
        judged_ms, self._judged_ms = self._judged_ms, {}
        for belief in beliefs:
            agent_id = belief.agent_id
            self._judged_ms[agent_id] = belief.heard_ms
            if judged_ms.get(agent_id) == belief.heard_ms:
                continue
            if agent_id in self._low:
                if belief.probability_at_most(self._again_above) < LIKELY:
                    self._low.discard(agent_id)
            elif belief.probability_at_most(self._threshold) >= LIKELY:
                self._low.add(agent_id)
                fallen.append(belief)
        self._low &= self._judged_ms.keys()
        return fallen


class BatteryAlerts:
    """Owned by the flight's thread; the node is initialised before (`open_gateway`)."""

    def __init__(
        self,
        scenario: Scenario,
        agent_ids: Iterable[int],
        namespace: str,
        simulated: Callable[[], frozenset[int]],
    ) -> None:
        """Alerts only for `simulated` ones of `agent_ids`: a real aMussel publishes its own alerts."""
        self._ids = frozenset(agent_ids)
        self._frame = LocalFrame.about(scenario.area.origin)
        self._threshold = scenario.mission.pool_threshold
        self._namespace = namespace
        self._simulated = simulated
        self._publisher = rospy.Publisher(BATTERY_ALERT, NavSts, queue_size=_QUEUE)

    def watcher(self, supervisor: Supervisor) -> Watcher:
        """Alerts at each tick. The beliefs that `supervisor` has already cause no alert."""
        falls = Falls(self._threshold, supervisor.beliefs.all())

        def watch(now_ms: int) -> None:
            for belief in falls.hear(supervisor.beliefs.all()):
                if belief.agent_id in self._ids & self._simulated():
                    self._publisher.publish(alert(belief, self._frame, self._namespace))

        return watch


def alert(belief: Belief, frame: LocalFrame, namespace: str = "") -> NavSts:
    """The believed place of the aMussel and its reported depth, stamped with the time of its newest packet."""
    message = nav_sts(AgentReport.of_belief(belief), belief.heard_ms, frame)
    message.header.frame_id = f"{amussel_in_full(namespace, belief.agent_id)}/"
    return message
