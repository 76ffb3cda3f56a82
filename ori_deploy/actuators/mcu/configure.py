"""Write a configuration into the device, and read the one in force.

Not for a device that anybody works with: every hinge and every driven latch has to be off.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

from ori_deploy.actuators.bus import CommandRefused
from ori_deploy.actuators.mcu.faults import Naming, refusal
from ori_deploy.actuators.mcu.line import McuLine
from ori_deploy.actuators.mcu.records import Record, config_hash
from ori_deploy.wire.mcu import Ack, ConfigCommit, ConfigDevice, ConfigHinge, ConfigLatch, ConfigRead, dialect

STORE_S = 1.0
"""Time to write a record into the EEPROM: 3.4 ms a byte."""


def write_config(line: McuLine, config: Sequence[Record]) -> int:
    """Make records the configuration of the device, and return their hash.

    Parameters
    ----------
    config
        From `ori_deploy.actuators.mcu.records.records`.

    Raises
    ------
    CommandRefused
        Something is on, or the device does not take a record; the configuration in force stays as it was.
    BusTimeout, CorruptReply, BusClosed
        As of every command.
    """
    for record in config:
        what = f"{_name(record)} is not stored"
        _require(line.command(lambda token, record=record: _with(record, token), what, STORE_S), what)  # type: ignore[misc]
    told = config_hash(config)
    what = f"the configuration with hash {told:08x} does not take effect"
    _require(line.command(lambda token: ConfigCommit(told, token), what, STORE_S), what)
    return told


def read_device(line: McuLine) -> ConfigDevice | None:
    """The device's own record in force; None when it has no configuration."""
    device = _read(line, dialect.ORI_RECORD_DEVICE, 0)
    return device if isinstance(device, ConfigDevice) else None


def read_config(line: McuLine) -> tuple[Record, ...]:
    """The records in force, tokens 0; none when the device has no configuration."""
    device = read_device(line)
    if device is None:
        return ()
    found: list[Record] = [device]
    for kind, count in ((dialect.ORI_RECORD_HINGE, device.hinges), (dialect.ORI_RECORD_LATCH, device.latches)):
        for index in range(count):
            record = _read(line, kind, index)
            if record is None:
                raise CommandRefused(
                    f"the microcontroller has no record {index} of kind {kind}, though it counts {count}; "
                    "remedy: write its configuration with ori-deploy mcu config"
                )
            found.append(record)
    return tuple(_with(record, 0) for record in found)


def _read(line: McuLine, kind: int, index: int) -> Record | None:
    answer = line.ask(
        lambda token: ConfigRead(token, kind, index),
        (ConfigDevice, ConfigHinge, ConfigLatch, Ack),
        "reading the configuration",
    )
    return answer if isinstance(answer, ConfigDevice | ConfigHinge | ConfigLatch) else None


def _with(record: Record, token: int) -> Record:
    made = copy(record)
    made.token = token
    return made


def _name(record: Record) -> str:
    if isinstance(record, ConfigDevice):
        return "the device's record"
    return f"the record of {'hinge' if isinstance(record, ConfigHinge) else 'latch'} {record.index}"


def _require(ack: Ack, what: str) -> None:
    if ack.result != dialect.ORI_ACCEPTED:
        raise refusal(ack, what, f"number {ack.index}", Naming())
