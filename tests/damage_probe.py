"""Reads everything out of damaged copies of a database, and says what became of it.

Run as a program of its own by test_database_damage.py, so that a crash of the interpreter would
be seen: ``damage_probe.py DATABASE PLAN RESULTS``. The plan is a JSON list of damages, each
``{"flip": [byte, bit]}`` or ``{"cut": length}``; one line goes to the results for each.
"""

import hashlib
import json
import pickle
import sys
from dataclasses import astuple, is_dataclass
from pathlib import Path

from database.errors import DatabaseError
from database.fingerprint import content_hash
from database.reader import UnitDatabase, open_database

MEMBERS = (
    *("fps", "codec", "settings", "versions", "report", "units", "sequences"),
    *("phones", "marks", "mask", "camera", "texture", "costs", "guides", "lips", "selection"),
)


def digest(value: object) -> str:
    if is_dataclass(value):
        value = astuple(value)
    return hashlib.sha256(pickle.dumps(value)).hexdigest()


def reads(database: UnitDatabase):
    """Every way to read, by name; those of one unit for every unit."""
    for name in MEMBERS:
        yield name, lambda name=name: getattr(database, name)
    yield "context", lambda: database.context(3)
    for s in range(2):
        yield f"track {s}", lambda s=s: database.sequence_track(s)
        yield f"sound {s}", lambda s=s: database.sound(s)
    for kind in database.guides:
        yield f"guide {kind}", lambda kind=kind: database.guide(kind)
    for i in range(len(database)):
        yield f"picture {i}", lambda i=i: database.picture(i)
        yield f"landmarks {i}", lambda i=i: database.landmarks([i])


def read_all(path: Path) -> dict[str, str]:
    """Digest of what each read gives, ``refused`` where it raises `DatabaseError`."""
    found = {}
    try:
        with open_database(path) as database:
            for name, read in reads(database):
                try:
                    found[name] = digest(read())
                except DatabaseError as error:
                    check_message(error, path)
                    found[name] = "refused"
    except DatabaseError as error:
        check_message(error, path)
        found["open"] = "refused"
    try:
        found["hash"] = content_hash(path)
    except DatabaseError as error:
        check_message(error, path)
        found["hash"] = "refused"
    return found


def check_message(error: DatabaseError, path: Path) -> None:
    message = str(error)
    if not message.startswith(f"{path}: ") or "\n" in message or len(message) > 600:
        raise AssertionError(f"not one line naming the file: {message!r}")


def judge(found: dict[str, str], right: dict[str, str]) -> str:
    wrong = [k for k, v in found.items() if v not in ("refused", right.get(k))]
    if wrong:
        return f"silently wrong: {', '.join(wrong)}"
    return "refused" if "refused" in found.values() else "right"


def main() -> None:
    source, plan, results = map(Path, sys.argv[1:])
    data = source.read_bytes()
    right = read_all(source)
    assert "refused" not in right.values(), right
    damaged = source.with_name("damaged.h5")
    with results.open("w") as out:
        for damage in json.loads(plan.read_text()):
            copy = bytearray(data)
            if "cut" in damage:
                del copy[damage["cut"] :]
            else:
                byte, bit = damage["flip"]
                copy[byte] ^= 1 << bit
            damaged.unlink(missing_ok=True)
            damaged.write_bytes(copy)
            try:
                verdict = judge(read_all(damaged), right)
            except Exception as error:
                verdict = f"raised {error!r}"
            print(verdict, file=out, flush=True)


if __name__ == "__main__":
    main()
