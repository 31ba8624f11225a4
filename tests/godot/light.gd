extends SceneTree
## Draws a tree against the sun: godot --script light.gd -- FOLDER. Writes light.json: for each surface of level 1 what
## its shader got, and the light of the picture as it is, and without light through leaves.

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	var tree: LeafcloudTree = load("res://tree.glb").instantiate()
	root.add_child(tree)
	Stage.light(root, Color.BLACK, 0.0)
	var sun := DirectionalLight3D.new()
	root.add_child(sun)
	sun.look_at_from_position(Vector3(0, 0, -1), Vector3.ZERO)
	var camera := Stage.camera(root)
	var levels: Array = LeafcloudTree.trees_of(tree)[0]
	var numbers: Dictionary = levels[0].get_meta(LeafcloudTree.META)
	camera.far = 5.0 * numbers["fade_out"].x
	camera.position = LeafcloudTree.common_box(levels).get_center() + Vector3(0, 0, 1.5 * numbers["fade_out"].x)
	var found := {"surfaces": [], "light": []}
	var materials: Array[ShaderMaterial] = []
	for i in levels[1].mesh.get_surface_count():
		var material := levels[1].mesh.surface_get_material(i) as ShaderMaterial
		var texture: Variant = material.get_shader_parameter("translucency_texture")
		found["surfaces"].append({
			"translucency": material.get_shader_parameter("translucency"),
			"has_texture": texture != null,
			"light_strength": material.get_shader_parameter("light_strength"),
		})
		materials.append(material)
	found["light"].append(await _light())
	for material in materials:
		material.set_shader_parameter("translucency", 0.0)
	found["light"].append(await _light())
	Stage.write(folder + "/light.json", found)
	quit()


func _light() -> float:
	await Stage.drawn(self)
	var picture := root.get_texture().get_image()
	var sum := 0.0
	for y in picture.get_height():
		for x in picture.get_width():
			sum += picture.get_pixel(x, y).srgb_to_linear().get_luminance()
	return sum
