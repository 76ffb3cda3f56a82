"""Simulated Dynamixel X-series servos on a bus. Written from the protocol's definition, without the SDK."""
