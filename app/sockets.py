"""What the telemetry socket and the viewer's socket share: ending together, and closing without waiting."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect

CLOSING_S = 1.0


async def first_to_end(*coroutines: Coroutine[Any, Any, None]) -> None:
    """Run all until one ends, end the others, and raise what that one raised."""
    tasks = [asyncio.ensure_future(coroutine) for coroutine in coroutines]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        ended = [task for task in tasks if task.done()]
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
    for task in ended:
        task.result()


async def close(websocket: WebSocket, code: int, reason: str = "") -> None:
    """Close, but do not wait for a peer that has gone or does not read."""
    try:
        async with asyncio.timeout(CLOSING_S):
            await websocket.close(code, reason)
    except (RuntimeError, OSError, WebSocketDisconnect, TimeoutError):
        pass  # it is closed already, or its connection will be cut
