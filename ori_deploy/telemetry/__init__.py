"""Flight recorder: a log of every cycle, read back into arrays, and what it amounts to."""
