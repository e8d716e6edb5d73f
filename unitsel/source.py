"""A database as the selection sees it: everything that no sentence and no weight changes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from database.cost_definition import CostSettings, context_weights, skip_costs, visual_features
from database.errors import SelectionError
from database.phonemes import N_PHONEMES, N_VISEMES, VISEME_OF
from database.schema import (
    CostModel,
    GuideModel,
    PhoneMarks,
    Phones,
    Sequences,
    TextureModel,
    Units,
)
from database.track import context_frames
from unitsel.guide import Guide, guide_scale
from unitsel.lip_targets import Lips
from unitsel.search import SearchSpace
from unitsel.target_runs import RunTargets

KEPT_LISTS: Final = 3
"""Ways to leave sequences out whose lists of candidates are kept."""

FloatArray = npt.NDArray[np.float64]


class UnitSource(Protocol):
    """What selection needs of a database (`database.reader.UnitDatabase` is one)."""

    @property
    def fps(self) -> float:
        """Frame rate, 1/s."""

    @property
    def units(self) -> Units:
        """Parameters of the N units."""

    @property
    def sequences(self) -> Sequences:
        """The S clips."""

    @property
    def texture(self) -> TextureModel:
        """The PCA, for its eigenvalues."""

    @property
    def costs(self) -> CostModel:
        """M and the scales."""

    @property
    def phones(self) -> Phones:
        """The phones of all sequences."""

    @property
    def marks(self) -> PhoneMarks:
        """Closures and rests that were found in sound and lips."""

    @property
    def guides(self) -> tuple[str, ...]:
        """Names of the guides that there are."""

    def guide(self, kind: str) -> GuideModel:
        """One of them."""

    def context(self, n: int) -> npt.NDArray[np.uint8]:
        """(N, 2n + 1) uint8: phonemes around each unit in its own sequence."""


@dataclass(frozen=True)
class SelectionInput:
    """What selection reads of a database, checked and scaled.

    Parameters
    ----------
    fps : float
        Frame rate of the database, 1/s.
    phoneme : (N,) uint8
        Of each unit.
    contexts : (N, 2n + 1) uint8
        Phonemes around each unit, with n = `context_frames` (fps, costs.context).
    space : SearchSpace
        What steps between units cost.
    phoneme_distance : (43, 43) float32
        M.
    target_scale : float
        Target costs are divided by it.
    context_weights : (2n + 1,) float64
        v, of sum 1.
    names : tuple of str
        Name of each sequence.
    lips : Lips
        How open each unit's lips are, and how far from rest.
    costs : CostSettings
        Constants of the costs that all this was prepared with.
    guides : dict of str to Guide
        What the guided target cost can go by.
    guide_scale : float
        Guided costs are divided by it.

    Raises
    ------
    SelectionError
        If there is no unit, or an array does not fit or is not finite.
    """

    fps: float
    phoneme: npt.NDArray[np.uint8]
    contexts: npt.NDArray[np.uint8]
    space: SearchSpace
    phoneme_distance: npt.NDArray[np.float32]
    target_scale: float
    context_weights: FloatArray
    names: tuple[str, ...]
    lips: Lips
    costs: CostSettings = field(default_factory=CostSettings)
    guides: Mapping[str, Guide] = field(default_factory=dict)
    guide_scale: float = 1.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise SelectionError(f"database: frame rate must be positive, got {self.fps!r}")
        n = len(self.space)
        width = 2 * context_frames(self.fps, self.costs.context) + 1
        shapes = (
            ("phonemes", self.phoneme.shape, (n,)),
            ("contexts", self.contexts.shape, (n, width)),
            ("context weights", self.context_weights.shape, (width,)),
            ("lip openings", self.lips.opening.shape, (n,)),
            ("phoneme distances", self.phoneme_distance.shape, (N_PHONEMES, N_PHONEMES)),
        )
        for name, got, wanted in shapes:
            if got != wanted:
                raise SelectionError(f"database: {name} have shape {got}, not {wanted}")
        if max(self.phoneme.max(), self.contexts.max()) >= N_PHONEMES:
            raise SelectionError(f"database: a phoneme index is not below {N_PHONEMES}")
        if int(self.space.sequence.max()) >= len(self.names):
            raise SelectionError("database: a unit belongs to a sequence that has no name")
        if not np.isfinite(self.phoneme_distance).all() or not self.target_scale > 0:
            raise SelectionError("database: phoneme distances or their scale cannot be used")

    def __len__(self) -> int:
        return len(self.space)

    @property
    def viseme(self) -> npt.NDArray[np.uint8]:
        """(N,) uint8: viseme of each unit."""
        return VISEME_OF[self.phoneme]

    @classmethod
    def of(cls, source: UnitSource, settings: CostSettings | None = None) -> SelectionInput:
        """Prepare a database for selection.

        Parameters
        ----------
        source : UnitSource
            The database.
        settings : CostSettings, optional
            Constants of the costs.

        Raises
        ------
        SelectionError
            If the database holds no unit or cannot be searched.
        """
        settings = settings or CostSettings()
        units, costs = source.units, source.costs
        if len(units) == 0:
            raise SelectionError("database: holds no unit to select from")
        scales = np.append(costs.feature_scales, costs.visual_scale)
        if scales.shape != (5,) or not (np.isfinite(scales).all() and (scales > 0).all()):
            raise SelectionError("database: scales of the visual cost must be 5 positive numbers")
        n = context_frames(source.fps, settings.context)
        features, groups = visual_features(
            units, source.texture.eigenvalues, costs, settings.features
        )
        return cls(
            fps=float(source.fps),
            phoneme=np.asarray(units.phoneme),
            contexts=np.ascontiguousarray(source.context(n), dtype=np.uint8),
            space=SearchSpace(
                units.sequence,
                units.frame,
                features,
                groups,
                skip_costs(settings.beta3, settings.p),
            ),
            phoneme_distance=np.asarray(costs.phoneme_distance),
            target_scale=float(costs.target_scale),
            context_weights=context_weights(n, source.fps, settings.beta1),
            names=tuple(source.sequences.name),
            lips=Lips.of(source),
            costs=settings,
            guides={
                kind: Guide(
                    source.guide(kind), source.texture.eigenvalues, costs, settings.features
                )
                for kind in source.guides
            },
            guide_scale=guide_scale(features, groups) if source.guides else 1.0,
        )

    @cached_property
    def run_targets(self) -> RunTargets:
        """The paper's target costs, by runs of equal phonemes."""
        return RunTargets(self.contexts, self.phoneme_distance, self.context_weights)

    def candidates(self, exclude: Collection[int] = ()) -> tuple[npt.NDArray[np.int32], ...]:
        """Units of each viseme, ascending, without those of some sequences.

        The same sequences give the same arrays for a while, so that what the search and the
        target costs work out for a list serves the next sentence.
        """
        left_out = frozenset(int(s) for s in exclude)
        kept = self._candidates
        if left_out not in kept:
            allowed = ~np.isin(self.space.sequence, list(left_out))
            kept[left_out] = tuple(
                np.flatnonzero((self.viseme == v) & allowed).astype(np.int32)
                for v in range(N_VISEMES)
            )
            if len(kept) > KEPT_LISTS:
                del kept[next(iter(kept))]
        return kept[left_out]

    @cached_property
    def _candidates(self) -> dict[frozenset[int], tuple[npt.NDArray[np.int32], ...]]:
        return {}

    def with_guides(self, models: Mapping[str, GuideModel]) -> SelectionInput:
        """The same database with other guides in the place of those of the same names."""
        replaced = {
            kind: replace(guide, model=models[kind])
            for kind, guide in self.guides.items()
            if kind in models
        }
        return replace(self, guides={**self.guides, **replaced})
