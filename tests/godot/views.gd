extends SceneTree
## Draws an imported tree and writes pictures and a table for the tests:
##
##     godot --script views.gd -- FOLDER
##
## For each hand-over: the tree just before it (before_N.png), and the next level from the same place (after_N.png),
## by a smaller LOD distance. For each level: the levels whose ranges hold at some distances (drawn.json).

const SHARES := [0.5, 0.9, 1.5, 2.0, 4.0]


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	var tree: LeafcloudTree = load("res://tree.glb").instantiate()
	root.add_child(tree)
	_add_light()
	var camera := Camera3D.new()
	camera.fov = 50.0
	root.add_child(camera)
	camera.make_current()
	var levels: Array = LeafcloudTree.trees_of(tree)[0]
	var centre: Vector3 = levels[0][0].global_transform * LeafcloudTree.common_box(levels).get_center()
	var drawn := []
	for number in levels.size():
		var level: Dictionary = levels[number][0].get_meta(LeafcloudTree.META)
		for share: float in SHARES:
			var near: float = 2.0 * level["radius"] * levels[0][0].global_basis.x.length()
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
	var file := FileAccess.open(folder + "/drawn.json", FileAccess.WRITE)
	file.store_string(JSON.stringify({"levels": levels.size(), "drawn": drawn}))
	file.close()
	quit()


func _add_light() -> void:
	var world := WorldEnvironment.new()
	world.environment = Environment.new()
	world.environment.background_mode = Environment.BG_COLOR
	world.environment.background_color = Color(0.5, 0.5, 0.5)
	world.environment.ambient_light_source = Environment.AMBIENT_SOURCE_COLOR
	world.environment.ambient_light_color = Color.WHITE
	root.add_child(world)


func _look(camera: Camera3D, centre: Vector3, distance: float) -> void:
	camera.position = centre + Vector3(0.4, 0.15, 1.0).normalized() * distance
	camera.look_at(centre)
	camera.near = 0.05 * distance
	camera.far = 3.0 * distance
	for _frame in 3:
		await process_frame
	await RenderingServer.frame_post_draw


func _save(path: String) -> void:
	root.get_texture().get_image().save_png(path)


func _drawn(levels: Array, distance: float) -> Array:
	var found := []
	for number in levels.size():
		var part: MeshInstance3D = levels[number][0]
		var end := part.visibility_range_end
		if distance >= part.visibility_range_begin and (end == 0.0 or distance < end):
			found.append(number)
	return found
