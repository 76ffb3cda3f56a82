"""Simulated devices. They know the actuators' abstract types and nothing of the controller."""
