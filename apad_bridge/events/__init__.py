"""The events of a flight: one frozen class for each kind, made by whoever sees the event; `all_events.py` lists them."""
