extends SceneTree
## Draws a tree with wind and pruning: godot --script effects.gd -- FOLDER. Writes effects.json: the share of pixels that
## change within half a second, and the covered pixels with a quarter of the leaves over those with all of them. The
## quarter does not grow, because the table of areas is empty.


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	var tree: LeafcloudTree = load("res://tree.glb").instantiate()
	root.add_child(tree)
	var world := WorldEnvironment.new()
	world.environment = Environment.new()
	world.environment.background_mode = Environment.BG_COLOR
	world.environment.background_color = Color(0.5, 0.5, 0.5)
	world.environment.ambient_light_source = Environment.AMBIENT_SOURCE_COLOR
	world.environment.ambient_light_color = Color.WHITE
	root.add_child(world)
	var camera := Camera3D.new()
	camera.fov = 50.0
	root.add_child(camera)
	camera.make_current()
	var levels: Array = LeafcloudTree.trees_of(tree)[0]
	var numbers: Dictionary = levels[0][0].get_meta(LeafcloudTree.META)
	var material: ShaderMaterial = levels[0][0].mesh.surface_get_material(0)
	material.set_shader_parameter("wind_strength", 12.0)
	camera.position = LeafcloudTree.common_box(levels).get_center() + Vector3(0, 0, 2.6) * numbers["radius"]
	var first := await _picture()
	await create_timer(0.5).timeout
	var second := await _picture()
	var moved := 0
	for y in range(0, first.get_height(), 4):
		for x in range(0, first.get_width(), 4):
			var change := first.get_pixel(x, y) - second.get_pixel(x, y)
			moved += 1 if absf(change.r) + absf(change.g) + absf(change.b) > 0.05 else 0
	material.set_shader_parameter("wind_strength", 0.0)
	var all := _covered(await _picture())
	var empty := PackedFloat32Array()
	empty.resize(65)
	var near: float = 2.6 * numbers["radius"]
	for setting: Array in [["shares", empty], ["growth", Vector2.ZERO], ["prune_half", 0.5], ["prune_start", 0.25 * near]]:
		material.set_shader_parameter(setting[0], setting[1])
	var quarter := _covered(await _picture())
	var file := FileAccess.open(folder + "/effects.json", FileAccess.WRITE)
	file.store_string(JSON.stringify({
		"moved": 16.0 * moved / (first.get_width() * first.get_height()),
		"kept": float(quarter) / all,
		"wind_strength": numbers["wind"]["strength"],
	}))
	file.close()
	quit()


func _picture() -> Image:
	for _frame in 2:
		await process_frame
	await RenderingServer.frame_post_draw
	return root.get_texture().get_image()


func _covered(picture: Image) -> int:
	var background := picture.get_pixel(0, 0)
	var count := 0
	for y in range(0, picture.get_height(), 4):
		for x in range(0, picture.get_width(), 4):
			var change := picture.get_pixel(x, y) - background
			count += 1 if absf(change.r) + absf(change.g) + absf(change.b) > 0.05 else 0
	return count
