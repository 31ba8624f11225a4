extends RefCounted
## What the scripts beside this file share: light, a camera and the time to draw.


## Adds even light of this strength, and a background of one color.
static func light(root: Node, background: Color, strength: float) -> void:
	var world := WorldEnvironment.new()
	world.environment = Environment.new()
	world.environment.background_mode = Environment.BG_COLOR
	world.environment.background_color = background
	world.environment.ambient_light_source = Environment.AMBIENT_SOURCE_COLOR
	world.environment.ambient_light_color = Color.WHITE
	world.environment.ambient_light_energy = strength
	root.add_child(world)


## Adds a camera for which files of Leafcloud have their distances.
static func camera(root: Node) -> Camera3D:
	var made := Camera3D.new()
	made.fov = 50.0
	root.add_child(made)
	made.make_current()
	return made


## Waits until the scene is drawn as it is now.
static func drawn(tree: SceneTree) -> void:
	for _frame in 3:
		await tree.process_frame
	await RenderingServer.frame_post_draw


static func write(path: String, content: Variant) -> void:
	var file := FileAccess.open(path, FileAccess.WRITE)
	file.store_string(JSON.stringify(content))
	file.close()
