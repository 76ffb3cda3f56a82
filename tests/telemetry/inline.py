"""A log written in this process: most tests ask what is in it, not who wrote it."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

from ori_deploy.actuators.resolve import ResolvedRig
from ori_deploy.deploy.result import CycleRecord, MotionResult
from ori_deploy.motion.plan import Plan
from ori_deploy.telemetry.frames import CycleFrames, plan_info, result_item
from ori_deploy.telemetry.log import LogWriter
from tests.deploy.synthetic import Bench, bench, synthetic_plan


class InlineLog(LogWriter):
    """An observer of a controller that writes what it sees."""

    def __init__(self, path: Path, plan: Plan, rig: ResolvedRig, *, plan_sha256: str = "") -> None:
        super().__init__(path, plan_info(plan, rig, plan_sha256=plan_sha256))
        self._frames = CycleFrames()

    def __call__(self, record: CycleRecord) -> None:
        self.write(self._frames.frame(record))

    def write_result(self, result: MotionResult) -> None:
        self.write([result_item(result, self._frames.time_s)])

    def __enter__(self) -> InlineLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)


def logged(path: Path, fault: bool = False, n_cells: int = 4) -> tuple[Bench, MotionResult]:
    """Deploy with a log, some replies lost, an overload half-way if wanted."""
    b = bench(synthetic_plan(n_cells))
    with InlineLog(path, b.plan, b.rig, plan_sha256="ab" * 32) as log:
        b.controller.add_observer(log)
        b.controller.deploy()
        b.step_until_fold(0.3)
        b.bus.drop_replies("servo_c2", 2)
        b.steps(5)
        if fault:
            b.bus.overload("servo_c1")
        result = b.controller.run()
        log.write_result(result)
    return b, result
