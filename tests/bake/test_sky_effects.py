"""Occlusion and self-shadowing in files: present if requested, absent otherwise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bakes import kept
from command_line import report_in
from glb import Primitive, read_glb


def level_of(effects: str) -> tuple[Path, Primitive, dict[str, Any]]:
    """Bake the shrub. Return the folder, level 1 and the report's effects by name."""
    shape = ("--levels", 1, "--no-cross", "--texture-size", 128, "--epsilon", 0.1, "--quality", 0.1)
    out = kept("--effects", effects, *shape)
    [primitive] = read_glb(out / "shrub.glb")["shrub_LOD1"].primitives
    return out, primitive, {effect["name"]: effect for effect in report_in(out)["effects"]}


def test_self_shadowing_has_a_texture_and_its_axes(gltf_issues: Callable[..., list[dict[str, Any]]]) -> None:
    folder, primitive, effects = level_of("self_shadowing")
    assert "bentNormalTexture" in primitive.material["extras"]["leafcloud"]
    assert "metallicRoughnessTexture" in primitive.material["pbrMetallicRoughness"], "its red is the occlusion"
    assert "TANGENT" in primitive.attributes
    assert not {"normalTexture", "occlusionTexture"} & {*primitive.material}
    assert effects["self_shadowing"]["bytes"] == 2 * 128 * 128 * 4
    assert gltf_issues(*folder.glob("*.glb")) == []


def test_occlusion_is_a_texture_of_gltf() -> None:
    _, primitive, effects = level_of("occlusion")
    orm = primitive.material["pbrMetallicRoughness"]["metallicRoughnessTexture"]
    assert primitive.material["occlusionTexture"]["index"] == orm["index"]
    assert "TANGENT" not in primitive.attributes
    assert "extras" not in primitive.material
    assert effects["occlusion"]["bytes"] == 128 * 128 * 4
    assert effects["self_shadowing"]["bytes"] == 0


@pytest.mark.parametrize("effects", ["none", "auto"])
def test_files_lack_both_effects_unless_requested(effects: str) -> None:
    _, primitive, told = level_of(effects)
    assert "occlusionTexture" not in primitive.material
    assert "metallicRoughnessTexture" not in primitive.material["pbrMetallicRoughness"]
    assert "extras" not in primitive.material
    for name in ("occlusion", "self_shadowing"):
        assert (told[name]["on"], told[name]["bytes"], told[name]["seconds"]) == (False, 0, 0.0)
