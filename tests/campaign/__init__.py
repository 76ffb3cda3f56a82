"""Injected faults, everywhere, against every promise: `python -m tests.campaign`, and a short form in the tests."""
