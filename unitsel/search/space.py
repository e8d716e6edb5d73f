"""What a search looks at: the units, and each list of candidates made ready.

What does not depend on the weights is worked out once for each list of candidates (usually one a
viseme) and kept with the units: features laid out for `unitsel.search.lanes`, and the visual costs
of the few steps inside a sequence that cost less than a jump. A thousand settings of the weights
use the same lists.
"""

from __future__ import annotations

import contextlib
import itertools
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from unitsel.search.kernels import REACH, distances, find_pairs
from unitsel.search.lanes import LANES

FloatArray = npt.NDArray[np.float64]
SingleArray = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]
UnitArray = npt.NDArray[np.int32]

_KEPT: Final = 8
"""Lists of candidates are kept ready up to this many times the units, in all."""

_PAIRS: Final = 4096
"""Pairs of lists that are kept ready."""


@dataclass(frozen=True)
class Pairs:
    """Steps between two lists that cost less than a jump.

    Parameters
    ----------
    before, after : (k,) int32
        Places in the two lists.
    step : (k,) int32
        Difference of frame numbers.
    visual : (k,) float64
        f, divided by `SearchSpace.scale`, as all in this file.
    """

    before: UnitArray
    after: UnitArray
    step: UnitArray
    visual: FloatArray

    @classmethod
    def none(cls) -> Pairs:
        """No step."""
        nothing = np.zeros(0, dtype=np.int32)
        return cls(nothing, nothing, nothing, np.zeros(0))


@dataclass(frozen=True)
class CandidateList:
    """A list of candidates made ready.

    Parameters
    ----------
    serial : int
        Its own number.
    units : (n,) int32
        The candidates.
    rows : (n * width,) float32
        Features, a row a candidate, in the order of `_layout`.
    columns : (stride * width,) float32
        The same in tiles of `LANES` candidates, ``stride`` the next multiple: the first feature of
        all of the tile, the second, and so on.
    centre : (width,) float32
        Middle of the features, and `radius` the greatest distance from it.
    near : (r, stride) float64
        f of each candidate and the one that stands d places and d frames before it, in row d - 1;
        infinite where there is none.
    pairs : Pairs
        The other steps inside the list that cost less than a jump.
    """

    serial: int
    units: UnitArray
    rows: SingleArray
    columns: SingleArray
    centre: SingleArray
    radius: float
    near: FloatArray
    pairs: Pairs

    def __len__(self) -> int:
        return len(self.units)

    @property
    def width(self) -> int:
        """Features of a candidate, with those of zeros that fill them up."""
        return len(self.centre)


@dataclass(frozen=True)
class SearchSpace:
    """All that a step between two units costs, before weights.

    Parameters
    ----------
    sequence, frame : (N,) int
        Sequence of each unit and its recorded frame number. A sequence's units stand one after
        another, in the order of their frames.
    features : (N, G) float32
        Scaled features (`database.cost_definition.visual_features`).
    groups : (n_groups + 1,) int64
        Where each group of features starts; f is the sum of the groups' Euclidean distances.
    skip : (p + 1,) float64
        g by difference of frame numbers (`database.cost_definition.skip_costs`).

    Raises
    ------
    SelectionError
        If the sizes do not fit, the units are out of order, or a feature or skip cost cannot be
        used.
    """

    sequence: npt.NDArray[np.int32]
    frame: npt.NDArray[np.int32]
    features: npt.NDArray[np.float32]
    groups: IntArray
    skip: FloatArray
    _ready: _Ready = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        sequence = np.ascontiguousarray(self.sequence, dtype=np.int32)
        frame = np.ascontiguousarray(self.frame, dtype=np.int32)
        features = np.ascontiguousarray(self.features, dtype=np.float32)
        skip = np.ascontiguousarray(self.skip, dtype=np.float64)
        n = len(sequence)
        if n == 0:
            raise SelectionError("database: holds no unit to select from")
        if frame.shape != (n,) or features.ndim != 2 or len(features) != n:
            raise SelectionError("database: sequences, frames and features differ in number")
        if not np.isfinite(features).all():
            bad = int(np.argmin(np.isfinite(features).all(axis=1)))
            raise SelectionError(
                f"database: features of unit {bad} are not finite; build the database again"
            )
        new = np.flatnonzero(np.diff(sequence) != 0) + 1
        runs = sequence[np.concatenate([[0], new])]
        falling = (np.diff(frame) <= 0) & (np.diff(sequence) == 0)
        if len(np.unique(runs)) != len(runs) or falling.any():
            raise SelectionError(
                "database: units are not in the order of their sequences and frames; "
                "build the database again"
            )
        if skip.ndim != 1 or len(skip) < 2 or not np.isfinite(skip).all() or (skip < 0).any():
            raise SelectionError("search: skip costs must be 2 or more finite numbers, not below 0")
        if skip.max() > skip[-1]:
            raise SelectionError("search: the last skip cost must be the greatest")
        for name, value in (
            ("sequence", sequence),
            ("frame", frame),
            ("features", features),
            ("groups", np.ascontiguousarray(self.groups, dtype=np.int64)),
            ("skip", skip),
            ("_ready", _Ready()),
        ):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.sequence)

    def __getstate__(self) -> dict[str, Any]:
        """Everything but what is kept ready: another process makes that anew."""
        return {**self.__dict__, "_ready": _Ready()}

    def visual_costs(self, first: IntArray, second: IntArray) -> FloatArray:
        """Visual cost f of pairs of units, float64 of their shape (equation 7)."""
        total = np.zeros(np.shape(first))
        for start, end in zip(self.groups[:-1], self.groups[1:], strict=True):
            a = self.features[first, start:end].astype(np.float64)
            b = self.features[second, start:end].astype(np.float64)
            total += np.linalg.norm(a - b, axis=-1)
        return total

    def skip_costs(self, before: IntArray, after: IntArray) -> FloatArray:
        """Skip cost g of steps from `before` to `after`, float64 of their shape (equation 8)."""
        p = len(self.skip) - 1
        step = self.frame[after].astype(np.int64) - self.frame[before]
        near = (self.sequence[after] == self.sequence[before]) & (step >= 0) & (step < p)
        return self.skip[np.where(near, step, p)]

    @property
    def ends(self) -> IntArray:
        """Where each long group of a candidate list's features ends (see `_layout`)."""
        return self._layout().ends

    @property
    def scale(self) -> float:
        """A candidate list's features times this are those of the space: a power of 2."""
        return self._layout().scale

    def candidate_list(self, candidates: npt.NDArray[np.integer], frame: int) -> CandidateList:
        """Make a list of candidates ready, or find it ready.

        Parameters
        ----------
        candidates : (n,) int
            Units, ascending, each once.
        frame : int
            Where it is used, for the message of the error.

        Raises
        ------
        SelectionError
            If the list is empty, out of order, or names a unit that does not exist.
        """
        units = np.ascontiguousarray(candidates, dtype=np.int32)
        if units.ndim != 1 or units.size == 0:
            raise SelectionError(f"search: frame {frame} has no candidate")
        key = units.tobytes()
        found = self._ready.lists.get(key)
        if found is None:
            if units[0] < 0 or units[-1] >= len(self) or (np.diff(units) <= 0).any():
                raise SelectionError(
                    f"search: candidates of frame {frame} must ascend, each once, "
                    f"within 0..{len(self) - 1}"
                )
            found = self._make_list(units.copy())
            lists = self._ready.lists
            lists[key] = found
            while len(lists) > 1 and sum(map(len, list(lists.values()))) > _KEPT * len(self):
                _forget(lists)
        return found

    def single(self, unit: int) -> CandidateList:
        """Make a list of one unit ready, which is not kept."""
        return self._make_list(np.array([unit], dtype=np.int32))

    @property
    def width(self) -> int:
        """Features of a candidate in a list (see `CandidateList`)."""
        return self._layout().width

    def pairs(self, before: CandidateList, after: CandidateList) -> Pairs:
        """Steps from one list to another that cost less than a jump."""
        key = (before.serial, after.serial)
        found = self._ready.pairs.get(key)
        if found is None:
            found = self._find_pairs(before, after)
            self._ready.pairs[key] = found
            while len(self._ready.pairs) > _PAIRS:
                _forget(self._ready.pairs)
        return found

    def _find_pairs(self, before: CandidateList, after: CandidateList) -> Pairs:
        p = len(self.skip) - 1
        return Pairs(
            *find_pairs(
                before.units, before.rows, after.units, after.rows,
                self.sequence, self.frame, p, self.ends,
            )
        )  # fmt: skip

    def _layout(self) -> _Layout:
        if self._ready.layout is None:
            self._ready.layout = _layout(self.features, self.groups)
        return self._ready.layout

    def _make_list(self, units: UnitArray) -> CandidateList:
        layout = self._layout()
        n = len(units)
        stride = -(-n // LANES) * LANES
        features = np.zeros((n, layout.width), dtype=np.float32)
        used = layout.order >= 0
        features[:, used] = self.features[units][:, layout.order[used]] / np.float32(layout.scale)
        padded = np.zeros((stride, layout.width), dtype=np.float32)
        padded[:n] = features
        tiles = padded.reshape(-1, LANES, layout.width).transpose(0, 2, 1)
        centre = features.mean(axis=0, dtype=np.float64).astype(np.float32)
        rows = features.ravel()
        # A little more, so that rounding leaves nobody outside.
        radius = float(distances(rows, centre, layout.ends).max()) * (1 + 1e-9)
        reach = min(len(self.skip) - 2, REACH)
        near = np.full((reach, stride), np.inf)
        bare = CandidateList(
            next(_SERIALS), units, rows, np.ascontiguousarray(tiles).ravel(), centre, radius, near,
            Pairs.none(),
        )  # fmt: skip
        steps = self._find_pairs(bare, bare)
        shift = steps.after - steps.before
        plain = (shift == steps.step) & (shift >= 1) & (shift <= reach)
        near[steps.step[plain] - 1, steps.after[plain]] = steps.visual[plain]
        rest = ~plain & (shift >= 1)
        return CandidateList(
            bare.serial, units, rows, bare.columns, centre, radius, near,
            Pairs(steps.before[rest], steps.after[rest], steps.step[rest], steps.visual[rest]),
        )  # fmt: skip


@dataclass(frozen=True)
class _Layout:
    """Order of features in a candidate list.

    Parameters
    ----------
    order : (width,) int64
        Column of the space's features, -1 for one of zeros: two groups of one feature, a group of
        up to four, then the other groups, each filled up to a multiple of four.
    ends : (k,) int64
        Where each of the other groups ends.
    scale : float
        Features are divided by it, a power of 2, so that no square overflows.
    """

    order: IntArray
    ends: IntArray
    scale: float

    @property
    def width(self) -> int:
        return len(self.order)


@dataclass
class _Ready:
    """What has been made ready for a space; the oldest is forgotten first."""

    layout: _Layout | None = None
    lists: OrderedDict[bytes, CandidateList] = field(default_factory=OrderedDict)
    pairs: OrderedDict[tuple[int, int], Pairs] = field(default_factory=OrderedDict)


_SERIALS = itertools.count()


def _forget(store: OrderedDict[Any, Any]) -> None:
    """Drop the oldest, if another thread has not."""
    with contextlib.suppress(KeyError):
        store.popitem(last=False)


def _layout(features: SingleArray, groups: IntArray) -> _Layout:
    spans = [list(range(a, b)) for a, b in itertools.pairwise(groups.tolist()) if b > a]
    singles = [s for s in spans if len(s) == 1][:2]
    others = [s for s in spans if s not in singles]
    small = next((s for s in others if len(s) <= 4), [])
    order = [s[0] for s in singles]
    order += [-1] * (2 - len(order)) + small + [-1] * (4 - len(small))
    ends = []
    for span in others:
        if span is not small:
            order += span + [-1] * (-len(span) % 4)
            ends.append(len(order))
    largest = float(np.abs(features).max()) if features.size else 0.0
    scale = float(2.0 ** np.floor(np.log2(largest))) if largest > 0 else 1.0
    return _Layout(np.array(order), np.array(ends, dtype=np.int64), scale)
