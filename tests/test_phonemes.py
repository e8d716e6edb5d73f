"""Table 1, as the paper prints it."""

import numpy as np
import pytest

from database.phonemes import (
    CLOSURES,
    N_PHONEMES,
    N_VISEMES,
    PHONEME_INDEX,
    PHONEMES,
    SILENCE,
    VISEME_OF,
    VISEMES,
)

PAPER = """
0 sil
1 ae ax ah
2 aa
3 ao
4 ey eh uh
5 er
6 iy y ih ix
7 w uw
8 ow
9 aw
10 oy
11 ay
12 h hh
13 r
14 l
15 s z
16 sh ch jh zh
17 th dh
18 f v
19 d t n
20 k g ng
21 p b m
"""


def test_there_are_43_phonemes_and_22_visemes() -> None:
    assert (N_PHONEMES, N_VISEMES) == (43, 22)
    assert len(set(PHONEMES)) == 43


def test_the_visemes_are_those_of_the_paper() -> None:
    rows = [line.split() for line in PAPER.split("\n") if line]
    assert [int(row[0]) for row in rows] == list(range(22))
    assert [tuple(row[1:]) for row in rows] == list(VISEMES)


def test_each_index_leads_to_its_name_and_viseme() -> None:
    for i, name in enumerate(PHONEMES):
        assert PHONEME_INDEX[name] == i
        assert name in VISEMES[VISEME_OF[i]]
    assert VISEME_OF.shape == (43,)
    assert set(VISEME_OF.tolist()) == set(range(22))


def test_silence_is_first_and_alone_in_its_viseme() -> None:
    assert PHONEMES[SILENCE] == "sil"
    assert SILENCE == 0
    assert np.flatnonzero(VISEME_OF == 0).tolist() == [0]


def test_closures_are_the_lips_viseme() -> None:
    assert {PHONEMES[p] for p in CLOSURES} == {"p", "b", "m"}
    assert {int(VISEME_OF[p]) for p in CLOSURES} == {21}


def test_the_table_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        VISEME_OF[0] = 1
