"""What ``import unitsel`` offers, and that the commands offer the same."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
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


def test_what_type_checkers_read_is_what_is_loaded() -> None:
    tree = ast.parse(Path(unitsel.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    read = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert read == unitsel._MODULE_OF
    assert {*read, "__version__"} == set(unitsel.__all__) <= set(dir(unitsel))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        unitsel.nothing  # noqa: B018


def test_a_command_loads_only_what_it_needs() -> None:
    """Each process of a build loads the package again."""
    code = "import sys, unitsel.cli; unitsel.cli.main(sys.argv[1:]); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code, "build", "nowhere", "-o", "x.h5"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert "nowhere" in done.stderr
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert "numba" in loaded
    assert not loaded & {"matplotlib", "pymoo", "moderngl", "sklearn", "render"}


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
    names = list(COMMANDS)
    assert names == [
        *(
            "build",
            "merge",
            "portrait",
            "say",
            "dub",
            "synth",
            "backgrounds",
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
    # A name alone is said with the same words as the command that is loaded.
    assert parser(()).format_help() == parser().format_help()


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["--version"])
    assert left.value.code == 0
    assert capsys.readouterr().out.strip() == f"unitsel {unitsel.__version__}"
