"""Preferences of the extension."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty

_PACKAGE = __package__.rpartition(".")[0]


class LeafcloudPreferences(bpy.types.AddonPreferences):
    bl_idname = _PACKAGE

    vertex_groups: BoolProperty(
        name="Vertex Groups",
        description="Add a vertex group for each billboard to the leaves, by which the shape key Billboards can be "
        "limited to some of them",
        default=True,
    )
    place_instances: BoolProperty(
        name="Place Collection Instances",
        description="Show the level for its own place in each new instance of a baked tree's collection. Otherwise all "
        "instances show the level for the place of the original",
        default=True,
    )

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(heading="New Bakes")
        column.prop(self, "vertex_groups")
        column = self.layout.column(heading="Instances")
        column.prop(self, "place_instances")


def preference(name: str) -> bool:
    """Return a preference; True, the default of all, if the package is not enabled as an extension."""
    entry = bpy.context.preferences.addons.get(_PACKAGE)
    return entry is None or entry.preferences is None or bool(getattr(entry.preferences, name))
