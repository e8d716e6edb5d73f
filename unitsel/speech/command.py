"""Any other speech synthesizer: a command that leaves a sound file.

The template is split as a shell would, but no shell runs, so nothing in the text can become a
command. ``{wav}`` is the file to write; the text goes in by ``{text}`` or by a file,
``{text_file}``, else through standard input.
"""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from database.errors import SpeechError

PLACEHOLDERS: Final = ("text", "text_file", "wav", "voice", "rate")

LONGEST_ARGUMENT: Final = 100_000
"""Bytes of text on a command line; systems end at 128 KiB."""


def run_command(
    template: str, text: str, wav: Path, *, voice: str | None = None, rate: float | None = None
) -> None:
    """Have a program speak a text into a sound file.

    Parameters
    ----------
    template : str
        ``piper -m voice.onnx -f {wav}``; see the module.
    text : str
    wav : Path
        To be written by the program; its folder is used for the text's file too.
    voice : str, optional
        For ``{voice}``.
    rate : float, optional
        For ``{rate}``.

    Raises
    ------
    SpeechError
        If the template cannot be used, the program is missing or fails, or leaves no sound.
    """
    arguments = _arguments(template, {"voice": voice, "rate": rate})
    name = Path(arguments[0]).name
    given = "{text}" in template or "{text_file}" in template
    script = wav.with_suffix(".txt")
    values = {"text": text, "text_file": str(script), "wav": str(wav), "voice": voice or ""}
    values["rate"] = "" if rate is None else f"{rate:g}"
    if "{text}" in template and len(text.encode()) > LONGEST_ARGUMENT:
        raise SpeechError(
            f"--tts {name}: the text is too long for a command line; use {{text_file}}"
        )
    if "{text_file}" in template:
        script.write_text(text + "\n", encoding="utf-8")
    try:
        done = subprocess.run(
            [_filled(a, values) for a in arguments],
            input=b"" if given else text.encode() + b"\n",
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            check=False,
        )
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise SpeechError(f"--tts {name}: cannot be run: {why}; is it installed?") from error
    finally:
        script.unlink(missing_ok=True)
    said = [line.strip() for line in done.stderr.decode(errors="replace").splitlines()]
    last = next((f": {line[:300]}" for line in reversed(said) if line), "")
    if done.returncode:
        raise SpeechError(f"--tts {name}: ended with status {done.returncode}{last}")
    if not wav.is_file() or wav.stat().st_size == 0:
        raise SpeechError(f"--tts {name}: wrote no sound to {{wav}}{last}")


def _arguments(template: str, asked: Mapping[str, object]) -> list[str]:
    try:
        arguments = shlex.split(template)
    except ValueError as error:
        raise SpeechError(f"--tts {template!r}: cannot be read as a command: {error}") from error
    if not arguments:
        raise SpeechError("--tts: names no command")
    unknown = sorted(set(re.findall(r"\{(\w+)\}", template)) - set(PLACEHOLDERS))
    if unknown:
        raise SpeechError(
            f"--tts {template!r}: knows no {{{unknown[0]}}}; there are "
            + ", ".join(f"{{{p}}}" for p in PLACEHOLDERS)
        )
    if "{wav}" not in template:
        raise SpeechError(
            f"--tts {template!r}: says nowhere which file to write; put {{wav}} in its place"
        )
    for name, value in asked.items():
        if value is not None and f"{{{name}}}" not in template:
            raise SpeechError(
                f"--tts {template!r}: has no {{{name}}}, so --{name} would change nothing; leave "
                "one of them out"
            )
    return arguments


def _filled(argument: str, values: Mapping[str, str]) -> str:
    # One pass, so that braces inside the text stay what they are.
    return re.sub(r"\{(text|text_file|wav|voice|rate)\}", lambda m: values[m[1]], argument)
