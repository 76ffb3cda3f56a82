"""All servos on one wire: what instructions do, who answers what and when."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ori_deploy.wire.dynamixel import BAUD_CODES
from sim_backends.dynamixel.motors import STEP_S, Motors
from sim_backends.dynamixel.packets import BROADCAST, HEADER, STATUS, Instruction, crc16, status
from sim_backends.dynamixel.servo import CRC, INSTRUCTION, Refusal, Servo
from sim_backends.dynamixel.spec import BusSpec

PING_SLOT_S = 300e-6
"""What a time slot of a broadcast ping has beside the bytes of an answer; each id has its own."""

PING, READ, WRITE, REG_WRITE, ACTION, FACTORY_RESET, REBOOT, CLEAR = 1, 2, 3, 4, 5, 6, 8, 0x10
SYNC_READ, SYNC_WRITE, FAST_SYNC_READ, BULK_READ, BULK_WRITE, FAST_BULK_READ = 0x82, 0x83, 0x8A, 0x92, 0x93, 0x9A
READS = frozenset({READ, SYNC_READ, FAST_SYNC_READ, BULK_READ, FAST_BULK_READ})
CLEAR_TURNS = bytes((0x01, 0x44, 0x58, 0x4C, 0x22))
FIRST_CLEAR_FIRMWARE = 42
CAREFUL_RESET_FIRMWARE = 42
"""From here on a servo does not reset everything because of a broadcast."""

COUNTED = frozenset({"drop", "corrupt", "truncate", "delay"})
MEASURED = frozenset({"cut_bytes", "delay_s"})
"""Names in `Faults`: what is used up answer by answer, and by how much it hits."""

WATCH_STEPS = 5
"""Steps of the motors between two looks of a servo at itself."""


@dataclass
class Faults:
    """What goes wrong with one servo's answers.

    Attributes
    ----------
    drop, corrupt, truncate, delay
        Answers still to be lost, spoilt, cut short and held back.
    cut_bytes, delay_s
        By how much.
    mute
        Says nothing at all.
    """

    drop: int = 0
    corrupt: int = 0
    truncate: int = 0
    delay: int = 0
    cut_bytes: int = 1
    delay_s: float = 0.0
    mute: bool = False

    def use(self, name: str) -> bool:
        """Use one up, if there is any."""
        left: int = getattr(self, name)
        if left:
            setattr(self, name, left - 1)
        return left > 0


@dataclass
class Answer:
    """What goes back to the host after an instruction.

    Attributes
    ----------
    data
        Bytes.
    wire_s
        Time that they take, pauses included.
    """

    data: bytearray = field(default_factory=bytearray)
    wire_s: float = 0.0


@dataclass(frozen=True)
class _Said:
    """One servo's part of an answer."""

    servo: Servo
    frame: bytes


class Bus:
    """Servos on one wire.

    Parameters
    ----------
    spec
        What is on it.
    now
        Time at the start, on the bus's clock.

    Attributes
    ----------
    servos, motors, faults
        In the order of the spec.
    noise
        Bytes that come before the next answer.
    """

    def __init__(self, spec: BusSpec, now: float) -> None:
        self.spec = spec
        self.motors = Motors(spec)
        self.servos = [Servo(servo, spec.baud, self.motors, k) for k, servo in enumerate(spec.servos)]
        self.faults = [Faults() for _ in spec.servos]
        self.noise = b""
        for servo in self.servos:
            servo.heard(now)
        self._epoch, self._steps = now, 0
        self._after: list[Callable[[], None]] = []

    # -- time ----------------------------------------------------------------------------------------

    def advance(self, now: float) -> None:
        """Bring motors and watchdogs to now, each trip at its own time."""
        while True:
            trips = [servo.trip_time() for servo in self.servos]
            first = min(trips)
            self._step_to(min(first, now))
            if first > now:
                return
            self.servos[trips.index(first)].trip()

    def _step_to(self, time_s: float) -> None:
        target = int((time_s - self._epoch) / STEP_S + 1e-6)
        while self._steps < target:
            self._steps += 1
            self.motors.step(self._epoch + self._steps * STEP_S)
            if self._steps % WATCH_STEPS == 0:
                for servo in self.servos:
                    servo.watch_itself()

    # -- instructions --------------------------------------------------------------------------------

    def handle(self, instruction: Instruction, baud: int, now: float) -> Answer:
        """Do what a packet asks of those who hear it.

        Parameters
        ----------
        baud
            Rate at which it was sent: servos set to another hear nothing.
        now
            When it was there.
        """
        code, target = BAUD_CODES.get(baud), instruction.target
        meant = [
            servo
            for servo in self.servos
            if servo.baud_code == code and now >= servo.silent_until and target in (BROADCAST, servo.id)
        ]
        if not instruction.good:
            alone = [servo for servo in meant if target != BROADCAST and _speaks(servo, instruction.code)]
            return self._answer([_Said(servo, self._status(servo, CRC)) for servo in alone], baud)
        for servo in meant:
            servo.heard(now)
        answer = self._dispatch(instruction, meant, baud, now)
        for change in self._after:
            change()
        self._after.clear()
        return answer

    def _dispatch(self, instruction: Instruction, meant: list[Servo], baud: int, now: float) -> Answer:
        parameters = instruction.parameters
        if instruction.code == SYNC_WRITE:
            self._sync_write(parameters, _by_id(meant))
            return Answer()
        if instruction.code == BULK_WRITE:
            self._bulk_write(parameters, _by_id(meant))
            return Answer()
        if instruction.code in (SYNC_READ, BULK_READ):
            asked = _sync_asked(parameters) if instruction.code == SYNC_READ else _bulk_asked(parameters)
            return self._chain(asked, meant, baud)
        if instruction.code in (FAST_SYNC_READ, FAST_BULK_READ):
            asked = _sync_asked(parameters) if instruction.code == FAST_SYNC_READ else _bulk_asked(parameters)
            return self._fast_chain(list(asked), meant, baud)
        if instruction.code == PING and instruction.target == BROADCAST:
            return self._roll_call(meant, instruction, baud, now)
        said = []
        for servo in meant:
            frame = self._single(servo, instruction, now)
            if frame and instruction.target != BROADCAST:
                said.append(_Said(servo, frame))
        return self._answer(said, baud)

    def _roll_call(self, meant: Sequence[Servo], instruction: Instruction, baud: int, now: float) -> Answer:
        """Answers to a broadcast ping, by id: whoever is there waits for the slots of all that could be before."""
        present = sorted((s for s in meant if not self._fault(s).mute), key=lambda servo: servo.id)
        said = [_Said(servo, self._single(servo, instruction, now)) for servo in present]
        answer = self._answer(said, baud)
        if said:
            slot_s = PING_SLOT_S + 10.0 * len(said[-1].frame) / baud
            answer.wire_s = max(answer.wire_s, slot_s * (said[-1].servo.id + 1))
        return answer

    def _single(self, servo: Servo, instruction: Instruction, now: float) -> bytes:
        """Carry one instruction out, and its status packet; empty where the return level forbids one."""
        speaks = _speaks(servo, instruction.code)
        try:
            frame = status(servo.id, servo.error_byte, self._carry_out(servo, instruction, now))
        except Refusal as refusal:
            frame = self._status(servo, refusal.code)
        return frame if speaks else b""

    def _carry_out(self, servo: Servo, instruction: Instruction, now: float) -> bytes:
        parameters = instruction.parameters
        if instruction.code == PING:
            return servo.read(0, 2) + servo.read(6, 1)
        if instruction.code == READ and len(parameters) == 4:
            return servo.read(_word(parameters), _word(parameters[2:]))
        if instruction.code in (WRITE, REG_WRITE) and len(parameters) > 2:
            address, data = _word(parameters), parameters[2:]
            if instruction.code == REG_WRITE:
                servo.register_write(address, data)
            elif address <= servo.table.baud_rate.address and address + len(data) > servo.table.id.address:
                # Id and rate change once the answer is out; what is wrong with them is said in it.
                servo.check(address, data)
                self._after.append(lambda: servo.write(address, data))
            else:
                servo.write(address, data)
            return b""
        if instruction.code == ACTION:
            servo.action()
            return b""
        if instruction.code == REBOOT:
            self._after.append(lambda: servo.reboot(now))
            return b""
        if instruction.code == CLEAR and parameters == CLEAR_TURNS and servo.spec.firmware >= FIRST_CLEAR_FIRMWARE:
            servo.clear_turns()
            return b""
        if instruction.code == FACTORY_RESET and parameters[:1] in (b"\xff", b"\x01", b"\x02"):
            option = parameters[0]
            careful = servo.spec.firmware >= CAREFUL_RESET_FIRMWARE
            if option == 0xFF and instruction.target == BROADCAST and careful:
                raise Refusal(INSTRUCTION)
            self._after.append(lambda: servo.factory_reset(keep_id=option != 0xFF, keep_baud=option == 0x02))
            return b""
        raise Refusal(INSTRUCTION)

    def _sync_write(self, parameters: bytes, meant: Mapping[int, Sequence[Servo]]) -> None:
        address, size = _word(parameters), _word(parameters[2:])
        rest = parameters[4:]
        for at in range(0, len(rest) - size, size + 1):
            self._write_quietly(rest[at], address, rest[at + 1 : at + 1 + size], meant)

    def _bulk_write(self, parameters: bytes, meant: Mapping[int, Sequence[Servo]]) -> None:
        at = 0
        while at + 5 <= len(parameters):
            size = _word(parameters[at + 3 :])
            data = parameters[at + 5 : at + 5 + size]
            self._write_quietly(parameters[at], _word(parameters[at + 1 :]), data, meant)
            at += 5 + size

    def _write_quietly(self, servo_id: int, address: int, data: bytes, meant: Mapping[int, Sequence[Servo]]) -> None:
        """Nobody answers a group write, so nobody hears of a refusal."""
        for servo in meant[servo_id]:
            try:
                servo.write(address, data)
            except Refusal:
                continue

    # -- answers -------------------------------------------------------------------------------------

    def _chain(self, asked: Iterator[tuple[int, int, int]], meant: Sequence[Servo], baud: int) -> Answer:
        """Status packets one after the other, as asked."""
        by_id = _by_id([s for s in meant if not self._fault(s).mute and _speaks(s, SYNC_READ)])
        said: list[_Said] = []
        for servo_id, address, size in asked:
            there = by_id[servo_id]
            if not there and not self.spec.followers_answer:
                break
            for servo in there:
                try:
                    said.append(_Said(servo, status(servo_id, servo.error_byte, servo.read(address, size))))
                except Refusal as refusal:
                    said.append(_Said(servo, self._status(servo, refusal.code)))
        return self._answer(said, baud, linked=not self.spec.followers_answer)

    def _fast_chain(self, asked: Sequence[tuple[int, int, int]], meant: Sequence[Servo], baud: int) -> Answer:
        """One packet to which every servo adds its block; whoever is missing ends it."""
        length = 1 + sum(size + 4 for _, _, size in asked)
        data = HEADER + bytes((BROADCAST,)) + length.to_bytes(2, "little") + bytes((STATUS,))
        able = _by_id([s for s in meant if _reads_fast(s) and _speaks(s, FAST_SYNC_READ)])
        sent, crc, pause = b"", crc16(data), 0.0
        for servo_id, address, size in asked:
            there = [s for s in able[servo_id] if not (self._fault(s).mute or self._fault(s).use("drop"))]
            if not there:
                break
            pause = pause or self.spec.turnaround_s + there[0].return_delay_s
            blocks = [_block(servo, servo_id, address, size, crc) for servo in there]
            pause += sum(self._fault(servo).delay_s for servo in there if self._fault(servo).use("delay"))
            start = b"" if sent else data
            sent += _collide([self._spoil(s, start + block, at=-4) for s, block in zip(there, blocks, strict=True)])
            crc = crc16(_collide(blocks), crc)
        return Answer(bytearray(self._take_noise()) + sent, pause + 10.0 * len(sent) / baud)

    def _answer(self, said: Sequence[_Said], baud: int, *, linked: bool = False) -> Answer:
        """Frames on the wire, in order; those of one id collide. Linked, all are silent after one that is."""
        answer = Answer(bytearray(self._take_noise()))
        k = 0
        while k < len(said):
            same = [said[k]]
            while k + len(same) < len(said) and said[k + len(same)].servo.id == said[k].servo.id:
                same.append(said[k + len(same)])
            pause = self.spec.turnaround_s + said[k].servo.return_delay_s
            frames = []
            for one in same:
                fault = self._fault(one.servo)
                if fault.mute or fault.use("drop"):
                    continue
                if fault.use("delay"):
                    pause += fault.delay_s
                frames.append(self._spoil(one.servo, one.frame, at=-3))
            frame = _collide(frames)
            if frame:
                answer.data += frame
                answer.wire_s += pause + 10.0 * len(frame) / baud
            elif linked:
                break
            k += len(same)
        return answer

    def _spoil(self, servo: Servo, frame: bytes, at: int) -> bytes:
        fault = self._fault(servo)
        if fault.use("corrupt"):
            changed = bytearray(frame)
            changed[at] ^= 0x10
            frame = bytes(changed)
        return frame[: -fault.cut_bytes] if fault.use("truncate") else frame

    def _take_noise(self) -> bytes:
        noise, self.noise = self.noise, b""
        return noise

    def _fault(self, servo: Servo) -> Faults:
        return self.faults[servo.k]

    def _status(self, servo: Servo, code: int) -> bytes:
        return status(servo.id, servo.error_byte | code)


def _collide(frames: Sequence[bytes]) -> bytes:
    """What is heard when several talk at once: a line that anyone pulls low is low."""
    if not frames:
        return b""
    heard = bytearray(max(frames, key=len))
    for frame in frames:
        for at, byte in enumerate(frame):
            heard[at] &= byte
    return bytes(heard)


def _speaks(servo: Servo, code: int) -> bool:
    """Whether its status return level lets it answer an instruction."""
    level = servo.get(servo.table.status_return_level)
    return code == PING or level >= 2 or (level == 1 and code in READS)


def _reads_fast(servo: Servo) -> bool:
    return servo.spec.firmware >= servo.model.fast_sync_read_firmware


def _block(servo: Servo, servo_id: int, address: int, size: int, crc: int) -> bytes:
    """A servo's part of a fast answer; its CRC is carried on from that of everything before."""
    try:
        block = bytes((servo.error_byte, servo_id)) + servo.read(address, size)
    except Refusal as refusal:
        block = bytes((servo.error_byte | refusal.code, servo_id)) + bytes(size)
    return block + crc16(block, crc).to_bytes(2, "little")


def _by_id(servos: Sequence[Servo]) -> Mapping[int, Sequence[Servo]]:
    """Servos by id; none where there is none."""
    found: defaultdict[int, list[Servo]] = defaultdict(list)
    for servo in servos:
        found[servo.id].append(servo)
    return found


def _word(data: bytes) -> int:
    return int.from_bytes(data[:2], "little")


def _sync_asked(parameters: bytes) -> Iterator[tuple[int, int, int]]:
    address, size = _word(parameters), _word(parameters[2:])
    return ((servo_id, address, size) for servo_id in parameters[4:])


def _bulk_asked(parameters: bytes) -> Iterator[tuple[int, int, int]]:
    entries = (parameters[at : at + 5] for at in range(0, len(parameters) - 4, 5))
    return ((entry[0], _word(entry[1:]), _word(entry[3:])) for entry in entries)


def truth(bus: Bus) -> list[Mapping[str, float | int | bool]]:
    """What is really the case, servo by servo."""
    motors = bus.motors
    return [
        {
            "id": servo.id,
            "shaft_rad": float(motors.shaft_rad[k]),
            "output_rad": float(motors.output_rad[k]),
            "velocity_rad_s": float(motors.velocity_rad_s[k]),
            "goal_rad": float(motors.goal_rad[k]),
            "goal_count": servo.get(servo.table.goal_position),
            "torque_on": bool(motors.torque_on[k]),
            "frozen": bool(motors.frozen[k]),
            "watchdog": servo.get(servo.table.bus_watchdog),
            "temperature_c": float(motors.temperature_c[k]),
            "current_a": float(motors.current_a[k]),
            "hardware_error": servo.get(servo.table.hardware_error_status),
            "moved_s": float(max(motors.moved_s[k], -1e9)),
        }
        for k, servo in enumerate(bus.servos)
    ]
