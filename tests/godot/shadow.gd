extends SceneTree
## Draws the shadow of a tree, and of a forest of one tree, on a ground: godot --script shadow.gd -- FOLDER. The tree
## itself stands below the upper three quarters of the pictures. Writes shadow_tree_N.png and shadow_forest_N.png, N: the level for the distance; shadow.json: the
## triangles that cast the shadow of the tree, by level, and the number of meshes of the tree if a running game reads it.

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	var tree: LeafcloudTree = load("res://tree.glb").instantiate()
	root.add_child(tree)
	var levels: Array = LeafcloudTree.trees_of(tree)[0]
	var radius: float = levels[0].get_meta(LeafcloudTree.META)["radius"]
	var forest := LeafcloudForest.new()
	forest.tree = load("res://tree.glb")
	forest.places = [Transform3D.IDENTITY] as Array[Transform3D]
	root.add_child(forest)
	await _prepare_scene(radius)
	var triangles := []
	for number in levels.size():
		var switch: float = levels[number].get_meta(LeafcloudTree.META)["switch_distance"]
		var distance := maxf(1.3 * switch, 2.0 * radius)
		for shown: Node3D in [tree, forest]:
			tree.visible = shown == tree
			forest.visible = shown == forest
			var centre: Vector3 = LeafcloudTree.common_box(levels).get_center()
			shown.lod_distance = root.get_camera_3d().position.distance_to(centre) / distance
			await Stage.drawn(self)
			var name := "tree" if shown == tree else "forest"
			root.get_texture().get_image().save_png("%s/shadow_%s_%d.png" % [folder, name, number])
		triangles.append(_casting(tree, distance))
	var loaded := LeafcloudTree.load_glb(ProjectSettings.globalize_path("res://tree.glb"))
	var parts := LeafcloudTree.parts_of(LeafcloudTree.trees_of(loaded)[0])
	Stage.write(folder + "/shadow.json", {"triangles": triangles, "loaded_parts": parts.size()})
	loaded.free()
	quit()


func _prepare_scene(radius: float) -> void:
	var ground := MeshInstance3D.new()
	ground.mesh = PlaneMesh.new()
	ground.mesh.size = Vector2.ONE * 100.0 * radius
	root.add_child(ground)
	Stage.light(root, Color(0.5, 0.5, 0.5), 0.2)
	var sun := DirectionalLight3D.new()
	sun.rotation_degrees = Vector3(-30, 0, 0)
	sun.shadow_enabled = true
	sun.directional_shadow_mode = DirectionalLight3D.SHADOW_ORTHOGONAL
	sun.directional_shadow_max_distance = 10.0 * radius
	root.add_child(sun)
	var camera := Stage.camera(root)
	camera.near = 0.1 * radius
	camera.far = 20.0 * radius
	camera.position = Vector3(0.0, 6.0, -2.2) * radius
	camera.rotation_degrees.x = -90.0


func _casting(tree: Node3D, distance: float) -> int:
	var count := 0
	for part in LeafcloudTree.parts_of(LeafcloudTree.trees_of(tree)[0]):
		var numbers := LeafcloudTree.numbers_of(part)
		var is_drawn: bool = distance >= numbers["fade_in"].x and distance < numbers["fade_out"].y
		if is_drawn and part.cast_shadow != GeometryInstance3D.SHADOW_CASTING_SETTING_OFF:
			for i in part.mesh.get_surface_count():
				count += part.mesh.surface_get_arrays(i)[Mesh.ARRAY_INDEX].size() / 3
	return count
