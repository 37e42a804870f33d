"""Modules import downwards: the layers, lowest first, and what stands in each."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import noslip

SOURCE = Path(noslip.__file__).parent
LAYERS = [
    {
        "_arguments",
        "_extras",
        "_files",
        "_instants",
        "_supplied",
        "_typing",
        "_values",
        "_version",
        "errors",
    },
    {"_pose_checks", "_pose_npz", "_samples", "named_columns", "_dialect", "quaternions"},
    {"_turns", "_pose_names", "_value_columns", "_pose_columns", "_exporters", "_pose_text"},
    {"timed", "series", "trajectory", "rotations", "space", "chain", "vectors", "bodies"},
    {"edge", "boundary"},
    {"scale"},
    {"recordings", "constraints", "law"},
    {"codegen"},
    {"projection", "demonstrations", "maneuvers"},
    {"rule", "identification"},
    {"runtime"},
    {"verification"},
    {"adapting"},
    {"control", "exporting", "spread", "provenance", "merit"},
    {"document"},
    {"primitive"},
    {
        "distribution",
        "improving",
        "learning",
        "saving",
        "shielding",
        "interop",
        "result_table",
        "strangers",
    },
    {"many", "citing"},
    {"experiments"},
    {"robots"},
    {"figures"},
    {"viewer", "reporting"},
    {"cli"},
    {"__init__", "__main__", "_face"},
]
"""A module may import from its own layer, without circles, and from those before it."""


def modules() -> dict[str, Path]:
    found = {}
    for path in SOURCE.rglob("*.py"):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" and parts[1:] else parts)] = path
    return found


MODULES = modules()


def imports(path: Path) -> Iterator[str]:
    """Modules of noslip that a file imports, wherever it does so."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            # A name may be a module itself.
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            if name.split(".")[0] != "noslip":
                continue
            inside = name.split(".")[1:]
            while inside and ".".join(inside) not in MODULES:
                inside.pop()
            yield ".".join(inside) or "__init__"


IMPORTS = {name: sorted(set(imports(path)) - {name}) for name, path in MODULES.items()}


def layer_of(module: str) -> int:
    (found,) = [k for k, names in enumerate(LAYERS) if module.split(".")[0] in names]
    return found


def test_each_module_has_a_layer() -> None:
    tops = {name.split(".")[0] for name in MODULES}
    named = [name for names in LAYERS for name in names]
    assert sorted(named) == sorted(tops)


def test_no_module_imports_upwards() -> None:
    upward = [
        f"{name} imports {other}"
        for name, others in IMPORTS.items()
        for other in others
        if layer_of(other) > layer_of(name)
    ]
    assert upward == []


def test_only_registries_import_what_no_statement_names() -> None:
    """What the tests here cannot see: the top level, folders of plug-ins, commands and extras."""
    by_name = {
        name for name, path in MODULES.items() if "import_module(" in path.read_text("utf-8")
    }
    assert by_name == {
        "__init__",
        "_extras",
        "cli",
        "cli.doctor",
        "constraints",
        "demonstrations.alignment",
    }


def test_no_folder_imports_itself_around_a_corner() -> None:
    """Folders of one layer: none leads back to where it began."""
    folders: dict[str, set[str]] = {}
    for name, others in IMPORTS.items():
        top = name.split(".")[0]
        folders.setdefault(top, set()).update(o.split(".")[0] for o in others)
    assert circles({top: found - {top} for top, found in folders.items()}) == []


def test_no_modules_import_each_other() -> None:
    # What a folder offers as a whole is what its modules import from each other, not a circle.
    direct = {
        name: {other for other in others if not name.startswith(f"{other}.")}
        for name, others in IMPORTS.items()
    }
    assert circles(direct) == []


def circles(graph: dict[str, set[str]]) -> list[str]:
    """Nodes from which a path leads back to themselves."""

    def reached(start: str) -> set[str]:
        found: set[str] = set()
        waiting = [start]
        while waiting:
            for other in graph.get(waiting.pop(), ()):
                if other not in found:
                    found.add(other)
                    waiting.append(other)
        return found

    return sorted(node for node in graph if node in reached(node))
