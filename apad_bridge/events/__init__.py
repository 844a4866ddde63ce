"""The events of a flight: one frozen class for each kind, made by whoever sees the event. `union.py` has all of them."""
