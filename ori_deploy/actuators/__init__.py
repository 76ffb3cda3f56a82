"""One abstract actuator bus, and the rig file that says what is wired to it."""
