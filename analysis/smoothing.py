"""Smoothing over time, within unbroken runs of frames."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt


def runs(numbers: npt.ArrayLike) -> list[tuple[int, int]]:
    """Stretches of consecutive frame numbers, as [first, last) places in the list."""
    n = np.asarray(numbers, dtype=np.int64)
    if n.size == 0:
        return []
    edges = [0, *(np.flatnonzero(np.diff(n) != 1) + 1).tolist(), len(n)]
    return list(pairwise(edges))


def smoothed(values: npt.NDArray[np.floating], window: int) -> npt.NDArray[np.floating]:
    """Values of an unbroken run, each replaced by a parabola fitted around it (Savitzky-Golay).

    Parameters
    ----------
    values : (n, ...) float
    window : int
        Frames of the fit, odd; less where the run is shorter, and 1 leaves all as it is.
    """
    n = len(values)
    width = min(window, n if n % 2 else n - 1)
    # Three points lie on a parabola: nothing would be smoothed.
    if width < 3:
        return values
    from scipy.signal import savgol_filter  # Slow to load.

    return np.asarray(savgol_filter(values, width, 2 if width > 3 else 1, axis=0))


def smoothed_runs(
    values: npt.NDArray[np.floating], numbers: npt.ArrayLike, window: int
) -> npt.NDArray[np.floating]:
    """The same for frames with gaps: each unbroken run by itself."""
    parts = [smoothed(values[first:last], window) for first, last in runs(numbers)]
    return np.concatenate(parts) if parts else values
