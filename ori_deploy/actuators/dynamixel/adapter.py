"""The USB adapter's latency timer: how long it sits on an answer before the host gets it."""

from __future__ import annotations

from pathlib import Path

GOOD_LATENCY_S = 0.001
SYSFS = Path("/sys/bus/usb-serial/devices")


def latency_timer_s(port: str, sysfs: Path = SYSFS) -> float | None:
    """Latency timer of the adapter behind a port; None where it has none, or the system does not tell."""
    timer = sysfs / Path(port).resolve().name / "latency_timer"
    try:
        return 1e-3 * int(timer.read_text())
    except (OSError, ValueError):
        return None


def latency_advice(port: str, sysfs: Path = SYSFS) -> str | None:
    """What to do about a latency timer that is too long, or None."""
    latency = latency_timer_s(port, sysfs)
    if latency is None or latency <= GOOD_LATENCY_S:
        return None
    name = Path(port).resolve().name
    return (
        f"{port}: the adapter keeps answers for {1e3 * latency:.0f} ms; limit: 1 ms; remedy: "
        f"echo 1 | sudo tee {sysfs / name / 'latency_timer'}, or a udev rule (docs/hardware-dynamixel.md)"
    )
