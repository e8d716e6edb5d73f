"""Praat TextGrid, long and short.

Praat reads both the same way, and so does this: free-standing numbers, texts in double quotes
(a quote inside is doubled) and flags like ``<exists>`` count, all other words are decoration.
So a label may hold anything, even ``intervals [``. Tiers of points are skipped. ELAN exports the
same with whole milliseconds, its own names of tiers and sometimes nothing where no one speaks.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from database.timing.source import Source, quoted
from database.timing.tiers import MAX_SPANS, Span, Tier, Timing, choose_tiers
from database.timing.words import fill_gaps

_TOKEN = re.compile(
    r"""(?P<comment>![^\r\n]*)
    | "(?P<text>[^"]*(?:""[^"]*)*)"
    | (?P<open>")
    | <(?P<flag>[a-z]+)>
    | (?P<number>[-+]?\.?\d[^\s"]*)
    | (?P<equals>=)
    | (?P<word>[^\s"=]+)""",
    re.VERBOSE,
)


SLACK = 1.1e-3
"""Seconds: ELAN rounds each time to a millisecond."""


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    line: int


def _tokens(source: Source) -> Iterator[_Token]:
    """All tokens that count; a key with something else after its ``=`` raises."""
    key, line, at = "", 1, 0
    for match in _TOKEN.finditer(source.text):
        kind = match.lastgroup or ""
        line += source.text.count("\n", at, match.start())
        at = match.start()
        if kind == "open":
            raise source.error("expected a closing quote, got the end of the file", line)
        if kind == "word" and key == "=":
            raise source.error(
                f"expected a number or a quoted text after =, got {quoted(match[0])}", line
            )
        if kind in ("text", "flag", "number"):
            value = match[kind].replace('""', '"') if kind == "text" else match[kind]
            yield _Token(kind, value, line)
        key = kind if kind != "equals" else "="


class _Reader:
    """Tokens one after another, each of a known kind."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.tokens = _tokens(source)

    def take(self, kind: str, what: str) -> _Token:
        token = next(self.tokens, None)
        if token is None:
            raise self.source.error(
                f"expected {what}, got the end of the file", self.source.text.count("\n") + 1
            )
        if token.kind != kind:
            raise self.source.error(f"expected {what}, got {quoted(token.text)}", token.line)
        return token

    def number(self, what: str) -> float:
        token = self.take("number", what)
        return self.source.number(token.text, what, token.line)

    def count(self, what: str) -> int:
        token = self.take("number", what)
        value = self.source.whole(token.text, what, token.line)
        if not 0 <= value <= MAX_SPANS:
            raise self.source.error(
                f"expected {what} from 0 to {MAX_SPANS}, got {value}", token.line
            )
        return value


def read(source: Source, alphabet: str) -> Timing:
    """Read a TextGrid."""
    reader = _Reader(source)
    first = reader.take("text", 'File type = "ooTextFile"')
    if not first.text.startswith("ooTextFile"):
        raise source.error(f'expected "ooTextFile", got {quoted(first.text)}', first.line)
    kind = reader.take("text", 'Object class = "TextGrid"')
    if kind.text != "TextGrid":
        raise source.error(f'expected "TextGrid", got {quoted(kind.text)}', kind.line)
    reader.number("xmin of the file")
    reader.number("xmax of the file")
    flag = reader.take("flag", "the flag <exists>")
    tiers: list[Tier] = []
    for t in range(reader.count("the number of tiers") if flag.text == "exists" else 0):
        found = reader.take("text", f"the class of tier {t + 1}")
        name = reader.take("text", f"the name of tier {t + 1}").text
        reader.number(f"xmin of tier {quoted(name)}")
        end = reader.number(f"xmax of tier {quoted(name)}")
        count = reader.count(f"the number of entries of tier {quoted(name)}")
        if found.text == "IntervalTier":
            tiers.append(Tier(name, [_interval(reader) for _ in range(count)], end))
        elif found.text == "TextTier":
            for _ in range(count):
                reader.number("the time of a point")
                reader.take("text", "the text of a point")
        else:
            raise source.error(
                f'expected "IntervalTier" or "TextTier", got {quoted(found.text)}', found.line
            )
    extra = next(reader.tokens, None)
    if extra is not None:
        raise source.error(
            f"expected the end of the file after the last tier, got {quoted(extra.text)}",
            extra.line,
        )
    return choose_tiers(source, tiers, alphabet, SLACK)


def _interval(reader: _Reader) -> Span:
    start = reader.take("number", "the start of an interval")
    begin = reader.source.number(start.text, "the start of an interval", start.line)
    end = reader.number("the end of an interval")
    label = reader.take("text", "the text of an interval")
    return Span(begin, end, label.text, start.line)


def _tiers(timing: Timing) -> list[Tier]:
    tiers = []
    for name, track in (("words", timing.words), ("phones", timing.phones)):
        if track is not None:
            rows = fill_gaps(track.intervals(), timing.end, "")
            tiers.append(Tier(name, [Span(i.start, i.end, i.label, "") for i in rows], timing.end))
    return tiers


def _quote(text: str) -> str:
    return '"' + text.replace('"', '""') + '"'


def write_long(timing: Timing) -> str:
    """Format as Praat's long text file."""
    tiers = _tiers(timing)
    out = ['File type = "ooTextFile"', 'Object class = "TextGrid"', "", "xmin = 0"]
    out += [f"xmax = {timing.end!r}", "tiers? <exists>", f"size = {len(tiers)}", "item []:"]
    for t, tier in enumerate(tiers, 1):
        out += [f"    item [{t}]:", '        class = "IntervalTier"']
        out += [f"        name = {_quote(tier.name)}", "        xmin = 0"]
        out += [f"        xmax = {timing.end!r}", f"        intervals: size = {len(tier.spans)}"]
        for i, span in enumerate(tier.spans, 1):
            out += [f"        intervals [{i}]:", f"            xmin = {span.start!r}"]
            out += [f"            xmax = {span.end!r}", f"            text = {_quote(span.label)}"]
    return "\n".join(out) + "\n"


def write_short(timing: Timing) -> str:
    """Format as Praat's short text file."""
    tiers = _tiers(timing)
    out = ['File type = "ooTextFile"', 'Object class = "TextGrid"', "", "0", repr(timing.end)]
    out += ["<exists>", str(len(tiers))]
    for tier in tiers:
        out += ['"IntervalTier"', _quote(tier.name), "0", repr(timing.end), str(len(tier.spans))]
        for span in tier.spans:
            out += [repr(span.start), repr(span.end), _quote(span.label)]
    return "\n".join(out) + "\n"
