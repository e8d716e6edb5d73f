"""Working ahead: what one thread makes while another uses what came before."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Generator, Iterable
from contextlib import suppress
from typing import Any, Final, Generic, TypeVar

T = TypeVar("T")

_END: Final = object()

PATIENCE: Final = 5.0
"""Seconds to wait, on closing, for a thread that is in the middle of an item."""


class _Belt(Generic[T]):
    """Items between two threads, at most so many."""

    def __init__(self, room: int) -> None:
        self._room = room
        self._items: deque[Any] = deque()
        self._changed = threading.Condition()
        self._closed = False

    def put(self, item: T | object) -> bool:
        """Add an item when there is room; False once nobody takes any more."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._items) < self._room or self._closed)
            if not self._closed:
                self._items.append(item)
                self._changed.notify_all()
            return not self._closed

    def take(self) -> Any:
        """Take the next item when there is one."""
        with self._changed:
            self._changed.wait_for(lambda: bool(self._items))
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Take no more."""
        with self._changed:
            self._closed = True
            self._items.clear()
            self._changed.notify_all()


def ahead(items: Iterable[T], room: int, name: str = "ahead") -> Generator[T, None, None]:
    """Iterate in a thread of its own, a few items ahead of whoever takes them.

    Nothing is begun before the first item is asked for. Closing ends the thread, but for a source
    that waits for something itself: that ends with the process.

    Parameters
    ----------
    items : iterable
        A generator is closed by the thread that ran it.
    room : int
        Items that may wait; one more is being made.
    name : str
        Of the thread.

    Yields
    ------
    The same items in order. What the iteration raises is raised here, after them.
    """
    belt: _Belt[Any] = _Belt(room)
    failed: list[BaseException] = []

    def work() -> None:
        try:
            for item in items:
                if not belt.put(item):
                    break
        except BaseException as error:  # To be raised where the items are wanted.
            failed.append(error)
        finally:
            close = getattr(items, "close", None)
            if close is not None:
                with suppress(BaseException):
                    close()
            belt.put(_END)

    thread = threading.Thread(target=work, name=f"unitsel-{name}", daemon=True)
    thread.start()
    try:
        while (item := belt.take()) is not _END:
            yield item
        if failed:
            raise failed[0]
    finally:
        belt.close()
        thread.join(PATIENCE if thread.is_alive() else None)
