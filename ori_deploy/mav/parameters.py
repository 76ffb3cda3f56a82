"""Parameters that a ground station can read and set: bounds, the file in which they last, and the protocol.

All travel as REAL32, whole numbers too: autopilots disagree on how integers are packed into MAVLink's parameters,
and every station shows floats alike.
"""

from __future__ import annotations

import json
import logging
import math
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ori_deploy.errors import FileError, InputError
from ori_deploy.mav.links import Heard, Peer
from ori_deploy.mav.settings import DEPLOY_RULES, LEAST_LINK_TIMEOUT_S, Settings
from ori_deploy.wire.vehicle import dialect, text_of

SCHEMA = "ori-deploy/mavlink-parameters/1"
NO_INDEX = -1
ALL_INDICES = 65535
"""Index of a PARAM_VALUE that answers a request by name, or a change."""

BEYOND_ALL = 1e300

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter.

    Attributes
    ----------
    name
        At most 16 characters.
    default, lowest, highest
        Its value unless it is set, and its bounds.
    whole
        Whether it is a whole number.
    meaning
        For people.
    """

    name: str
    default: float
    lowest: float
    highest: float
    whole: bool
    meaning: str

    def problem(self, value: float) -> str | None:
        """Why it cannot have a value; None where it can."""
        if not math.isfinite(value) or not self.lowest <= value <= self.highest:
            return f"{value:g} is not from {self.lowest:g} to {self.highest:g}"
        return f"{value:g} is not a whole number" if self.whole and value != round(value) else None


SPEED, LINK_LOSS, LINK_TIMEOUT, DEPLOY_WHEN, TELEMETRY_HZ, NAMED_VALUES = (
    "ORI_SPEED",
    "ORI_LINK_LOSS",
    "ORI_LINK_TMO",
    "ORI_DEPLOY_WHEN",
    "ORI_TLM_HZ",
    "ORI_NAMED_VAL",
)


def parameters_of(settings: Settings) -> tuple[Parameter, ...]:
    """All of them, in the order of their indices; what the settings say is the default."""
    rules = ", ".join(f"{index} {rule}" for index, rule in enumerate(DEPLOY_RULES))
    return (
        Parameter(SPEED, 1.0, 0.05, 1.0, False, "part of the plan's speed to go no faster than"),
        Parameter(
            LINK_LOSS, float(settings.link_loss == "hold"), 0, 1, True, "ground station lost: 0 finish, 1 hold"
        ),
        Parameter(
            LINK_TIMEOUT,
            settings.link_timeout_s,
            LEAST_LINK_TIMEOUT_S,
            60.0,
            False,
            "silence of a lost station, s",
        ),
        Parameter(
            DEPLOY_WHEN, float(DEPLOY_RULES.index(settings.deploy_when)), 0, len(DEPLOY_RULES) - 1, True, rules
        ),
        Parameter(TELEMETRY_HZ, settings.telemetry_hz, 0.2, 20.0, False, "of crease and latch telemetry"),
        Parameter(NAMED_VALUES, 1.0, 0, 1, True, "1: send NAMED_VALUE_FLOAT, too"),
    )


class Parameters:
    """Values, kept in a file when there is one.

    Raises
    ------
    FileError
        The file is there and cannot be read, or says what no parameter may be.
    """

    def __init__(self, known: tuple[Parameter, ...], path: Path | None) -> None:
        self.known = known
        self._path = path
        self._values = {one.name: one.default for one in known}
        if path is not None and path.exists():
            self._values |= _load(path, {one.name: one for one in known})

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def set(self, name: str, value: float) -> None:
        """Change a value, and keep it. Raises `InputError` outside its bounds or where there is no such parameter."""
        one = next((one for one in self.known if one.name == name), None)
        if one is None:
            raise InputError(f"{name}: no such parameter", limit=", ".join(p.name for p in self.known))
        problem = one.problem(value)
        if problem is not None:
            raise InputError(f"{name}: {problem}", remedy=one.meaning)
        self._values[name] = value
        if self._path is not None:
            _save(self._path, self._values)


def _load(path: Path, known: Mapping[str, Parameter]) -> dict[str, float]:
    remedy = "mend it, or remove it: then the settings' values hold"
    try:
        document = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as wrong:
        raise FileError(f"{path}: parameters cannot be read", value=wrong, remedy=remedy) from wrong
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise FileError(f"{path}: not a file of parameters", limit=f'schema = "{SCHEMA}"', remedy=remedy)
    values = document.get("values")
    if not isinstance(values, dict):
        raise FileError(f"{path}: values: missing", remedy=remedy)
    for name, value in values.items():
        if name not in known or isinstance(value, bool) or not isinstance(value, int | float):
            raise FileError(f"{path}: {name}: no such parameter, or no number", value=value, remedy=remedy)
        # An integer of a file may fit no float.
        problem = known[name].problem(float(value) if abs(value) < BEYOND_ALL else math.inf)
        if problem is not None:
            raise FileError(f"{path}: {name}: {problem}", remedy=remedy)
    return {name: float(value) for name, value in values.items()}


def _save(path: Path, values: Mapping[str, float]) -> None:
    """All or nothing: a half-written file would keep the component from starting."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.name)
    try:
        with os.fdopen(handle, "w") as file:
            json.dump({"schema": SCHEMA, "values": dict(values)}, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


class ParameterService:
    """MAVLink's parameter protocol.

    Parameters
    ----------
    parameters
        The values.
    commanders
        System ids that may set them; anybody may read.
    send
        Sends a message to a peer, or to everybody.
    tell
        Tells everybody in words, with a MAV_SEVERITY.
    changed
        Called after a change.
    """

    def __init__(
        self,
        parameters: Parameters,
        commanders: frozenset[int],
        send: Callable[[dialect.MAVLink_message, Peer | None], None],
        tell: Callable[[int, str], None],
        changed: Callable[[], None],
    ) -> None:
        self._parameters, self._commanders = parameters, commanders
        self._send, self._tell, self._changed = send, tell, changed
        self._listing: dict[Peer, int] = {}

    def heard(self, heard: Heard) -> None:
        """A PARAM_REQUEST_LIST, PARAM_REQUEST_READ or PARAM_SET addressed to us."""
        message, peer = heard.message, heard.peer
        known = self._parameters.known
        if isinstance(message, dialect.MAVLink_param_request_list_message):
            self._listing[peer] = 0
        elif isinstance(message, dialect.MAVLink_param_request_read_message):
            index = message.param_index
            if index == NO_INDEX:
                self._read(text_of(message.param_id), heard)
            elif 0 <= index < len(known):
                self._tell_value(index, peer, index)
            else:
                self._error(text_of(message.param_id), index, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST, heard)
        elif isinstance(message, dialect.MAVLink_param_set_message):
            self._set(text_of(message.param_id), float(message.param_value), heard)

    def tick(self) -> None:
        """Go on with lists that were asked for: a few values each time, so that no link is flooded."""
        for peer, index in tuple(self._listing.items()):
            self._tell_value(index, peer, index)
            if index + 1 < len(self._parameters.known):
                self._listing[peer] = index + 1
            else:
                del self._listing[peer]

    def _read(self, name: str, heard: Heard) -> None:
        index = self._index(name)
        if index is None:
            self._error(name, NO_INDEX, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST, heard)
        else:
            self._tell_value(index, heard.peer, index)

    def _index(self, name: str) -> int | None:
        return next((at for at, one in enumerate(self._parameters.known) if one.name == name), None)

    def _set(self, name: str, value: float, heard: Heard) -> None:
        """Set it; whatever comes of it, the value that holds is told, as the protocol wants."""
        index = self._index(name)
        if index is None:
            self._error(name, NO_INDEX, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST, heard)
            return
        if heard.system not in self._commanders:
            self._tell(dialect.MAV_SEVERITY_WARNING, f"system {heard.system} may not set {name}")
            self._error(name, index, dialect.MAV_PARAM_ERROR_PERMISSION_DENIED, heard)
            self._tell_value(index, heard.peer, ALL_INDICES)
            return
        try:
            self._parameters.set(name, value)
        except InputError as wrong:
            self._tell(dialect.MAV_SEVERITY_WARNING, wrong.thing)
            self._error(name, index, dialect.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, heard)
            self._tell_value(index, heard.peer, ALL_INDICES)
            return
        except OSError as wrong:  # it holds, until the component starts again
            log.warning("parameters cannot be kept: %s", wrong)
            self._tell(dialect.MAV_SEVERITY_WARNING, f"{name} holds until a restart: {wrong.strerror}")
        self._changed()
        self._tell_value(index, None, ALL_INDICES)

    def _tell_value(self, index: int, peer: Peer | None, as_index: int) -> None:
        one = self._parameters.known[index]
        self._send(
            dialect.MAVLink_param_value_message(
                param_id=one.name.encode(),
                param_value=self._parameters[one.name],
                param_type=dialect.MAV_PARAM_TYPE_REAL32,
                param_count=len(self._parameters.known),
                param_index=as_index,
            ),
            peer,
        )

    def _error(self, name: str, index: int, error: int, heard: Heard) -> None:
        if error == dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST and getattr(heard.message, "target_component", 0) == 0:
            return  # asked of all components: it is another's
        self._send(
            dialect.MAVLink_param_error_message(
                target_system=heard.system,
                target_component=heard.component,
                param_id=name.encode()[:16],
                param_index=index,
                error=error,
            ),
            heard.peer,
        )
