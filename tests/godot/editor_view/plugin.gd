@tool
extends EditorPlugin
## Opens res://scene.tscn in the editor and quits. Writes res://out: editor_KIND_N.png, the 3D view where the level N should
## be drawn, KIND: tree or forest; editor.json: the levels that change the picture there when they are shown alone.

const Stage := preload("res://stage.gd")


func _enter_tree() -> void:
	_write.call_deferred()


func _write() -> void:
	OS.low_processor_usage_mode = false
	await get_tree().create_timer(2.0).timeout
	EditorInterface.open_scene_from_path("res://scene.tscn")
	EditorInterface.set_main_screen_editor("3D")
	await get_tree().create_timer(1.0).timeout
	var scene := EditorInterface.get_edited_scene_root()
	var tree: LeafcloudTree = scene.get_child(0)
	var levels: Array = LeafcloudTree.trees_of(tree)[0]
	var numbers := levels.map(func(level: Node) -> Dictionary: return level.get_meta(LeafcloudTree.META))
	var box := LeafcloudTree.common_box(levels)
	tree.scale = Vector3.ONE / numbers[0]["radius"]
	tree.position = -box.get_center() / numbers[0]["radius"]
	var forest: LeafcloudForest = scene.get_child(1)
	forest.tree = load(tree.scene_file_path)
	forest.places = [tree.transform] as Array[Transform3D]
	var view := EditorInterface.get_editor_viewport_3d(0)
	var distance := view.get_camera_3d().global_position.length()
	var found := {"tree": [], "forest": []}
	for number in levels.size():
		var wanted: float = maxf(1.3 * numbers[number]["switch_distance"], 2.0 * numbers[0]["radius"])
		for shown: Node3D in [tree, forest]:
			tree.visible = shown == tree
			forest.visible = shown == forest
			shown.lod_distance = distance * numbers[0]["radius"] / wanted / LeafcloudTree.view_factor(view)
			await Stage.drawn(get_tree())
			var name := "tree" if shown == tree else "forest"
			view.get_texture().get_image().save_png("res://out/editor_%s_%d.png" % [name, number])
			found[name].append(await _drawn(levels if shown == tree else forest.get_children(), view))
	Stage.write("res://out/editor.json", found)
	get_tree().quit()


func _drawn(parts: Array, view: Viewport) -> Array:
	var found := []
	var empty := await _pixels_with(parts, -1, view)
	for number in parts.size():
		if await _pixels_with(parts, number, view) != empty:
			found.append(number)
	await _pixels_with(parts, -2, view)
	return found


## The picture with one part, with none (-1) or with all (-2).
func _pixels_with(parts: Array, shown: int, view: Viewport) -> PackedByteArray:
	for number in parts.size():
		# Forests show and hide their parts themselves.
		parts[number].layers = 1 if shown == number or shown == -2 else 0
	await Stage.drawn(get_tree())
	return view.get_texture().get_image().get_data()
