"""Ctrl-C while worker processes run: it is the parent's to answer.

A terminal sends it to every process of the group, and a worker that is interrupted, perhaps
while it still loads its libraries, prints a traceback. Signals that are blocked stay blocked in
the processes that one starts, from their first moment on. So the main thread, which starts them,
blocks the signal, and a thread that does nothing else receives it for Python, which then
interrupts the main thread as ever.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from multiprocessing import resource_tracker

from joblib.externals.loky.backend import resource_tracker as loky_tracker


@contextlib.contextmanager
def workers_uninterrupted() -> Iterator[None]:
    """Keep Ctrl-C from the processes that are started in a block, and for this one."""
    if threading.current_thread() is not threading.main_thread():
        # Whoever calls from elsewhere has arranged for signals otherwise.
        yield
        return
    # Starting a tracker lets the signal through again, so they start first.
    resource_tracker.ensure_running()
    loky_tracker.ensure_running()
    done = threading.Event()
    receiver = threading.Thread(target=_receive, args=(done,), name="ctrl-c", daemon=True)
    receiver.start()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        done.set()
        receiver.join()


def _receive(done: threading.Event) -> None:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    done.wait()
