from pathlib import Path

import bpy
import pytest
from in_blender import _factory_settings, _fresh_scene, _no_classes_left, _no_handlers_left, registered  # noqa: F401
from kept_chains import _kept_chains, pytest_runtest_setup  # noqa: F401
from kept_groups import _kept_groups  # noqa: F401


@pytest.fixture
def selected_shrub(shrub: Path) -> list[bpy.types.Object]:
    """Return the selected objects of the shrub, with settings for a fast bake."""
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.quality = 128, 1, 0.1
    return list(bpy.context.selected_objects)
