"""How units are selected: weights, constants of the costs, target cost, lips; and their file.

``weights.json`` holds all of it with what it means, and the database that it was trained on: the
scales of the costs belong to a database, so weights from another one mean something else.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Final

from database.cost_definition import CostSettings, FeatureWeights
from database.errors import SelectionError
from database.reader import UnitDatabase
from unitsel.costs import Weights
from unitsel.lip_targets import RestSettings

FORMAT: Final = "unitsel-weights"
VERSION: Final = 3
READ: Final = (2, 3)
"""Versions that are read. Files of version 2 say nothing of lips; the defaults hold there."""

TARGETS: Final = ("paper", "guided", "mixed", "sound")
"""Names of the target costs: the paper's (phonemes around a frame), the distance to a predicted
trajectory, both by weight, and both with a prediction that hears the sound as well."""

GUIDED_WEIGHTS: Final = Weights(visual=0.1, skip=0.04)
"""A predicted trajectory is smooth itself, so it needs less of a penalty for joins."""

MEANING: Final[dict[str, str]] = {
    "target": "wtc: of the target cost, in medians of random pairs of frames",
    "concatenation": "wcc: of both costs of a step, visual and skip",
    "visual": "wccf: of the visual cost f, in medians of random pairs inside a viseme",
    "skip": "wccg: of the skip cost g",
}


@dataclass(frozen=True)
class TargetSettings:
    """Which target cost is used.

    Parameters
    ----------
    name : str
        One of `TARGETS`.
    share : float
        Of the guided cost in the targets "mixed" and "sound", 0..1; the paper's has the rest.

    Raises
    ------
    SelectionError
        If the name is none of them or the share is out of range.
    """

    name: str = "mixed"
    share: float = 0.8

    def __post_init__(self) -> None:
        if self.name not in TARGETS:
            raise SelectionError(
                f"target cost: {self.name!r} is none of {', '.join(TARGETS)}; choose one"
            )
        share = self.share
        number = isinstance(share, int | float) and not isinstance(share, bool)
        if not number or not (math.isfinite(share) and 0 <= share <= 1):
            raise SelectionError(f"target cost: share must lie in 0..1, got {share!r}")

    @property
    def guided(self) -> float:
        """Share of the guided cost, 0..1."""
        return {"paper": 0.0, "guided": 1.0}.get(self.name, float(self.share))

    @property
    def guide(self) -> str | None:
        """The database's guide that is needed, None where none is."""
        if self.guided == 0:
            return None
        return "sound" if self.name == "sound" else "phonemes"


@dataclass(frozen=True)
class SelectionSettings:
    """All that decides a selection besides the database and the sentence.

    Parameters
    ----------
    weights : Weights
        The four weights of the path cost.
    costs : CostSettings
        Constants of the costs: beta1, beta3, p, context and the feature weights k_d.
    target : TargetSettings
        Which target cost.
    lips : RestSettings
        How lips are held to rest in silences and to closure in p, b and m.
    """

    weights: Weights = field(default_factory=lambda: GUIDED_WEIGHTS)
    costs: CostSettings = field(default_factory=CostSettings)
    target: TargetSettings = field(default_factory=TargetSettings)
    lips: RestSettings = field(default_factory=RestSettings)

    def as_json(self) -> dict[str, Any]:
        """The settings as JSON values; `from_json` reads them."""
        costs = {name: getattr(self.costs, name) for name in _COSTS}
        return {
            "weights": asdict(self.weights),
            "costs": {**costs, "features": asdict(self.costs.features)},
            "target": asdict(self.target),
            "lips": asdict(self.lips),
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any], where: str = "settings") -> SelectionSettings:
        """Read what `as_json` gives.

        Raises
        ------
        SelectionError
            If a part is missing or cannot be used.
        """
        parts = {
            "weights": {f.name for f in fields(Weights)},
            "costs": {*_COSTS, "features"},
            "target": {f.name for f in fields(TargetSettings)},
            "lips": {f.name for f in fields(RestSettings)},
        }
        if "lips" not in content:
            # Trained before there were such costs.
            content = {**content, "lips": asdict(RestSettings())}
        for part, names in parts.items():
            values = content.get(part)
            if not isinstance(values, dict) or set(values) != names:
                got = sorted(values) if isinstance(values, dict) else values
                raise SelectionError(
                    f"{where}: {part!r} must hold exactly {', '.join(sorted(names))}, got {got}"
                )
        try:
            costs = dict(content["costs"])
            features = costs.pop("features")
            if not isinstance(features, dict):
                raise SelectionError(f"'features' must hold one number a group, got {features!r}")
            return cls(
                Weights(**content["weights"]),
                CostSettings(**costs, features=FeatureWeights(**features)),
                TargetSettings(**content["target"]),
                RestSettings(**content["lips"]),
            )
        except SelectionError as e:
            raise SelectionError(f"{where}: {e}") from e
        except (TypeError, ValueError, OverflowError) as e:
            raise SelectionError(f"{where}: a value cannot be used ({e})") from e

    @classmethod
    def read(cls, path: str | Path, *, database: str | None = None) -> SelectionSettings:
        """Read a file written by `write`.

        Parameters
        ----------
        path : path
        database : str, optional
            Identity of the database that the settings are for
            (`database.fingerprint.identity`); a file that was trained on another is refused.

        Raises
        ------
        SelectionError
            If the file is missing, is not such a file, belongs to another database, or holds
            values that cannot be used.
        """
        path = Path(path)
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except OSError as e:
            raise SelectionError(f"{path}: cannot be read ({e.strerror or e})") from e
        except (ValueError, RecursionError) as e:
            raise SelectionError(f"{path}: is not a JSON file of weights ({e})") from e
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise SelectionError(f"{path}: is not a file of weights (format {FORMAT!r})")
        if content.get("version") not in READ:
            raise SelectionError(
                f"{path}: has version {content.get('version')!r}, this program reads versions "
                f"{READ[0]} to {READ[-1]}; train the weights again"
            )
        settings = cls.from_json(content, str(path))
        trained_on = content.get("database")
        if database is not None and trained_on is not None and trained_on != database:
            raise SelectionError(
                f"{path}: was trained on another database, whose costs have other scales; train "
                "on this one (unitsel train), or take 'database' out of the file to use it as it is"
            )
        return settings

    def write(
        self,
        path: str | Path,
        *,
        database: str | None = None,
        about: Mapping[str, Any] | None = None,
    ) -> None:
        """Write the settings as a JSON file that says what they mean.

        Parameters
        ----------
        path : path
            The file; it is replaced as a whole or not at all.
        database : str, optional
            Identity of the database that they were trained on; without it they go with any.
        about : mapping, optional
            Where they come from, as JSON values.

        Raises
        ------
        SelectionError
            If the file cannot be written.
        """
        path = Path(path)
        content = {
            "format": FORMAT,
            "version": VERSION,
            **self.as_json(),
            "meaning": MEANING,
            "database": database,
            "about": dict(about or {}),
        }
        text = json.dumps(content, indent=2, allow_nan=False) + "\n"
        try:
            handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
            try:
                with os.fdopen(handle, "w", encoding="utf-8") as f:
                    f.write(text)
                Path(name).chmod(0o644)
                Path(name).replace(path)
            except BaseException:
                Path(name).unlink(missing_ok=True)
                raise
        except OSError as e:
            raise SelectionError(f"{path}: cannot be written ({e.strerror or e})") from e


_COSTS: Final = ("beta1", "beta3", "p", "context")
"""Constants of the costs that selection uses; the others shape the database."""


def default_settings(database: UnitDatabase) -> SelectionSettings:
    """Settings of a database for which none are given.

    Its own where it carries some (`unitsel train --store`), else ours: the mixed target cost
    where the database holds a guide, the paper's where it does not.

    Raises
    ------
    SelectionError
        If what the database carries cannot be used.
    """
    if database.selection:
        return SelectionSettings.from_json(database.selection, f"{database.path}: its settings")
    return settings_for("mixed" if "phonemes" in database.guides else "paper")


def settings_for(target: str) -> SelectionSettings:
    """Our settings for a target cost, found on clips of GRID's `build` that were left out.

    Parameters
    ----------
    target : str
        One of `TARGETS`.
    """
    return SelectionSettings(
        Weights() if target == "paper" else GUIDED_WEIGHTS, target=TargetSettings(target)
    )
