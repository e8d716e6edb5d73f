"""What ``import unitsel`` offers, and that the commands offer the same."""

from __future__ import annotations

import inspect
from pathlib import Path
from types import ModuleType

import pytest

import unitsel
from database.media import probe
from database.track import frame_count
from unitsel.cli import COMMANDS, main, parser


def test_everything_that_is_offered_is_there_and_documented() -> None:
    assert len(set(unitsel.__all__)) == len(unitsel.__all__)
    for name in unitsel.__all__:
        thing = getattr(unitsel, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            assert (thing.__doc__ or "").strip(), name


def test_errors_are_one_family() -> None:
    errors = [getattr(unitsel, n) for n in unitsel.__all__ if n.endswith("Error")]
    assert len(errors) >= 12
    assert all(issubclass(e, unitsel.UnitselError) for e in errors)


def test_the_package_s_example_runs(
    puppet_corpus: Path, puppet_db: Path, puppet: ModuleType, tmp_path: Path
) -> None:
    """The lines of the package's docstring, the build aside."""
    timing = tmp_path / "hello.TextGrid"
    track, words = puppet.even_track("place white please", 0.1, 0.5)
    unitsel.write_timing(timing, unitsel.Timing(track, words))
    with unitsel.open_database(puppet_db) as database:
        synthesizer = unitsel.Synthesizer(database)
        phones = unitsel.read_timing(timing).phones
        assert phones is not None
        selection = synthesizer.select(phones)
        written = synthesizer.write(
            selection, tmp_path / "hello.mp4", audio=puppet_corpus / "hopper1.mp4"
        )
    assert written.frames == frame_count(phones.end, 25)
    assert probe(tmp_path / "hello.mp4").has_sound


def test_a_track_made_by_hand_and_sound_in_memory(
    puppet_db: Path, puppet: ModuleType, tmp_path: Path
) -> None:
    track = unitsel.PhonemeTrack.from_intervals(
        [
            unitsel.Interval(0.0, 0.1, "sil"),
            unitsel.Interval(0.1, 0.3, "aw"),
            unitsel.Interval(0.3, 0.5, "sil"),
        ]
    )
    with unitsel.open_database(puppet_db) as database:
        synthesizer = unitsel.Synthesizer(database, unitsel.Weights(skip=0.5))
        written = synthesizer.write(
            synthesizer.select(track), tmp_path / "o.mp4", audio=puppet.hum(track)
        )
    assert written.seconds == pytest.approx(0.5, abs=0.03)
    assert probe(tmp_path / "o.mp4").has_sound


def test_every_command_has_help_and_json(capsys: pytest.CaptureFixture[str]) -> None:
    names = [c.__name__.rpartition(".")[2] for c in COMMANDS]
    assert names == [
        *(
            "build",
            "merge",
            "portrait",
            "say",
            "dub",
            "synth",
            "align",
            "inspect",
            "doctor",
            "evaluate",
            "train",
        ),
    ]
    for name in names:
        with pytest.raises(SystemExit) as left:
            main([name, "--help"])
        assert left.value.code == 0
        out = capsys.readouterr().out
        assert out.startswith(f"usage: unitsel {name}") and "--json" in out
    assert parser().prog == "unitsel"


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["--version"])
    assert left.value.code == 0
    assert capsys.readouterr().out.strip() == f"unitsel {unitsel.__version__}"
