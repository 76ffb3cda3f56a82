"""From what the device reports of its latches to readings."""

from __future__ import annotations

from collections.abc import Sequence

from ori_deploy.actuators.bus import LatchReading
from ori_deploy.wire.mcu import LatchState


def latch_readings(report: LatchState, names: Sequence[str], time_s: float) -> tuple[LatchReading, ...]:
    """All latches, in order. One whose sensor is missing, or has not been steady, cannot tell.

    Parameters
    ----------
    names
        In the order of the configuration.
    time_s
        When the device looked, by the host's clock.
    """
    return tuple(
        LatchReading(
            name,
            engaged=bool(report.commanded >> k & 1),
            confirmed=bool(report.closed >> k & 1) if report.sensed >> k & 1 else None,
            valid=True,
            time_s=time_s,
            fault=tripped_words(report, k) if report.tripped >> k & 1 else None,
        )
        for k, name in enumerate(names)
    )


def tripped_words(report: LatchState, index: int) -> str:
    """Why an electromagnet let go of itself, and how far it has recovered."""
    left = report.duty_left_permille[index]
    return (
        f"was energised for as long as it bears and let go; it has cooled by {0.1 * left:.0f} %, and works again at "
        "100 %; remedy: let it cool"
    )
