"""The controller's table as a diagram and as a table, for the documents."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ori_deploy.deploy.states import RULES, Event, Rule, State

_EVERYWHERE = (Event.FAULT, Event.EMERGENCY_STOP)
"""What leads from nearly every state into the same one: drawn once, not ten times."""


def mermaid() -> str:
    """A state diagram in Mermaid's language, one arrow for all events between two states."""
    lines = ["stateDiagram-v2", f"    [*] --> {State.DISCONNECTED}"]
    arrows: dict[tuple[State, State], list[str]] = {}
    for rule in _drawn():
        for target in rule.targets:
            arrows.setdefault((rule.source, target), []).append(str(rule.event))
    for (source, target), events in arrows.items():
        lines.append(f"    {source} --> {target}: {', '.join(events)}")
    lines.append(f"    note right of {State.FAULT}: from every state with a link, by fault or emergency_stop")
    return "\n".join(lines)


def table() -> str:
    """All rules as a table in Markdown."""
    rows = ["| in state | on | only if | does | then |", "|---|---|---|---|---|"]
    for event in Event:
        grouped: dict[tuple[str, str, tuple[State, ...]], list[State]] = {}
        for rule in RULES.values():
            if rule.event is event:
                key = (str(rule.guard or ""), str(rule.action or ""), rule.targets)
                grouped.setdefault(key, []).append(rule.source)
        for (guard, action, targets), sources in grouped.items():
            rows.append(f"| {_names(sources)} | {event} | {guard} | {action} | {_names(targets)} |")
    return "\n".join(rows)


def _drawn() -> Iterator[Rule]:
    return (rule for rule in RULES.values() if rule.event not in _EVERYWHERE)


def _names(states: Iterable[State]) -> str:
    return ", ".join(str(state) for state in states)
