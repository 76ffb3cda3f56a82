"""A simulated microcontroller: the firmware, unchanged, on an emulated chip or on Linux, with servos and latches."""
