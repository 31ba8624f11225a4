extends SceneTree
## Draws an imported tree and writes pictures and a table for the tests:
##
##     godot --script views.gd -- FOLDER
##
## For each hand-over: the tree just before it (before_N.png), and the next level from the same place (after_N.png),
## by a smaller LOD distance. For each level: the levels whose ranges hold at some distances (drawn.json).

const SHARES := [0.5, 0.9, 1.5, 2.0, 4.0]

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	var tree: LeafcloudTree = load("res://tree.glb").instantiate()
	root.add_child(tree)
	Stage.light(root, Color(0.5, 0.5, 0.5), 1.0)
	var camera := Stage.camera(root)
	var levels: Array = LeafcloudTree.trees_of(tree)[0]
	var centre: Vector3 = levels[0].global_transform * LeafcloudTree.common_box(levels).get_center()
	var drawn := []
	for number in levels.size():
		var level: Dictionary = levels[number].get_meta(LeafcloudTree.META)
		for share: float in SHARES:
			var near: float = 2.0 * level["radius"] * levels[0].global_basis.x.length()
			var distance: float = share * (level["switch_distance"] if number > 0 else near)
			await _look(camera, centre, distance)
			drawn.append({"distance": distance, "levels": _drawn(levels, distance)})
		if number + 1 < levels.size():
			var end: float = 0.999 * level["fade_out"].x
			await _look(camera, centre, end)
			_save("%s/before_%d.png" % [folder, number])
			tree.lod_distance = 1.0 / 1.3
			await _look(camera, centre, end)
			_save("%s/after_%d.png" % [folder, number])
			tree.lod_distance = 1.0
	Stage.write(folder + "/drawn.json", {"levels": levels.size(), "drawn": drawn})
	quit()


func _look(camera: Camera3D, centre: Vector3, distance: float) -> void:
	camera.position = centre + Vector3(0.4, 0.15, 1.0).normalized() * distance
	camera.look_at(centre)
	camera.near = 0.05 * distance
	camera.far = 3.0 * distance
	await Stage.drawn(self)


func _save(path: String) -> void:
	root.get_texture().get_image().save_png(path)


func _drawn(levels: Array, distance: float) -> Array:
	var found := []
	for number in levels.size():
		var part: MeshInstance3D = levels[number]
		var end := part.visibility_range_end
		if distance >= part.visibility_range_begin and (end == 0.0 or distance < end):
			found.append(number)
	return found
