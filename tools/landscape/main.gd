extends Node3D
## The landscape of docs/guide.md: forests, ground, sun and sky. With a file as argument it saves a picture and quits.


func _ready() -> void:
	for kind: String in ["birch", "walnut"]:
		add_child(load("res://trees/%s_forest.glb" % kind).instantiate())
	var ground: Node3D = load("res://ground.glb").instantiate()
	add_child(ground)
	var grass := StandardMaterial3D.new()
	grass.albedo_color = Color(0.33, 0.4, 0.18)
	grass.roughness = 1.0
	for mesh: MeshInstance3D in ground.find_children("*", "MeshInstance3D", true, false):
		mesh.material_override = grass
	add_child(_sky())
	var sun := DirectionalLight3D.new()
	sun.rotation_degrees = Vector3(-38.0, -60.0, 0.0)
	sun.light_color = Color(1.0, 0.95, 0.85)
	sun.light_energy = 1.7
	sun.shadow_enabled = true
	sun.directional_shadow_max_distance = 140.0
	add_child(sun)
	var camera := Camera3D.new()
	camera.fov = 60.0
	add_child(camera)
	camera.look_at_from_position(Vector3(-14.0, 3.4, 58.0), Vector3(0.0, 4.5, 0.0))
	var arguments := OS.get_cmdline_user_args()
	if not arguments.is_empty():
		for frame in 4:
			await RenderingServer.frame_post_draw
		get_viewport().get_texture().get_image().save_png(arguments[0])
		get_tree().quit()


func _sky() -> WorldEnvironment:
	var world := WorldEnvironment.new()
	var sky := ProceduralSkyMaterial.new()
	sky.sky_top_color = Color(0.25, 0.45, 0.78)
	sky.sky_horizon_color = Color(0.78, 0.83, 0.88)
	sky.ground_horizon_color = sky.sky_horizon_color
	sky.ground_bottom_color = Color(0.5, 0.58, 0.45)
	world.environment = Environment.new()
	world.environment.background_mode = Environment.BG_SKY
	world.environment.sky = Sky.new()
	world.environment.sky.sky_material = sky
	world.environment.ambient_light_source = Environment.AMBIENT_SOURCE_SKY
	world.environment.ambient_light_energy = 0.7
	world.environment.tonemap_mode = Environment.TONE_MAPPER_FILMIC
	world.environment.fog_enabled = true
	world.environment.fog_light_color = Color(0.72, 0.78, 0.84)
	world.environment.fog_density = 0.0007
	world.environment.fog_sky_affect = 0.0
	return world
