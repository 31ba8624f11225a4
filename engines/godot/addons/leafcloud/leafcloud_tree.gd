@tool
class_name LeafcloudTree
extends Node3D
## A tree, or the trees of one file, that show the level for their distance from the camera, by visibility ranges. The root
## of an imported GLB file of Leafcloud gets this script.

const META := &"leafcloud"

## Metadata of a shadow proxy: numbers as of a level, and in "last_level" the farthest level that it stands for.
const SHADOW := &"leafcloud_shadow"

## The field of view in radians and the height in pixels that the distances in the file are for.
const FILE_VIEW := Vector2(deg_to_rad(50.0), 1080.0)

## The greatest value: Godot then draws the meshes as they are. Its simplification removes leaves.
const MOST_DETAIL := 128.0

## Factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time.
@export_range(0.1, 10.0, 0.01, "or_greater") var lod_distance := 1.0:
	set(value):
		lod_distance = value
		_measured = 0.0

## Largest change of a tree's switch distances by its place, as a fraction, so that neighbors do not switch together.
## 0: none.
@export_range(0.0, 0.5, 0.01) var stagger := 0.1:
	set(value):
		stagger = value
		_measured = 0.0

## The factor on the file's distances that the ranges were set for; 0: none yet.
var _measured := 0.0
var _measured_at := Transform3D.IDENTITY


## Reads a GLB file while the game runs, from any folder. Null, with an error in the log, if it cannot be read or has no
## levels. Not for several threads at a time.
static func load_glb(path: String) -> LeafcloudTree:
	var reader: GLTFDocumentExtension = load((LeafcloudTree as Script).resource_path.get_base_dir() + "/gltf_levels.gd").new()
	GLTFDocument.register_gltf_document_extension(reader, true)
	var document := GLTFDocument.new()
	var state := GLTFState.new()
	var scene: Node = document.generate_scene(state) if document.append_from_file(path, state) == OK else null
	GLTFDocument.unregister_gltf_document_extension(reader)
	if scene == null:
		return null
	adopt(scene)
	if not scene is LeafcloudTree:
		push_error("%s has no levels of Leafcloud. Load the file with all levels, without _LOD in its name." % path)
		scene.free()
		return null
	return scene as LeafcloudTree


## Makes the root of a scene with levels a tree, and turns off Godot's own levels of its meshes.
static func adopt(scene: Node) -> void:
	var trees := trees_of(scene)
	for levels in trees:
		for part in parts_of(levels):
			part.lod_bias = MOST_DETAIL
			if part.has_meta(SHADOW):
				part.cast_shadow = GeometryInstance3D.SHADOW_CASTING_SETTING_SHADOWS_ONLY
				for number: int in part.get_meta(SHADOW)["last_level"] + 1:
					levels[number].cast_shadow = GeometryInstance3D.SHADOW_CASTING_SETTING_OFF
	if not trees.is_empty():
		scene.set_script(LeafcloudTree)


## The nodes with levels among these, one array a tree, by number.
static func chains_in(nodes: Array[Node]) -> Array[Array]:
	var chains := {}
	for node in nodes:
		if node.has_meta(META):
			var number: int = node.get_meta(META).get("chain", 0)
			chains[number] = chains.get(number, []) + [node]
	var found: Array[Array] = []
	for levels: Array in chains.values():
		levels.sort_custom(func(a: Node, b: Node) -> bool: return a.get_meta(META)["level"] < b.get_meta(META)["level"])
		found.append(levels)
	return found


## All trees below a node: the mesh instances of their levels.
static func trees_of(root: Node) -> Array[Array]:
	return chains_in(root.find_children("*", "MeshInstance3D", true, false))


## All that is drawn of a tree: its levels, and its shadow proxy if it has one.
static func parts_of(levels: Array) -> Array[MeshInstance3D]:
	var parts: Array[MeshInstance3D] = []
	parts.assign(levels)
	for node in levels[0].get_parent().get_children():
		if node.has_meta(SHADOW) and node.get_meta(SHADOW)["chain"] == levels[0].get_meta(META)["chain"]:
			parts.append(node)
	return parts


## The numbers of a level or of a shadow proxy.
static func numbers_of(part: Node) -> Dictionary:
	return part.get_meta(SHADOW if part.has_meta(SHADOW) else META)


## The viewport that shows a node: in the editor its first 3D view, because the edited scene has none.
static func view_of(node: Node) -> Viewport:
	# The editor's class is unknown in a game.
	return Engine.get_singleton(&"EditorInterface").get_editor_viewport_3d(0) if Engine.is_editor_hint() else node.get_viewport()


## The factor on the file's distances for this view: levels keep their size in pixels.
static func view_factor(viewport: Viewport) -> float:
	var camera := viewport.get_camera_3d() if viewport else null
	if camera == null or camera.projection != Camera3D.PROJECTION_PERSPECTIVE:
		return 1.0
	# The rectangle of the viewport may be stretched to the window.
	var size := Vector2(viewport.get_texture().get_size())
	var upright := camera.keep_aspect == Camera3D.KEEP_HEIGHT
	var tangent := tan(0.5 * deg_to_rad(camera.fov)) * (1.0 if upright else size.y / size.x)
	return size.y * viewport.scaling_3d_scale / FILE_VIEW.y * tan(0.5 * FILE_VIEW.x) / tangent


## lc_stagger of leafcloud.gdshaderinc.
static func stagger_at(place: Vector3, amount: float) -> float:
	var turns := place.dot(Vector3(0.7549, 0.4387, -0.5698)) - 0.25
	return 1.0 + amount * (4.0 * absf(turns - floorf(turns) - 0.5) - 1.0)


func _process(_delta: float) -> void:
	var factor := lod_distance * view_factor(view_of(self)) * global_basis.x.length()
	if absf(factor - _measured) > 0.001 * factor or global_transform != _measured_at:
		_measured = factor
		_measured_at = global_transform
		_set_ranges(factor)


func _set_ranges(factor: float) -> void:
	for levels in trees_of(self):
		var box := common_box(levels)
		for part in parts_of(levels):
			var level := numbers_of(part)
			var own := factor * stagger_at(part.global_position, stagger)
			# Godot measures from the middle of the box, so all levels have the same one.
			part.custom_aabb = box
			part.visibility_range_begin = level["fade_in"].x * own
			part.visibility_range_end = level["fade_out"].y * own if level["fade_out"].y < INF else 0.0
			part.set_instance_shader_parameter("lod_factor", factor / global_basis.x.length())
			part.set_instance_shader_parameter("lod_stagger", stagger)


## The smallest box around the center of the leaves that holds all levels, in the coordinates of the levels.
static func common_box(levels: Array) -> AABB:
	var numbers: Array = levels[0].get_meta(META)["centre"]
	var centre := Vector3(numbers[0], numbers[1], numbers[2])
	var half := Vector3.ZERO
	for part: MeshInstance3D in levels:
		var box := part.mesh.get_aabb()
		half = half.max((box.position - centre).abs()).max((box.end - centre).abs())
	return AABB(centre - half, 2.0 * half)
