extends SceneTree
## Draws a forest of an imported tree: godot --script forest.gd -- FOLDER. Writes forest.png, and the numbers of trees, of
## drawn copies of leaves and of drawn triangles to forest.json.

const SIDE := 20

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	var scene: PackedScene = load("res://tree.glb")
	var single: Node3D = scene.instantiate()
	var levels: Array = LeafcloudTree.trees_of(single)[0]
	var radius: float = levels[0].get_meta(LeafcloudTree.META)["radius"]
	var full := _triangles(levels[0].mesh)
	single.free()
	var forest := LeafcloudForest.new()
	forest.tree = scene
	var random := RandomNumberGenerator.new()
	random.seed = 7
	var places: Array[Transform3D] = []
	for x in SIDE:
		for z in SIDE:
			var turn := Basis(Vector3.UP, random.randf() * TAU).scaled(Vector3.ONE * random.randf_range(0.7, 1.3))
			var where := Vector3(x - 0.5 * SIDE + random.randf(), 0.0, -z - random.randf()) * 3.0 * radius
			places.append(Transform3D(turn, where))
	forest.places = places
	root.add_child(forest)
	var sun := DirectionalLight3D.new()
	sun.rotation_degrees = Vector3(-50, -30, 0)
	root.add_child(sun)
	Stage.light(root, Color(0.7, 0.8, 0.9), 0.7)
	var camera := Stage.camera(root)
	camera.far = 400.0 * radius
	camera.near = 0.1 * radius
	camera.position = Vector3(0.0, 4.0 * radius, 8.0 * radius)
	camera.look_at(Vector3(0.0, 0.0, -20.0 * radius))
	await Stage.drawn(self)
	root.get_texture().get_image().save_png(folder + "/forest.png")
	var drawn := 0
	var leaves := 0
	for level in forest._levels:
		var copies: MultiMesh = level["drawing"].multimesh
		leaves += copies.visible_instance_count
		drawn += copies.visible_instance_count * _triangles(copies.mesh)
	Stage.write(folder + "/forest.json", {"trees": places.size(), "leaves": leaves, "drawn": drawn, "without_levels": full * places.size()})
	quit()


func _triangles(mesh: Mesh) -> int:
	var count := 0
	for i in mesh.get_surface_count():
		count += mesh.surface_get_arrays(i)[Mesh.ARRAY_INDEX].size() / 3
	return count
