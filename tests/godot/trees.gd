extends SceneTree
## Writes the ranges of all levels of all trees of a file: godot --script trees.gd -- FOLDER. trees.json has for each tree
## its name and the begin and end of each level.

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	var trees: LeafcloudTree = load("res://tree.glb").instantiate()
	root.add_child(trees)
	var camera := Stage.camera(root)
	for _frame in 3:
		await process_frame
	var found := []
	for levels in LeafcloudTree.trees_of(trees):
		var ranges := levels.map(func(part: MeshInstance3D) -> Array:
			return [part.visibility_range_begin, part.visibility_range_end])
		found.append({"name": String(levels[0].name).get_slice("_LOD", 0), "ranges": ranges})
	Stage.write(folder + "/trees.json", found)
	quit()
