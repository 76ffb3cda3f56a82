"""Slow, independent reference implementation of the planar geometry, for comparison in tests."""
