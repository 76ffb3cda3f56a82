"""Who may command: one at a time; everybody may look, and everybody may stop."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Control:
    """Who is there, and who of them holds control.

    Attributes
    ----------
    present
        Everybody who looks at the page.
    holder
        Who may command; None where nobody has asked for it, or who had it has gone.
    """

    present: frozenset[str] = frozenset()
    holder: str | None = None

    def came(self, who: str) -> Control:
        """Somebody opened the page; that alone gives no control."""
        return replace(self, present=self.present | {who})

    def gone(self, who: str) -> Control:
        """Somebody left. Control that was held is free, and what moves goes on: nobody's leaving is a command."""
        return Control(self.present - {who}, None if self.holder == who else self.holder)

    def claim(self, who: str) -> Control:
        """Hold control where nobody does."""
        if who not in self.present or self.holder is not None:
            return self
        return replace(self, holder=who)

    def take(self, who: str) -> Control:
        """Hold control, whoever had it: asked for in so many words."""
        return replace(self, holder=who) if who in self.present else self

    def release(self, who: str) -> Control:
        """Give control back."""
        return replace(self, holder=None) if self.holder == who else self

    def may_command(self, who: str) -> bool:
        """Whether somebody's commands are passed on."""
        return who in self.present and self.holder == who
