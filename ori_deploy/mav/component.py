"""The deployment component: what it makes of every message, and what it says by itself.

No sockets and no clock here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib.metadata import version

from ori_deploy.mav import telemetry
from ori_deploy.mav.commands import ALIAS, COMMANDS, CommandMessage, Commands, acknowledgement
from ori_deploy.mav.links import Heard, Peer
from ori_deploy.mav.neighbours import Autopilot, Stations
from ori_deploy.mav.parameters import (
    DEPLOY_WHEN,
    LINK_LOSS,
    LINK_TIMEOUT,
    NAMED_VALUES,
    SPEED,
    TELEMETRY_HZ,
    Parameters,
    ParameterService,
)
from ori_deploy.mav.settings import Settings
from ori_deploy.mav.texts import Texts
from ori_deploy.mav.words import Answered, Attending, Ended, Hold, Snapshot, Tune, Word
from ori_deploy.wire.vehicle import dialect

BEAT_LATE_S = 1.0
"""A heartbeat that comes later than that is not sent: it would say that the loop lives."""
ARMING_VALID_S = 10
"""How long leave to arm holds."""
PARAMETERS_PER_S = 50.0
TUNE_EVERY_S = 0.05
"""The loop takes a few words per cycle: a flood of parameters is not to keep a STOP waiting."""

Send = Callable[[dialect.MAVLink_message, Peer | None], None]

CAPABILITIES = (
    dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
)


class Component:
    """One deployment component of a vehicle.

    Parameters
    ----------
    settings
        Who it is, and who may command.
    parameters
        What stations can change.
    send
        Sends a message to a peer, or to everybody (None).
    ask
        Passes a word to the control loop.
    now
        When it started, on the monotonic clock.

    Attributes
    ----------
    ignored
        Messages that were addressed to us and mean nothing here.
    """

    def __init__(
        self, settings: Settings, parameters: Parameters, send: Send, ask: Callable[[Word], None], now: float
    ) -> None:
        self._settings, self._parameters = settings, parameters
        self._send, self._ask = send, ask
        self._began = now
        commanders = frozenset(settings.commanders)
        self._texts = Texts(lambda message: send(message, None))
        token = int(1e6 * now)  # none that a process before this one used
        self._commands = Commands(commanders, send, self._ask_up_to_date, self._texts.tell, token)
        self._service = ParameterService(parameters, commanders, send, self._texts.tell, self._changed)
        self._autopilot = Autopilot(settings.system_id, settings.autopilot_component, settings.facts_fresh_s)
        self._stations = Stations(commanders)
        self._snapshot: Snapshot | None = None
        self._held_token = 0  # of the motion that was held because its station fell silent
        self._telemetry_due = self._values_due = self._tune_due = -math.inf
        self._to_tune = True  # whether the loop does not know the parameters as they are
        self.ignored = 0

    # -- the network -------------------------------------------------------------------------------------

    def heard(self, heard: Heard, now: float) -> None:
        """A message; whatever it says, nothing is raised."""
        self._autopilot.heard(heard, now)
        self._stations.heard(heard, now)
        self._pass_on_news(now)
        message = heard.message
        if not self._addressed(message):
            return
        if isinstance(message, dialect.MAVLink_command_long_message | dialect.MAVLink_command_int_message):
            self._command(heard, message, now)
        elif isinstance(message, dialect.MAVLink_command_cancel_message):
            self._commands.cancelled(heard, message.command, now)
        elif isinstance(
            message,
            dialect.MAVLink_param_request_list_message
            | dialect.MAVLink_param_request_read_message
            | dialect.MAVLink_param_set_message,
        ):
            self._service.heard(heard)
        elif isinstance(message, dialect.MAVLink_ping_message):
            self._ping(heard, message)
        else:
            self.ignored += 1

    def _pass_on_news(self, now: float) -> None:
        vehicle = self._autopilot.news(now)
        if vehicle is not None:
            self._ask(vehicle)

    def _ask_up_to_date(self, word: Word) -> None:
        """Ask the loop for something; what the vehicle said before, and what was set, is known there first."""
        self._ask(self._autopilot.vehicle)
        if self._to_tune:
            self._tune()
        self._ask(word)

    def _addressed(self, message: dialect.MAVLink_message) -> bool:
        """Whether a message is for us. To a component 0 it is for all; a system 0 would be every vehicle."""
        system = getattr(message, "target_system", None)
        component = getattr(message, "target_component", None)
        if isinstance(message, dialect.MAVLink_ping_message):
            return (system, component) == (0, 0) or (system, component) == self._we
        return system == self._we[0] and component in (0, self._we[1])

    @property
    def _we(self) -> tuple[int, int]:
        return self._settings.system_id, self._settings.component_id

    def _command(self, heard: Heard, message: CommandMessage, now: float) -> None:
        command, ours = message.command, message.target_component == self._we[1]
        if command in COMMANDS or (command == ALIAS and ours):
            self._commands.heard(heard, message, now)
        elif command == dialect.MAV_CMD_REQUEST_MESSAGE and ours:
            self._requested(heard, message, now)
        elif command == dialect.MAV_CMD_ARM_AUTHORIZATION_REQUEST:
            self._authorise(heard, message, now)
        elif ours:  # to all components: perhaps somebody else's
            self._acknowledge(heard, message, dialect.MAV_RESULT_UNSUPPORTED)

    def _lately(self, now: float) -> Snapshot | None:
        """How the structure is; None when the loop is silent, and nobody knows."""
        snapshot = self._snapshot
        return None if snapshot is None or now - snapshot.time_s > BEAT_LATE_S else snapshot

    def _authorise(self, heard: Heard, message: CommandMessage, now: float) -> None:
        """An autopilot asks whether it may arm: only with a structure that is deployed and locked."""
        snapshot = self._lately(now)
        if snapshot is not None and telemetry.locked(snapshot):
            # MAVLink's description has the seconds in `progress`; PX4 and MAVSDK have them in `result_param2`.
            self._acknowledge(heard, message, dialect.MAV_RESULT_ACCEPTED, ARMING_VALID_S, ARMING_VALID_S)
            return
        # The field holds one of the protocol's own reasons here, of which only "generic" fits.
        self._acknowledge(heard, message, dialect.MAV_RESULT_DENIED, 0, dialect.MAV_ARM_AUTH_DENIED_REASON_GENERIC)
        if (heard.system, heard.component) == (self._we[0], self._settings.autopilot_component):
            # Who else asks arms nothing, and could fill every station's screen with alarms.
            self._texts.tell(dialect.MAV_SEVERITY_CRITICAL, "arming refused: not deployed and locked")

    def _requested(self, heard: Heard, message: CommandMessage, now: float) -> None:
        """A station asks for one message now."""
        number, boot_ms, snapshot = message.param1, self._boot_ms(now), self._lately(now)
        if number == dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            messages: list[dialect.MAVLink_message] = [_version()]
        elif snapshot is None:
            self._acknowledge(heard, message, dialect.MAV_RESULT_TEMPORARILY_REJECTED)
            return
        elif number == dialect.MAVLINK_MSG_ID_ORI_STRUCTURE:
            messages = [telemetry.structure(snapshot, boot_ms)]
        elif number == dialect.MAVLINK_MSG_ID_ORI_CREASES:
            messages = list(telemetry.creases(snapshot, boot_ms))
        elif number == dialect.MAVLINK_MSG_ID_ORI_LATCHES:
            messages = list(telemetry.latches(snapshot, boot_ms))
        else:
            self._acknowledge(heard, message, dialect.MAV_RESULT_UNSUPPORTED)
            return
        self._acknowledge(heard, message, dialect.MAV_RESULT_ACCEPTED)
        for answer in messages:
            self._send(answer, heard.peer)

    def _ping(self, heard: Heard, message: dialect.MAVLink_ping_message) -> None:
        if message.target_system == 0:
            answer = dialect.MAVLink_ping_message(message.time_usec, message.seq, heard.system, heard.component)
            self._send(answer, heard.peer)

    def _acknowledge(
        self, heard: Heard, message: CommandMessage, result: int, progress: int = 0, reason: int = 0
    ) -> None:
        self._send(
            acknowledgement(message.command, result, progress, reason, heard.system, heard.component), heard.peer
        )

    # -- the control loop --------------------------------------------------------------------------------

    def told(self, word: Word, now: float) -> None:
        """What the control loop says."""
        if isinstance(word, Snapshot):
            if self._snapshot is None or self._snapshot.state != word.state:
                self._telemetry_due = -math.inf
            self._snapshot = word
            self._texts.snapshot(word)
            self._commands.snapshot(word, now)
            if word.beat and now - word.time_s <= BEAT_LATE_S:
                self._send(telemetry.heartbeat(word), None)
                self._send(telemetry.health(word), None)
        elif isinstance(word, Attending):
            self._commands.attending(word)
        elif isinstance(word, Answered):
            self._commands.answered(word, now)
        elif isinstance(word, Ended):
            self._commands.ended(word, now)

    def _changed(self) -> None:
        self._to_tune = True

    def _tune(self) -> None:
        self._to_tune = False
        self._ask(
            Tune(
                speed=self._parameters[SPEED],
                deploy_when=int(self._parameters[DEPLOY_WHEN]),
                hold_on_loss=self._parameters[LINK_LOSS] != 0.0,
            )
        )

    # -- time --------------------------------------------------------------------------------------------

    def tick(self, now: float) -> None:
        """What is due by itself; a few times in every period of the telemetry."""
        self._pass_on_news(now)
        if self._to_tune and now >= self._tune_due:
            self._tune_due = now + TUNE_EVERY_S
            self._tune()
        self._commands.tick(now)
        self._watch_link(now)
        question = self._autopilot.question(now)
        if question is not None:
            self._send(question, None)
        if now >= self._values_due:
            self._values_due = now + 1.0 / PARAMETERS_PER_S
            self._service.tick()
        self._texts.tick(now)
        snapshot = self._lately(now)  # a silent loop's is none
        if now >= self._telemetry_due and snapshot is not None:
            self._telemetry_due = now + 1.0 / self._parameters[TELEMETRY_HZ]
            self._tell_telemetry(snapshot, now)

    def _watch_link(self, now: float) -> None:
        """Hold a motion whose stations have all fallen silent, where that is wanted; once per motion."""
        motion = self._commands.motion
        if motion is None or not motion.taken or self._parameters[LINK_LOSS] == 0.0:
            return
        systems = {asker.system for asker in motion.askers}
        silent = self._stations.silent(systems, self._parameters[LINK_TIMEOUT], now)
        if silent and motion.token != self._held_token:
            self._held_token = motion.token
            self._ask(Hold(dialect.ORI_REASON_LINK_LOST))
            self._texts.tell(dialect.MAV_SEVERITY_WARNING, "ground station lost: held")

    def _tell_telemetry(self, snapshot: Snapshot, now: float) -> None:
        boot_ms = self._boot_ms(now)
        self._send(telemetry.structure(snapshot, boot_ms), None)
        for message in (*telemetry.creases(snapshot, boot_ms), *telemetry.latches(snapshot, boot_ms)):
            self._send(message, None)
        if self._parameters[NAMED_VALUES] != 0.0:
            for message in telemetry.named_values(snapshot, boot_ms):
                self._send(message, None)

    def _boot_ms(self, now: float) -> int:
        return int(1e3 * (now - self._began)) % (1 << 32)


def _version() -> dialect.MAVLink_message:
    major, minor, patch = (int(part) for part in version("ori-deploy").split(".")[:3])
    release = dialect.FIRMWARE_VERSION_TYPE_OFFICIAL
    return dialect.MAVLink_autopilot_version_message(
        capabilities=CAPABILITIES,
        flight_sw_version=major << 24 | minor << 16 | patch << 8 | release,
        middleware_sw_version=0,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=[0] * 8,
        middleware_custom_version=[0] * 8,
        os_custom_version=[0] * 8,
        vendor_id=0,
        product_id=0,
        uid=0,
    )
