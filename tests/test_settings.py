"""Settings of the selection, and their file: what is written is what is read, all else is said."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from database.cost_definition import CostSettings, FeatureWeights
from database.errors import DatabaseError, SelectionError
from database.fingerprint import content_hash, identity
from database.reader import open_database
from database.writer import store_selection
from unitsel.costs import Weights
from unitsel.lip_targets import RestSettings
from unitsel.settings import (
    TARGETS,
    SelectionSettings,
    TargetSettings,
    default_settings,
    settings_for,
)

SETTINGS = SelectionSettings(
    Weights(1.5, 2, 0.25, 0),
    CostSettings(beta1=-0.5, p=7, context=0.12, features=FeatureWeights(1, 2, 0, 0.25)),
    TargetSettings("guided", 0.5),
    RestSettings(rest=0.5, closure=0, after=0.05, before=0.3, closed=0.2),
)


def document(**changes: Any) -> dict[str, Any]:
    """Give the content of a good file, with changes."""
    return {
        "format": "unitsel-weights",
        "version": 3,
        **SelectionSettings().as_json(),
        "meaning": {},
        "database": None,
        "about": {},
        **changes,
    }


def changed(part: str, **changes: Any) -> dict[str, Any]:
    """Give a good file's content with values of one part changed."""
    return document(**{part: {**SelectionSettings().as_json()[part], **changes}})


def test_settings_survive_their_file(tmp_path: Path) -> None:
    path = tmp_path / "weights.json"
    SETTINGS.write(path, database="d1", about={"trained on": "30 sentences"})
    assert SelectionSettings.read(path) == SETTINGS
    assert SelectionSettings.read(path, database="d1") == SETTINGS
    content = json.loads(path.read_text())
    assert content["about"] == {"trained on": "30 sentences"}
    assert set(content["meaning"]) == set(content["weights"])
    assert [p.name for p in tmp_path.iterdir()] == ["weights.json"]
    assert path.stat().st_mode & 0o777 == 0o644


def test_constants_of_the_build_are_no_settings_of_the_selection() -> None:
    assert not {"beta2", "components"} & set(SETTINGS.as_json()["costs"])


def test_weights_of_another_database_are_refused_with_the_remedy(tmp_path: Path) -> None:
    path = tmp_path / "weights.json"
    SETTINGS.write(path, database="d1")
    with pytest.raises(SelectionError, match=r"weights\.json: was trained on another.*'database'"):
        SelectionSettings.read(path, database="d2")
    # The remedy that it names works.
    content = json.loads(path.read_text())
    del content["database"]
    path.write_text(json.dumps(content))
    assert SelectionSettings.read(path, database="d2") == SETTINGS


def test_a_file_from_before_there_were_costs_of_lips_has_the_usual_ones(tmp_path: Path) -> None:
    path = tmp_path / "weights.json"
    content = document(version=2)
    del content["lips"]
    path.write_text(json.dumps(content))
    assert SelectionSettings.read(path) == SelectionSettings()
    assert SelectionSettings.read(path).lips == RestSettings()


def test_weights_of_no_database_go_with_any(tmp_path: Path) -> None:
    SETTINGS.write(tmp_path / "weights.json")
    assert SelectionSettings.read(tmp_path / "weights.json", database="d2") == SETTINGS


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "is not a JSON file"),
        (b"\x00\xff\xfe", "is not a JSON file"),
        (b"[" * 100_000, "is not a JSON file"),
        (b"[1, 2]", "is not a file of weights"),
        (b"{}", "is not a file of weights"),
        (document(format="other"), "is not a file of weights"),
        (document(version=1), "has version 1.*train the weights again"),
        (document(version=4), "has version 4.*reads versions 2 to 3"),
        (document(weights=None), "'weights' must hold exactly concatenation, skip, target, visual"),
        (document(weights=[1, 1, 1, 1]), "'weights' must hold exactly"),
        (document(weights={"target": 1}), "'weights' must hold exactly"),
        (changed("weights", extra=1), "'weights' must hold exactly"),
        (changed("weights", skip=math.nan), "skip must be finite"),
        (changed("weights", skip=-1), "skip must be finite and 0 or more"),
        (changed("weights", skip=None), "skip must be a number"),
        (changed("weights", target=0, concatenation=0), "all 0"),
        (document(costs=None), "'costs' must hold exactly"),
        (changed("costs", beta2=0.1), "'costs' must hold exactly"),
        (changed("costs", beta1=math.inf), "beta1 must be finite"),
        (changed("costs", beta1="x"), "a value cannot be used"),
        (changed("costs", p=1), "p must be 2 or more"),
        (changed("costs", context=0), "context must lie above 0"),
        (changed("costs", features=3), "'features' must hold one number a group"),
        (changed("costs", features={"pca": 1, "ears": 1}), "a value cannot be used"),
        (changed("costs", features=dict.fromkeys(("pca", "lips"), -1)), "feature weights"),
        (document(target="paper"), "'target' must hold exactly name, share"),
        (changed("target", name="other"), f"none of {', '.join(TARGETS)}"),
        (changed("target", share=1.5), "share must lie in 0..1"),
        (changed("target", share=math.nan), "share must lie in 0..1"),
        (document(lips=3), "'lips' must hold exactly after, before, closed, closure, rest"),
        (changed("lips", rest=-1), "rest must be a finite number, 0 or more"),
        (changed("lips", closure=math.inf), "closure must be a finite number"),
        (changed("lips", before="x"), "before must be a finite number"),
        (changed("lips", closed=1.5), "closed must lie in 0..1"),
    ],
)
def test_a_bad_file_is_one_line_with_its_name(
    tmp_path: Path, content: bytes | dict[str, Any], word: str
) -> None:
    path = tmp_path / "weights.json"
    path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    with pytest.raises(SelectionError, match=word) as error:
        SelectionSettings.read(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_or_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(SelectionError, match=r"none\.json: cannot be read"):
        SelectionSettings.read(tmp_path / "none.json")
    with pytest.raises(SelectionError, match="cannot be read"):
        SelectionSettings.read(tmp_path)
    with pytest.raises(SelectionError, match="cannot be written"):
        SETTINGS.write(tmp_path / "no" / "weights.json")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "share", "guide"),
    [
        ("paper", 0.0, None),
        ("guided", 1.0, "phonemes"),
        ("mixed", 0.3, "phonemes"),
        ("sound", 0.3, "sound"),
    ],
)
def test_a_name_says_the_share_and_the_guide(name: str, share: float, guide: str | None) -> None:
    target = TargetSettings(name, 0.3)
    assert (target.guided, target.guide) == (share, guide)


def test_a_share_of_nothing_needs_no_guide() -> None:
    assert TargetSettings("mixed", 0.0).guide is None


@pytest.mark.parametrize("share", ["0.5", True, None, -0.1, 1.1, math.inf])
def test_shares_that_cannot_be_used(share: Any) -> None:
    with pytest.raises(SelectionError, match="share"):
        TargetSettings("mixed", share)


def test_a_database_carries_its_settings(small_db: Path, tmp_path: Path) -> None:
    path = tmp_path / "me.h5"
    path.write_bytes(small_db.read_bytes())
    with open_database(path) as database:
        before = identity(database)
        # Made up without a guide.
        assert default_settings(database) == settings_for("paper")
    store_selection(path, SETTINGS.as_json())
    with open_database(path) as database:
        assert default_settings(database) == SETTINGS
        assert identity(database) == before
    store_selection(path, {})
    with open_database(path) as database:
        assert default_settings(database) == settings_for("paper")
    assert [p.name for p in tmp_path.iterdir()] == ["me.h5"]


def test_settings_that_a_database_carries_and_that_cannot_be_used(
    small_db: Path, tmp_path: Path
) -> None:
    path = tmp_path / "me.h5"
    path.write_bytes(small_db.read_bytes())
    store_selection(path, {"weights": "heavy"})
    with (
        open_database(path) as database,
        pytest.raises(SelectionError, match=r"me\.h5: its settings: 'weights'"),
    ):
        default_settings(database)


def test_settings_cannot_be_stored_in_what_is_no_database(tmp_path: Path) -> None:
    path = tmp_path / "me.h5"
    path.write_bytes(b"no database")
    with pytest.raises(DatabaseError, match=r"me\.h5"):
        store_selection(path, SETTINGS.as_json())
    assert path.read_bytes() == b"no database"


def test_stored_settings_are_content(small_db: Path, tmp_path: Path) -> None:
    path = tmp_path / "me.h5"
    path.write_bytes(small_db.read_bytes())
    store_selection(path, SETTINGS.as_json())
    once = content_hash(path)
    store_selection(path, SETTINGS.as_json())
    assert content_hash(path) == once != content_hash(small_db)


@pytest.mark.parametrize("name", TARGETS)
def test_there_are_settings_for_every_target_cost(name: str) -> None:
    assert settings_for(name).target.name == name
