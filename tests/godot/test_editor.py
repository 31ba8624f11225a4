"""Levels switch in the 3D view of Godot's editor."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from godot_project import (
    DISPLAY,
    GODOT,
    NEEDS_GODOT,
    PROJECT,
    ROOT,
    SCRIPTS,
    TREE,
    checked,
    colors,
    project_with,
    window,
)

pytestmark = NEEDS_GODOT

SCENE = """[gd_scene load_steps=3 format=3]
[ext_resource type="PackedScene" path="res://tree.glb" id="1"]
[ext_resource type="Script" path="res://addons/leafcloud/leafcloud_forest.gd" id="2"]
[node name="scene" type="Node3D"]
[node name="tree" parent="." instance=ExtResource("1")]
[node name="forest" type="Node3D" parent="."]
script = ExtResource("2")
"""


@pytest.fixture(scope="module")
def view(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Open a scene with a tree and a forest in the editor, on a virtual screen. Return the folder of its pictures."""
    project = project_with(tmp_path_factory.mktemp("editor"), [TREE])
    (project / "scene.tscn").write_text(SCENE)
    shutil.copy(SCRIPTS / "stage.gd", project)
    shutil.copytree(SCRIPTS / "editor_view", project / "addons" / "editor_view")
    plugins = '"res://addons/leafcloud/plugin.cfg", "res://addons/editor_view/plugin.cfg"'
    (project / "project.godot").write_text(PROJECT.replace('"res://addons/leafcloud/plugin.cfg"', plugins))
    (project / "out").mkdir()
    checked([*DISPLAY, *GODOT, "--path", str(project), "--editor", *window("gl_compatibility")])
    return project / "out"


def test_each_distance_draws_its_level_in_the_editor(view: Path) -> None:
    found: dict[str, Any] = json.loads((view / "editor.json").read_text())
    assert len(found["tree"]) >= 3
    assert found["tree"] == [[number] for number in range(len(found["tree"]))]
    assert found["forest"] == found["tree"]
    pictures = ROOT / "out" / "godot"
    pictures.mkdir(parents=True, exist_ok=True)
    for picture in view.glob("editor_*.png"):
        assert colors(picture).shape[0] > 300, "a view of the editor, not an icon"
        shutil.copy(picture, pictures)
