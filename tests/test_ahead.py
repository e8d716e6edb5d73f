"""Working ahead in a thread: order, bounds, errors, and an end."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from unitsel.ahead import Ahead


def threads() -> int:
    return sum(t.name.startswith("unitsel-") for t in threading.enumerate())


def test_items_come_in_order_and_only_so_many_ahead() -> None:
    made: list[int] = []

    def source() -> Iterator[int]:
        for i in range(50):
            made.append(i)
            yield i

    items = Ahead(source(), 3)
    assert made == []
    for i, item in enumerate(items):
        assert item == i
        if i == 10:
            time.sleep(0.05)
            # 3 wait, one is held by the thread that found no room.
            assert len(made) <= i + 1 + 3 + 1
    assert made == list(range(50))
    assert threads() == 0


def test_an_error_is_raised_after_what_came_before_it() -> None:
    def source() -> Iterator[int]:
        yield 1
        yield 2
        raise KeyError("three")

    got = []
    with pytest.raises(KeyError, match="three"):
        for item in Ahead(source(), 5):
            got.append(item)
    assert got == [1, 2]


def test_closing_ends_the_thread_and_closes_the_source_there() -> None:
    closed: list[str] = []

    def source() -> Iterator[int]:
        try:
            while True:
                yield 1
        finally:
            closed.append(threading.current_thread().name)

    items = Ahead(source(), 2, "here")
    assert next(items) == 1
    items.close()
    assert closed == ["unitsel-here"]
    assert threads() == 0


def test_making_and_using_go_side_by_side() -> None:
    def slow() -> Iterator[int]:
        for i in range(8):
            time.sleep(0.03)
            yield i

    started = time.perf_counter()
    for _ in Ahead(slow(), 2):
        time.sleep(0.03)
    assert time.perf_counter() - started < 0.85 * 16 * 0.03


def test_closing_does_not_wait_for_a_source_that_waits() -> None:
    """Whoever waits for an item in another thread is let go, too."""
    never = threading.Event()

    def source() -> Iterator[int]:
        yield 1
        never.wait()

    items = Ahead(source(), 2, patience=0.05)
    assert next(items) == 1
    rest: list[list[int]] = []
    taker = threading.Thread(target=lambda: rest.append(list(items)))
    taker.start()
    started = time.perf_counter()
    items.close()
    taker.join(2)
    assert rest == [[]]
    assert time.perf_counter() - started < 1
    never.set()
