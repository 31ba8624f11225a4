extends SceneTree
## Draws an imported tree and writes pictures and tables for the tests:
##
##     godot --script views.gd -- FOLDER
##
## For each hand-over, from DIRECTIONS directions: the tree just before it (before_N_DIRECTION.png), and the next level from
## the same place (after_N_DIRECTION.png), by a smaller LOD distance. The tree a step before and a step after three distances (NAME_N_0.png and NAME_N_1.png):
## begin and end of the cross-fade, and apart from it. For each level: the levels that draw a pixel at some distances
## (drawn.json).

const SHARES := [0.5, 0.76, 1.2, 1.74, 2.64, 4.0]
const STEP := 0.001
const DIRECTIONS := 8

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	var tree: LeafcloudTree = load("res://tree.glb").instantiate()
	root.add_child(tree)
	Stage.light(root, Color(0.5, 0.5, 0.5), 1.0)
	var camera := Stage.camera(root)
	var levels: Array = LeafcloudTree.trees_of(tree)[0]
	var scale: float = levels[0].global_basis.x.length()
	var centre: Vector3 = levels[0].global_transform * LeafcloudTree.common_box(levels).get_center()
	var drawn := []
	for number in levels.size():
		var level: Dictionary = levels[number].get_meta(LeafcloudTree.META)
		for share: float in SHARES:
			var near: float = 2.0 * level["radius"] * scale
			var distance: float = share * (level["switch_distance"] if number > 0 else near)
			await _look(camera, centre, distance)
			drawn.append({"distance": distance, "levels": await _drawn(levels)})
		if number + 1 < levels.size():
			var fade: Vector2 = level["fade_out"]
			for named: Array in [["before", 1.0], ["after", 1.0 / 1.3]]:
				tree.lod_distance = named[1]
				for i in DIRECTIONS:
					await _look(camera, centre, 0.999 * fade.x, _direction(i))
					_save("%s/%s_%d_%d.png" % [folder, named[0], number, i])
			tree.lod_distance = 1.0
			for named: Array in [["begin", fade.x], ["end", fade.y], ["apart", 0.97 * fade.x]]:
				for side in 2:
					await _look(camera, centre, named[1] * (1.0 + STEP * (2 * side - 1)))
					_save("%s/%s_%d_%d.png" % [folder, named[0], number, side])
	Stage.write(folder + "/drawn.json", {"levels": levels.size(), "drawn": drawn})
	quit()


## Directions all around the tree, from a little below it to far above it.
func _direction(number: int) -> Vector3:
	var up := lerpf(-0.1, 0.8, number / (DIRECTIONS - 1.0))
	return Vector3.BACK.rotated(Vector3.UP, 2.4 * number) * sqrt(1.0 - up * up) + up * Vector3.UP


func _look(camera: Camera3D, centre: Vector3, distance: float, from := Vector3(0.4, 0.15, 1.0)) -> void:
	camera.position = centre + from.normalized() * distance
	camera.look_at(centre)
	camera.near = 0.05 * distance
	camera.far = 3.0 * distance
	await Stage.drawn(self)


func _save(path: String) -> void:
	root.get_texture().get_image().save_png(path)


## The levels that change the picture when they are shown alone.
func _drawn(levels: Array) -> Array:
	var found := []
	var empty := await _pixels_with(levels, null)
	for number in levels.size():
		if await _pixels_with(levels, levels[number]) != empty:
			found.append(number)
	for part: Node3D in levels:
		part.show()
	return found


func _pixels_with(levels: Array, shown: Node3D) -> PackedByteArray:
	for part: Node3D in levels:
		part.visible = part == shown
	await Stage.drawn(self)
	return root.get_texture().get_image().get_data()
