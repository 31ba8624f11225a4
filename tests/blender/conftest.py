from in_blender import _factory_settings, _fresh_scene, _no_classes_left, _no_handlers_left, registered  # noqa: F401
from kept_chains import _kept_chains, pytest_runtest_setup  # noqa: F401
from kept_groups import _kept_groups  # noqa: F401
