from in_blender import _fresh_scene, _no_classes_left, _no_handlers_left, registered  # noqa: F401
