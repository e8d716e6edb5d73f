"""Working ahead: what one thread makes while another uses what came before."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import suppress
from types import TracebackType
from typing import Any, Final, Generic, Self, TypeVar

T = TypeVar("T")

_END: Final = object()


class Ahead(Generic[T]):
    """An iterator that runs in a thread of its own, a few items ahead; a context manager.

    Nothing is begun before the first item is asked for. What the iteration raises is raised to
    whoever takes the items, after those that came before it.

    Parameters
    ----------
    items : iterable
        A generator is closed by the thread that ran it.
    room : int
        Items that may wait; one more is being made.
    name : str
        Of the thread.
    patience : float
        Seconds that `close` waits for the thread, which may be in the middle of an item. One that
        is not done by then ends after it, or with the process.
    """

    def __init__(
        self, items: Iterable[T], room: int, name: str = "ahead", *, patience: float = 5.0
    ) -> None:
        self._source = items
        self._room = room
        self._patience = patience
        self._waiting: deque[Any] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._failed: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name=f"unitsel-{name}", daemon=True)

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        with self._changed:
            if not self._closed and self._thread.ident is None:
                self._thread.start()
            self._changed.wait_for(lambda: self._waiting or self._closed)
            item: Any = self._waiting.popleft() if self._waiting else _END
            self._changed.notify_all()
            if item is not _END:
                taken: T = item
                return taken
            self._closed = True
            failed, self._failed = self._failed, None
        if failed is not None:
            raise failed
        raise StopIteration

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End it, from any thread; a second time does nothing."""
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._changed.notify_all()
        if self._thread.ident is not None and self._thread is not threading.current_thread():
            self._thread.join(self._patience)

    def _work(self) -> None:
        try:
            for item in self._source:
                if not self._put(item):
                    break
        except BaseException as error:  # To be raised where the items are wanted.
            self._failed = error
        finally:
            close = getattr(self._source, "close", None)
            if close is not None:
                with suppress(Exception):
                    close()
            self._put(_END)

    def _put(self, item: object) -> bool:
        """Add an item when there is room; False once nobody takes any more."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._waiting) < self._room or self._closed)
            if not self._closed:
                self._waiting.append(item)
                self._changed.notify_all()
            return not self._closed
