extends SceneTree
## Reads tree.glb while the game runs, and draws it beside the imported one: godot --script loaded.gd -- FOLDER. Writes
## loaded.json: the levels of both, and whether textures have mip levels; imported_N.png and loaded_N.png: from N tenths of
## the first hand-over.

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	Stage.light(root, Color(0.5, 0.5, 0.5), 1.0)
	var camera := Stage.camera(root)
	var imported: LeafcloudTree = load("res://tree.glb").instantiate()
	var loaded := LeafcloudTree.load_glb(ProjectSettings.globalize_path("res://tree.glb"))
	var found := {"levels": [], "mips": []}
	for tree: LeafcloudTree in [imported, loaded]:
		var levels: Array = LeafcloudTree.trees_of(tree)[0]
		found["levels"].append(levels.size())
		var material: ShaderMaterial = levels[1].mesh.surface_get_material(0)
		found["mips"].append(material.get_shader_parameter("base_texture").get_image().has_mipmaps())
	for named: Array in [["imported", imported], ["loaded", loaded]]:
		var tree: LeafcloudTree = named[1]
		root.add_child(tree)
		var levels: Array = LeafcloudTree.trees_of(tree)[0]
		var numbers: Dictionary = levels[0].get_meta(LeafcloudTree.META)
		var centre: Vector3 = levels[0].global_transform * LeafcloudTree.common_box(levels).get_center()
		for tenths in [5, 12, 40]:
			var distance: float = 0.1 * tenths * numbers["fade_out"].x
			camera.far = 3.0 * distance
			camera.position = centre + Vector3(0, 0, distance)
			await Stage.drawn(self)
			root.get_texture().get_image().save_png("%s/%s_%d.png" % [folder, named[0], tenths])
		root.remove_child(tree)
	Stage.write(folder + "/loaded.json", found)
	quit()
