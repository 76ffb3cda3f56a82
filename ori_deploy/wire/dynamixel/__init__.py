"""DYNAMIXEL X-series, Protocol 2.0: registers as typed objects, models, and how long packets are."""

from __future__ import annotations

from ori_deploy.wire.dynamixel.models import MODELS, MODELS_BY_NUMBER, ServoModel, model_named
from ori_deploy.wire.dynamixel.registers import BAUD_CODES, ControlTable, OperatingMode, Register

__all__ = [
    "BAUD_CODES",
    "MODELS",
    "MODELS_BY_NUMBER",
    "ControlTable",
    "OperatingMode",
    "Register",
    "ServoModel",
    "model_named",
]
