"""The trees of a batch: their files, and the keys by which unchanged ones are skipped."""

from __future__ import annotations

import hashlib
import json
import re
import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from .. import LeafcloudError

SUFFIXES = (".glb", ".gltf", ".obj", ".blend", ".fbx", ".usd", ".usda", ".usdc", ".usdz")
"""File types that `bake.py` reads."""

_MAPS = re.compile(
    rb"^[ \t]*(?:map_\w+|bump|disp|decal|norm)[ \t]+(?:-\w+[ \t]+(?:(?:[-\d.]+|on|off)[ \t]+)*)*([^\r\n]+)",
    re.MULTILINE,
)
_LIBRARIES = re.compile(rb"^mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_MOST_JSON, _MOST_LINES = 2**28, 2**24
"""Most bytes of a JSON document, and of an .obj or .mtl file, in which names of files are looked for."""


@dataclass(frozen=True)
class Tree:
    """A tree of the batch: the file, and the name of its folder in the output."""

    name: str
    file: Path


def find_trees(given: Sequence[Path], out: Path) -> list[Tree]:
    """Return the trees of files and folders, in the order of `given`, each file once; those of a folder by name.

    out: the folder of the results, in which no trees are looked for. Equal names get numbers: oak, oak_2.
    Raises `LeafcloudError` for a path that does not exist, for a folder without trees, and for a file in the folder of
    its own results.
    """
    out = out.resolve()
    files = dict.fromkeys(file.resolve() for path in given for file in _files(path, out))
    taken: set[str] = set()
    trees = [Tree(_free_name(file.stem, taken), file) for file in files]
    folders = {out / tree.name for tree in trees}
    for tree in trees:
        if not folders.isdisjoint(tree.file.parents):
            raise LeafcloudError(f"{tree.file} lies where results are written: choose another --out")
    return trees


def _files(path: Path, out: Path) -> list[Path]:
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise LeafcloudError(f"{path} does not exist: check the path")
    trees = (each for each in path.rglob("*") if each.suffix.lower() in SUFFIXES and each.is_file())
    # A folder may hold the results of its own trees; a file may lie beside them.
    inner = path.resolve() != out
    found = sorted(each for each in trees if not (inner and each.resolve().is_relative_to(out)))
    if not found:
        raise LeafcloudError(f"{path} has no trees: give a folder with files of the types {', '.join(SUFFIXES)}")
    return found


def _free_name(stem: str, taken: set[str]) -> str:
    """Return a name that can be a folder on any system, and take it. Names that differ in case only are one."""
    plain = re.sub(r"[^\w .+-]", "_", stem).strip(" .") or "tree"
    names = (plain, *(f"{plain}_{number}" for number in range(2, len(taken) + 3)))
    name = next(each for each in names if each.casefold() not in taken)
    taken.add(name.casefold())
    return name


def key_of(tree: Tree, flags: Sequence[str], program: str) -> str:
    """Return a key of the contents of the tree's files, the flags and the version of the program.

    Files that a .gltf, .obj or .mtl file names count, too; libraries and images beside a .blend file do not.
    Raises `OSError` if the tree's own file cannot be read.
    """
    digest = hashlib.sha256()
    for part in (program, *flags):
        digest.update(f"{len(part)}:{part}".encode())
    for file in files_of(tree.file):
        digest.update(file.name.encode(errors="surrogateescape"))
        with file.open("rb") as content:
            digest.update(hashlib.file_digest(content, "sha256").digest())
    return digest.hexdigest()


def files_of(file: Path) -> list[Path]:
    """Return the file and the existing files that it names, beside or below it."""
    found = {file: None}
    for each in _named(file):
        with suppress(OSError, ValueError):  # A name that no file can have.
            if each.is_file() and each.resolve().is_relative_to(file.parent.resolve()):
                found[each] = None
    return list(found)


def _named(file: Path) -> Iterator[Path]:
    kind = file.suffix.lower()
    if kind in (".gltf", ".glb"):
        document = _document(file)
        items = [item for name in ("buffers", "images") for item in _list(document, name)]
        addresses = [item.get("uri") for item in items if isinstance(item, dict)]
        names = [each for each in addresses if isinstance(each, str) and not each.startswith("data:")]
        yield from (file.parent / unquote(name) for name in names if "\0" not in unquote(name))
    elif kind == ".obj":
        for library in _matches(_LIBRARIES, file):
            yield file.parent / library
            yield from (file.parent / image for image in _matches(_MAPS, file.parent / library))


def _list(document: Any, name: str) -> list[Any]:
    items = document.get(name) if isinstance(document, dict) else None
    return items if isinstance(items, list) else []


def _document(file: Path) -> Any:
    """Return the JSON of a .gltf or .glb file; None for a file that is neither: the bake will say why."""
    try:
        with file.open("rb") as content:
            if file.suffix.lower() == ".gltf":
                return json.loads(content.read(_MOST_JSON))
            size, _ = struct.unpack("<12xI4s", content.read(20))
            return json.loads(content.read(min(size, _MOST_JSON)))
    except (OSError, ValueError, RecursionError, struct.error):
        return None


def _matches(pattern: re.Pattern[bytes], file: Path) -> Iterable[str]:
    try:
        with file.open("rb") as content:
            found = pattern.findall(content.read(_MOST_LINES))
    except OSError:
        return []
    return [name.decode(errors="replace").strip() for name in found if b"\0" not in name]
