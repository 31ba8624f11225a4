extends SceneTree
## Draws a texture of small opaque squares with the shader of the levels: godot --script shares.gd -- FOLDER. Writes
## shares.json: the drawn share of the square at each number of texels a pixel in TEXELS, without and with multisampling.

const TEXELS := [0.4, 1.3, 3.1, 9.0, 40.0]
const SIDE := 1024

## Width of an opaque square and of its cell, in texels.
const OPAQUE := 4
const CELL := 8

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var folder := OS.get_cmdline_user_args()[0]
	Stage.light(root, Color.BLACK, 0.0)
	var camera := Stage.camera(root)
	camera.projection = Camera3D.PROJECTION_ORTHOGONAL
	camera.position.z = 1.0
	var square := MeshInstance3D.new()
	square.mesh = QuadMesh.new()
	square.material_override = _material()
	root.add_child(square)
	var found := []
	for msaa: Viewport.MSAA in [Viewport.MSAA_DISABLED, Viewport.MSAA_4X]:
		root.msaa_3d = msaa
		var shares := []
		for texels: float in TEXELS:
			camera.size = root.size.y * texels / SIDE
			await Stage.drawn(self)
			shares.append(_mean_light(root.get_texture().get_image(), minf(SIDE / texels, root.size.y)))
		found.append(shares)
	Stage.write(folder + "/shares.json", {"shares": found})
	quit()


func _material() -> ShaderMaterial:
	var image := Image.create(SIDE, SIDE, false, Image.FORMAT_RGBA8)
	image.fill(Color(1.0, 1.0, 1.0, 0.0))
	for x in range(0, SIDE, CELL):
		for y in range(0, SIDE, CELL):
			image.fill_rect(Rect2i(x, y, OPAQUE, OPAQUE), Color.WHITE)
	image.generate_mipmaps()
	var material := ShaderMaterial.new()
	material.shader = load("res://addons/leafcloud/level_two_sided_unlit.gdshader")
	material.set_shader_parameter("base_texture", ImageTexture.create_from_image(image))
	material.set_shader_parameter("alpha_cutoff", 0.5)
	return material


## The mean light in a square of so many pixels in the middle of the picture.
func _mean_light(picture: Image, pixels: float) -> float:
	var sum := 0.0
	for y in picture.get_height():
		for x in picture.get_width():
			sum += picture.get_pixel(x, y).srgb_to_linear().r
	return sum / (pixels * pixels)
