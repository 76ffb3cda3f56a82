"""Dynamixel X-series servos on a half-duplex bus, Protocol 2.0, behind a U2D2 or a pty."""
