"""Calls an aPad's services without waiting for them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import rospy

PATIENCE_S = 5.0
"""A call waits so long for the one before it. Behind a call that hangs, the next goes ahead."""


class ServiceCalls:
    """Calls services in the order in which they are sent, without waiting for the answers.

    rospy's calls have no time-out, and a call that hangs must not stop a flight. A thread of the call runs `answered` with
    the response, and with the reason if the call was refused.
    """

    def __init__(self) -> None:
        self._last: threading.Thread | None = None

    def send(
        self, service: str, kind: Any, request: Any, answered: Callable[[Any, str | None], None]
    ) -> None:
        before = self._last

        def call() -> None:
            if before is not None:
                before.join(PATIENCE_S)
            response: Any = None
            refused: str | None = None
            try:
                response = rospy.ServiceProxy(service, kind)(request)
            except (rospy.ServiceException, rospy.ROSException, OSError) as error:
                refused = f"{service}: {error}"
            answered(response, refused)

        self._last = threading.Thread(target=call, name=f"call of {service}", daemon=True)
        self._last.start()
