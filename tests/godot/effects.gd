extends SceneTree
## Draws a tree with wind and pruning: godot --script effects.gd -- FOLDER. Writes effects.json: the share of pixels that
## change within half a second, and the covered pixels with a quarter of the leaves over those with all of them. The
## quarter does not grow, because the table of areas is empty.

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	var tree: LeafcloudTree = load("res://tree.glb").instantiate()
	root.add_child(tree)
	Stage.light(root, Color(0.5, 0.5, 0.5), 1.0)
	var camera := Stage.camera(root)
	var levels: Array = LeafcloudTree.trees_of(tree)[0]
	var numbers: Dictionary = levels[0].get_meta(LeafcloudTree.META)
	var material: ShaderMaterial = levels[0].mesh.surface_get_material(0)
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
	for setting: Array in [["area_shares", empty], ["growth_numbers", Vector2.ZERO], ["prune_half", 0.5], ["prune_start", 0.25 * near]]:
		material.set_shader_parameter(setting[0], setting[1])
	var quarter := _covered(await _picture())
	Stage.write(folder + "/effects.json", {
		"moved": 16.0 * moved / (first.get_width() * first.get_height()),
		"kept": float(quarter) / all,
		"wind_strength": numbers["wind"]["strength"],
	})
	quit()


func _picture() -> Image:
	await Stage.drawn(self)
	return root.get_texture().get_image()


func _covered(picture: Image) -> int:
	var background := picture.get_pixel(0, 0)
	var count := 0
	for y in range(0, picture.get_height(), 4):
		for x in range(0, picture.get_width(), 4):
			var change := picture.get_pixel(x, y) - background
			count += 1 if absf(change.r) + absf(change.g) + absf(change.b) > 0.05 else 0
	return count
