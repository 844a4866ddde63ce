"""Whole behaviours, to derive from: classes that act at every mission tick until they are done, run by `api.run(...)`."""

from apad_bridge.scripting.api import Behaviour

__all__ = ["Behaviour"]
