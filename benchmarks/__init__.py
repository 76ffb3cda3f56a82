"""Timings: `make bench`. Seeded, each with its target, each beside what the machine can do."""
