"""Hobby servos, electromagnets and latch sensors behind a microcontroller on a serial port."""
