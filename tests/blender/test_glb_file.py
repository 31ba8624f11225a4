"""GLB files in memory: appended data can be read back, and a bake reads and writes each file once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plan_scenes import add_crown
from scenes import add_mesh, bake, read

from addon.bake.values import TreeSet
from addon.export import files, gltf
from addon.export.files import write
from addon.export.glb_file import Glb
from addon.export.translucency import DIFFUSE_TRANSMISSION
from addon.settings.bake import BakeSettings

pytestmark = pytest.mark.version


def empty() -> Glb:
    return Glb({"asset": {"version": "2.0"}, "buffers": [{}], "bufferViews": [], "accessors": []}, bytearray())


def test_buffer_views_start_at_multiples_of_four_bytes() -> None:
    glb = empty()
    assert [glb.append_view(b"abc"), glb.append_view(b"defgh"), glb.append_view(b"")] == [0, 1, 2]
    assert bytes(glb.binary) == b"abc\0defgh\0\0\0"
    assert [view["byteOffset"] for view in glb.document["bufferViews"]] == [0, 4, 12]


def test_a_file_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    glb = empty()
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    number = glb.append_accessor(values)
    glb.append_view(b"x")
    glb.write(tmp_path / "a.glb")
    again = Glb.read(tmp_path / "a.glb")
    assert again.values(number).tolist() == values.tolist()
    assert again.document["buffers"] == [{"byteLength": 25}]
    assert again.content() == (tmp_path / "a.glb").read_bytes()


def test_unused_accessors_and_buffer_views_are_removed() -> None:
    glb = empty()
    unused, used = (glb.append_accessor(np.full((1, 3), value, np.float32)) for value in (1.0, 2.0))
    indices = glb.append_accessor(np.zeros((3, 1), np.float32))
    primitive = {"attributes": {"POSITION": used}, "indices": indices}
    glb.document["meshes"] = [{"primitives": [primitive]}]
    glb.remove_unused()
    assert unused == 0
    assert primitive == {"attributes": {"POSITION": 0}, "indices": 1}
    assert glb.values(0).tolist() == [[2.0, 2.0, 2.0]]
    assert len(glb.binary) == 12 + 12


def test_a_bake_reads_and_writes_each_file_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = BakeSettings(epsilon=0.1, quality=0.1, texture_size=128, engine="three", effects="all", files="levels")
    leaves = add_crown()
    baked = bake(read([leaves], ["leaves"]), settings)
    reads, writes = Counter[str](), Counter[str]()
    own_read, own_write = Glb.read, Glb.write

    def counted_read(path: Path) -> Glb:
        reads[path.name] += 1
        return own_read(path)

    def counted_write(glb: Glb, path: Path) -> None:
        writes[path.name] += 1
        own_write(glb, path)

    monkeypatch.setattr(Glb, "read", staticmethod(counted_read))
    monkeypatch.setattr(Glb, "write", counted_write)
    report = write(TreeSet.of(baked), tmp_path, lambda stage, fraction: None, blend=False)
    files = {name for name in report["files"] if name.endswith(".glb")}
    assert reads == writes == dict.fromkeys(files, 1)


def test_edits_in_memory_give_the_bytes_of_edits_from_file_to_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Edits must not share lists or dictionaries within the document. Otherwise one change would appear twice."""

    def through_a_file(edit: Callable[..., None]) -> Callable[..., None]:
        def edit_the_written_file(glb: Glb, *arguments: Any) -> None:
            glb.write(tmp_path / "between.glb")
            again = Glb.read(tmp_path / "between.glb")
            glb.document, glb.binary = again.document, again.binary
            edit(glb, *arguments)

        return edit_the_written_file

    settings = BakeSettings(
        epsilon=0.1, quality=0.1, texture_size=128, levels=1, engine="babylon", effects="all", files="levels"
    )
    trunk = add_mesh("trunk", [(0, 0, -1), (0.2, 0, -1), (0.2, 0, 1), (0, 0, 1)], [(0, 1, 2, 3)])
    tree_set = TreeSet.of(bake(read([add_crown(), trunk], ["leaves"]), settings))
    write(tree_set, tmp_path / "memory", lambda stage, fraction: None, blend=False)
    edits = files._edits
    monkeypatch.setattr(files, "_edits", lambda trees: [through_a_file(edit) for edit in edits(trees)])
    monkeypatch.setattr(files, "add_lods", through_a_file(files.add_lods))
    for name in ("add_optional_textures", "add_translucency", "add_unlit", "add_tangents"):
        monkeypatch.setattr(gltf, name, through_a_file(getattr(gltf, name)))
    write(tree_set, tmp_path / "files", lambda stage, fraction: None, blend=False)
    for path in (tmp_path / "memory").glob("*.glb"):
        assert path.read_bytes() == (tmp_path / "files" / path.name).read_bytes(), path.name
    extension = Glb.read(tmp_path / "memory" / "tree_LOD2.glb").materials[0]["extensions"][DIFFUSE_TRANSMISSION]
    assert "diffuseTransmissionTexture" in extension, "two textures are equal until an edit changes one"
