"""Interlaced footage: told from progressive, and made progressive, by FFmpeg's filters.

What the file says is a hint only: progressive pictures are often sold as interlaced, and fields
woven together lose their flag when they are encoded again. So pictures that may be interlaced
are looked at (filter ``idet``); flags decide where nothing moves. Each frame gives one frame
(filter ``bwdif``), at the time of its first field.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, Literal

import av
from av.filter import Graph

Fields = Literal["none", "auto", "tff", "bff"]
"""``none``: progressive; else which field comes first, ``auto`` as each frame says."""

WOVEN_LINES: Final = (480, 486, 576, 1080, 1088)
"""Lines of interlaced formats; pictures with others are interlaced only if they say so."""

FASTEST: Final = 30.5
"""Frames a second; interlaced formats have at most 30."""

ENOUGH: Final = 5
"""Frames that must be told one way or the other before flags do not count."""


def may_be_interlaced(height: int, fps: float, flagged: bool) -> bool:
    """Whether it is worth looking at the pictures."""
    return flagged or (height in WOVEN_LINES and fps <= FASTEST)


def find_fields(stretches: Iterable[Iterable[av.VideoFrame]]) -> Fields:
    """Tell interlaced from progressive by what moves.

    Parameters
    ----------
    stretches : iterable of iterables of av.VideoFrame
        Decoded frames, consecutive within a stretch.

    Returns
    -------
    str
        See `Fields`.
    """
    counts = {"tff": 0, "bff": 0, "progressive": 0, "undetermined": 0}
    flagged = total = 0
    for stretch in stretches:
        for frame in filtered(stretch, "idet"):
            total += 1
            flagged += frame.interlaced_frame
            found = dict(frame.metadata).get("lavfi.idet.multiple.current_frame", "undetermined")
            counts[found] = counts.get(found, 0) + 1
    woven = counts["tff"] + counts["bff"]
    if woven + counts["progressive"] >= ENOUGH:
        if woven <= counts["progressive"]:
            return "none"
        return "tff" if counts["tff"] >= counts["bff"] else "bff"
    return "auto" if 2 * flagged > total else "none"


def deinterlaced(frames: Iterable[av.VideoFrame], fields: Fields) -> Iterator[av.VideoFrame]:
    """Frames made progressive; unchanged where `fields` is ``none``."""
    if fields == "none":
        yield from frames
    else:
        yield from filtered(frames, "bwdif", f"mode=send_frame:parity={fields}:deint=all")


def filtered(
    frames: Iterable[av.VideoFrame], name: str, options: str | None = None
) -> Iterator[av.VideoFrame]:
    """Frames through one of FFmpeg's filters; the filter starts anew where their kind changes."""
    graph: Graph | None = None
    kind: tuple[int, int, str] | None = None
    for frame in frames:
        own = (frame.width, frame.height, frame.format.name)
        if graph is None or own != kind:
            if graph is not None:
                graph.push(None)
                yield from _pulled(graph)
            graph, kind = _graph(frame, name, options), own
        graph.push(frame)
        yield from _pulled(graph)
    if graph is not None:
        graph.push(None)
        yield from _pulled(graph)


def _graph(frame: av.VideoFrame, name: str, options: str | None) -> Graph:
    graph = Graph()
    source = graph.add_buffer(
        width=frame.width,
        height=frame.height,
        format=frame.format,
        time_base=frame.time_base,
    )
    middle = graph.add(name, options)
    source.link_to(middle)
    middle.link_to(graph.add("buffersink"))
    graph.configure()
    return graph


def _pulled(graph: Graph) -> Iterator[av.VideoFrame]:
    while True:
        try:
            frame = graph.pull()
        except (av.BlockingIOError, av.EOFError):
            return
        if isinstance(frame, av.VideoFrame):
            yield frame
