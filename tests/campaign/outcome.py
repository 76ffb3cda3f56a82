"""What comes of a trial."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Trial:
    """What came of it.

    Attributes
    ----------
    noticed_s
        From the injection to the first cycle that holds or stops; None where nothing was.
    rested_s, still_s
        From that cycle to the one whose goals rest, and to when every shaft truly stays where it is.
    within_s
        From the injection to the goals' rest.
    ended
        State and fault, in words.
    violations
        Broken promises, in words.
    not_judged
        What broke while the machine was late itself, in words.
    attempts_before
        The same of earlier attempts at this trial.
    """

    backend: str
    fault: str
    stage: str
    seed: int
    noticed_s: float | None = None
    rested_s: float | None = None
    still_s: float | None = None
    within_s: float | None = None
    ended: str = ""
    violations: list[str] = field(default_factory=list)
    not_judged: list[str] = field(default_factory=list)
    attempts_before: list[str] = field(default_factory=list)
