"""The file of the sets that were tried: what a stop leaves of it, and whose it is."""

from __future__ import annotations

from pathlib import Path

import pytest

from database.errors import SelectionError
from unitsel.training.rehearsal import TrialMeasures
from unitsel.training.trials import TrialFile

RUN = {"database": "d", "seed": 3, "sentences": ["a 1", "b 2"]}
MEASURES = TrialMeasures(0.1, 7.25, 1 / 3, 0.9, 0.8, 1.01, (0.8, 0.9))


def written(path: Path, sets: int = 3) -> bytes:
    with TrialFile(path, RUN) as file:
        for i in range(sets):
            file.add((i / 10, -1.0), MEASURES)
    return path.read_bytes()


def test_numbers_survive_the_file(tmp_path: Path) -> None:
    written(tmp_path / "state")
    with TrialFile(tmp_path / "state", RUN, resume=True) as file:
        assert file.known == dict.fromkeys([(0.0, -1.0), (0.1, -1.0), (0.2, -1.0)], MEASURES)


def test_what_a_kill_left_half_written_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "state"
    whole = written(path)
    last = whole[:-1].rfind(b"\n") + 1
    for end in (last, last + 1, last + 20, len(whole) - 1):
        path.write_bytes(whole[:end])
        with TrialFile(path, RUN, resume=True) as file:
            assert list(file.known) == [(0.0, -1.0), (0.1, -1.0)]
            file.add((0.2, -1.0), MEASURES)
        assert path.read_bytes() == whole
    # Killed while the first line was written, and before.
    for end in (0, 10):
        path.write_bytes(whole[:end])
        with TrialFile(path, RUN, resume=True) as file:
            assert file.known == {}
        assert path.read_bytes() == whole[: whole.find(b"\n") + 1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 4}, "with another seed;"),
        ({"sentences": ["a 1"]}, "with another sentences;"),
        ({"database": "e", "seed": 4}, "with another database, another seed;"),
        ({"more": 1}, "with another more;"),
    ],
)
def test_the_state_of_another_run_is_refused(
    tmp_path: Path, change: dict[str, object], words: str
) -> None:
    path = tmp_path / "state"
    whole = written(path)
    with pytest.raises(SelectionError, match=words) as error:
        TrialFile(path, RUN | change, resume=True)
    assert str(path) in str(error.value) and "leave out --resume" in str(error.value)
    assert path.read_bytes() == whole
    # The remedy that it names.
    with TrialFile(path, RUN | change) as file:
        assert file.known == {}
    with TrialFile(path, RUN | change, resume=True) as file:
        assert file.known == {}


@pytest.mark.parametrize(
    "line",
    [b"{}", b"null", b"nonsense", b'{"set": [1, 2], "measures": {}}', b'{"set": 1, "measures": 1}'],
)
def test_a_damaged_state_is_refused(tmp_path: Path, line: bytes) -> None:
    path = tmp_path / "state"
    lines = written(path).splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:2], line + b"\n", *lines[3:]]))
    with pytest.raises(SelectionError, match=r"state, line 3: is damaged; leave out --resume"):
        TrialFile(path, RUN, resume=True)
    path.write_bytes(line + b"\n")
    with pytest.raises(SelectionError, match=r"state, line 1: is damaged; leave out --resume"):
        TrialFile(path, RUN, resume=True)


def test_two_runs_do_not_write_one_state(tmp_path: Path) -> None:
    path = tmp_path / "state"
    with TrialFile(path, RUN) as file:
        file.add((0.0, 1.0), MEASURES)
        with pytest.raises(SelectionError, match="another training is writing it"):
            TrialFile(path, RUN)
    with TrialFile(path, RUN, resume=True) as file:
        assert len(file.known) == 1


def test_a_state_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(SelectionError, match="cannot be written"):
        TrialFile(tmp_path / "no" / "state", RUN)
    with pytest.raises(SelectionError, match="cannot be written"):
        TrialFile(tmp_path, RUN)
