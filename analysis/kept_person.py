"""The person as a file: dataclasses of arrays and numbers, taken apart and put together again."""

from __future__ import annotations

import types
import typing
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


def taken_apart(value: Any, arrays: dict[str, Array]) -> Any:
    """A dataclass as a JSON document; its arrays go into `arrays`, and their names stand for them.

    Parameters
    ----------
    value : dataclass, array, tuple, number, str or None
    arrays : dict
        Is filled.

    Raises
    ------
    TypeError
        For a value of another kind.
    """
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        name = f"array{len(arrays)}"
        arrays[name] = value
        return name
    if isinstance(value, tuple):
        return [taken_apart(v, arrays) for v in value]
    if is_dataclass(value):
        return {f.name: taken_apart(getattr(value, f.name), arrays) for f in fields(value)}
    raise TypeError(f"{type(value).__name__} cannot be kept in a file")


def put_together(kind: Any, document: Any, array: Callable[[str], Array]) -> Any:
    """What `taken_apart` took apart.

    Parameters
    ----------
    kind : type
        As annotated: a dataclass, ``NDArray``, ``tuple[kind, ...]``, ``kind | None``, or a
        number's or text's.
    document : JSON value
    array : callable
        Gives the array of a name.
    """
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        if document is None:
            return None
        others = [k for k in inside if k is not type(None)]
        # Of several kinds only numbers and texts are kept, which are what they are.
        return document if len(others) > 1 else put_together(others[0], document, array)
    if origin is np.ndarray:
        return array(document)
    if origin is tuple:
        each = inside[:1] * len(document) if inside[-1] is Ellipsis else inside
        return tuple(put_together(k, d, array) for k, d in zip(each, document, strict=True))
    if is_dataclass(kind) and isinstance(kind, type):
        kinds = typing.get_type_hints(kind)
        return kind(**{n: put_together(kinds[n], d, array) for n, d in document.items()})
    return kind(document)
