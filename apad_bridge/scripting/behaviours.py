"""The base class of behaviours, which act at every mission tick until they are done; `api.run(...)` runs them."""

from apad_bridge.scripting.api import Behaviour

__all__ = ["Behaviour"]
