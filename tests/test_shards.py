"""A kept clip's file: what is written comes back, and nothing damaged is taken for it."""

import random

import numpy as np
import pytest

from analysis.corpus import Clip
from analysis.shards import (
    OpenShard,
    Refusal,
    ShardDamagedError,
    load_shard,
    read_checked,
    write_arrays,
    write_refusal,
)


@pytest.fixture
def clip(tmp_path):
    return Clip("hello", tmp_path / "hello.mp4", (tmp_path / "hello.txt",))


def test_arrays_and_documents_come_back_as_they_were(tmp_path):
    values = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    text = np.frombuffer(b"pictures", np.uint8)
    write_arrays(tmp_path / "a.shard", {"words": "día", "time": 0.1}, values=values, text=text)
    shard = read_checked(tmp_path / "a.shard")
    assert shard is not None
    assert shard.about == {"words": "día", "time": 0.1}
    np.testing.assert_array_equal(shard["values"], values)
    assert shard["values"].dtype == np.float32 and shard["text"].tobytes() == b"pictures"
    assert [p.name for p in tmp_path.iterdir()] == ["a.shard"]


def test_the_same_content_is_the_same_file(tmp_path):
    for name in ("a", "b"):
        write_arrays(tmp_path / name, {"words": "x"}, values=np.arange(9.0))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_no_shard_is_none(tmp_path, clip):
    assert read_checked(tmp_path / "no.shard") is None
    assert load_shard(tmp_path / "no.shard", clip) is None


def test_any_flipped_bit_and_any_cut_is_found(tmp_path):
    path = tmp_path / "a.shard"
    write_arrays(path, {"words": "x"}, values=np.arange(500.0))
    whole = path.read_bytes()
    rng = random.Random(1)
    for _ in range(300):
        data = bytearray(whole)
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(data)
        with pytest.raises(ShardDamagedError, match=r"a\.shard: is damaged"):
            read_checked(path)
    for length in (0, 5, 16, 47, 48, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(ShardDamagedError):
            read_checked(path)


def test_damage_after_the_check_is_told_in_one_line(tmp_path):
    path = tmp_path / "a.shard"
    write_arrays(path, {}, values=np.arange(5000.0))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 16
    path.write_bytes(data)
    with pytest.raises(ShardDamagedError, match="build again") as caught:
        OpenShard(path)["values"]
    assert "\n" not in str(caught.value)
    path.unlink()
    with pytest.raises(ShardDamagedError, match="build again"):
        OpenShard(path)["values"]


def test_a_refusal_is_kept_until_the_files_it_names_lie_elsewhere(tmp_path, clip):
    path = tmp_path / "a.shard"
    write_refusal(path, clip, f"{clip.media}: shows no face")
    assert load_shard(path, clip) == Refusal(f"{clip.media}: shows no face")
    moved = Clip("hello", tmp_path / "other" / "hello.mp4", clip.scripts)
    assert load_shard(path, moved) is None
    write_refusal(path, clip, "names nothing")
    assert load_shard(path, moved) == Refusal("names nothing")
