"""The panel in the 3D view's sidebar."""

from __future__ import annotations

import bpy

from .viewport import is_previewed


class LEAFCLOUD_PT_bake(bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_bake"
    bl_label = "Levels of Detail"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Leafcloud"

    def draw(self, context: bpy.types.Context) -> None:
        settings, status = context.scene.leafcloud, context.window_manager.leafcloud
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        layout.prop(settings, "leaves")
        column = layout.column(align=True)
        for name in ("epsilon", "levels", "cross"):
            column.prop(settings, name)
        column = layout.column(align=True)
        for name in ("texture_size", "pixels", "close_cracks"):
            column.prop(settings, name)
        column = layout.column(align=True)
        column.prop(settings, "chain")
        if settings.chain != "billboards":
            for name in ("prune_pixels", "prune_half"):
                column.prop(settings, name)
        column = layout.column(align=True)
        for name in ("effort", "max_billboards", "max_corners", "candidates", "bend_normals", "seed"):
            column.prop(settings, name)
        layout.prop(settings, "effect_choice")
        if settings.effect_choice == "some":
            layout.column().prop(settings, "chosen_effects")
        column = layout.column(align=True)
        column.prop(settings, "directory")
        if settings.directory:
            column.prop(settings, "engine")
        if status.stage:
            layout.progress(factor=status.fraction, text=f"{status.stage}, Esc to cancel")
        layout.operator("leafcloud.bake")
        layout.operator("leafcloud.preview", depress=is_previewed())
