"""Telling and being told: who listens to changes, and the way from other threads onto the event loop."""

from __future__ import annotations

import asyncio
import inspect
import logging
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable

from app.changes import REFUSALS, Change

log = logging.getLogger(__name__)

Refuse = Callable[[str], None]


class Switchboard(ABC):
    """Lives on one event loop's thread; only `post` may be called from others."""

    def __init__(self) -> None:
        self._listeners: list[Callable[[Change], None]] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._tasks: set[asyncio.Task] = set()

    @abstractmethod
    def say(self, message: str) -> None:
        """Tell everybody what nobody in particular has asked for."""

    def subscribe(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Call `listener` on the loop after every change; returns what ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def tell(self, *changes: Change) -> None:
        """Let every listener know; one that fails does not keep the others from hearing."""
        for change in changes:
            for listener in tuple(self._listeners):
                try:
                    listener(change)
                except Exception:
                    log.exception("a listener failed on %s", change)

    def post(self, command: Callable, *args, on_error: Refuse | None = None, **kwargs) -> None:
        """From any thread: run a command on the loop; a refusal goes to `on_error`."""
        if self._loop is None or self._loop.is_closed():
            return
        self._loop.call_soon_threadsafe(self._run_posted, command, args, kwargs, on_error)

    def background(self, coroutine) -> None:
        """Run a coroutine and keep hold of it until it ends."""
        task = asyncio.ensure_future(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _run_posted(self, command: Callable, args, kwargs, on_error: Refuse | None) -> None:
        try:
            result = command(*args, **kwargs)
        except Exception as error:
            self._report_failure(error, on_error)
            return
        if inspect.isawaitable(result):
            self.background(self._finish_posted(result, on_error))

    async def _finish_posted(self, result: Awaitable, on_error: Refuse | None) -> None:
        try:
            await result
        except Exception as error:
            self._report_failure(error, on_error)

    def _report_failure(self, error: Exception, on_error: Refuse | None) -> None:
        if isinstance(error, REFUSALS):
            message = str(error)
        else:
            log.error("a command failed", exc_info=error)
            message = "that failed for a reason of ours; the server's log has it"
        (on_error or self.say)(message)
