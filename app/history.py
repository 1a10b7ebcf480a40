"""What undo and redo go back to. Scenarios are immutable, so an entry is the document itself."""

from __future__ import annotations

from scenes.scenario import Scenario

DEPTH = 200


class History:
    """Two stacks of documents about the present one."""

    def __init__(self) -> None:
        self._undo: list[tuple[str | None, Scenario]] = []
        self._redo: list[Scenario] = []

    @property
    def can_undo(self) -> bool:
        return bool(self._undo)

    @property
    def can_redo(self) -> bool:
        return bool(self._redo)

    def edited(self, before: Scenario, drag: str | None) -> None:
        """Note an edit; edits in a row that carry the same `drag` token are one entry."""
        if not (drag is not None and self._undo and self._undo[-1][0] == drag):
            self._undo.append((drag, before))
            del self._undo[:-DEPTH]
        self._redo.clear()

    @property
    def before(self) -> Scenario:
        """What `undo` would go back to. Raises IndexError where there is nothing."""
        return self._undo[-1][1]

    @property
    def after(self) -> Scenario:
        """What `redo` would go forward to. Raises IndexError where there is nothing."""
        return self._redo[-1]

    def undo(self, present: Scenario) -> Scenario:
        """What to go back to. Raises IndexError where there is nothing."""
        _, before = self._undo.pop()
        self._redo.append(present)
        return before

    def redo(self, present: Scenario) -> Scenario:
        """What to go forward to. Raises IndexError where there is nothing."""
        after = self._redo.pop()
        self._undo.append((None, present))
        return after

    def clear(self) -> None:
        self._undo.clear()
        self._redo.clear()
