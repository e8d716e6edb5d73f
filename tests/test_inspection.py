"""What a database holds, counted from the made-up database's own arrays."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from database.phonemes import PHONEMES, VISEMES
from database.reader import UnitDatabase, open_database
from unitsel.inspection import extreme_units, inspect_database, typical_units


@pytest.fixture
def database(small_db: Path) -> Iterator[UnitDatabase]:
    with open_database(small_db) as opened:
        yield opened


def test_counts_are_those_of_the_units(database: UnitDatabase, makedb: ModuleType) -> None:
    found = inspect_database(database)
    assert found.units == sum(found.phonemes.values()) == sum(found.visemes.values())
    assert list(found.phonemes) == list(PHONEMES)
    assert len(found.visemes) == len(VISEMES) == 22
    assert set(makedb.LACKING) <= set(found.missing_phonemes)
    assert all(found.phonemes[p] == 0 for p in found.missing_phonemes)
    assert all(found.phonemes[p] > 0 for p in PHONEMES if p not in found.missing_phonemes)
    assert found.sequences == len(found.clips) == 6
    assert sum(c["units"] for c in found.clips) == found.units
    assert found.units == 6 * 75 - len(makedb.MISSING)
    assert found.seconds == pytest.approx(found.units / 25)
    assert found.crop == (40, 42)


def test_ranges_hold_the_parameters(database: UnitDatabase) -> None:
    found = inspect_database(database)
    for low, middle, high in found.ranges.values():
        assert low <= middle <= high
    heights = database.units.mouth_height
    assert found.ranges["mouth_height"][1] == pytest.approx(float(np.median(heights)), abs=1e-3)
    assert found.ranges["place_z"][1] == pytest.approx(900, abs=60)


def test_the_document_is_json(database: UnitDatabase) -> None:
    document = inspect_database(database).as_json()
    assert json.loads(json.dumps(document, allow_nan=False)) == document


def test_typical_mouths_are_of_their_viseme(database: UnitDatabase) -> None:
    found = typical_units(database)
    assert set(found) == set(database.units.viseme.tolist())
    for viseme, unit in found.items():
        assert database.units.viseme[unit] == viseme
        mine = database.units.pca[database.units.viseme == viseme]
        distance = np.linalg.norm(mine - mine.mean(axis=0), axis=1)
        own = np.linalg.norm(database.units.pca[unit] - mine.mean(axis=0))
        assert own == pytest.approx(distance.min(), rel=1e-5)


def test_extreme_mouths_lie_at_the_ends(database: UnitDatabase) -> None:
    found = extreme_units(database)
    heights = database.units.mouth_height
    low, high = heights[found["least mouth height"]], heights[found["most mouth height"]]
    assert (heights < low).mean() <= 0.011
    assert (heights > high).mean() <= 0.011
    assert low < np.median(heights) < high
