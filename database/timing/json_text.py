"""JSON as the timing readers take it: every mistake in it is a `TimingError`."""

from __future__ import annotations

import json
import re
from typing import Any

from database.timing.source import Source, quoted

MAX_VALUES = 100_000
"""More utterances in one file are a mistake."""

_JSON_SPACE = re.compile(r"[ \t\r\n]*")


def read_values(source: Source) -> list[Any]:
    """Read one JSON value, or several one after another (pocketsphinx writes one a line)."""
    decoder = json.JSONDecoder()
    values, at = [], _skip(source.text, 0)
    while at < len(source.text):
        try:
            value, at = decoder.raw_decode(source.text, at)
        except json.JSONDecodeError as error:
            raise source.error(f"expected JSON: {error.msg}", error.lineno) from error
        except (ValueError, RecursionError) as error:  # a number too long, brackets too deep
            raise source.error(f"expected JSON of a timing file: {error}") from error
        values.append(value)
        if len(values) > MAX_VALUES:
            raise source.error(f"expected at most {MAX_VALUES} JSON values one after another")
        at = _skip(source.text, at)
    return values


def _skip(text: str, at: int) -> int:
    match = _JSON_SPACE.match(text, at)
    return match.end() if match else at


def member(source: Source, value: Any, key: str, kind: type, place: str) -> Any:
    """Take a member of an object, of a known kind, or raise naming it."""
    if not isinstance(value, dict):
        raise source.error(f"expected an object with {key!r}, got {quoted(value)}", place)
    if key not in value:
        raise source.error(f"expected a member {key!r}, got {quoted(list(value))}", place)
    found = value[key]
    if not isinstance(found, kind):
        name = {"dict": "an object", "list": "an array", "str": "a string"}[kind.__name__]
        raise source.error(f"expected {key!r} to be {name}, got {quoted(found)}", place)
    return found


def has_key(source: Source, *keys: str) -> bool:
    """Whether one of the keys stands before a colon; a cut-off file still shows which it was."""
    return any(re.search(rf'"{key}"[ \t\r\n]*:', source.text) for key in keys)
