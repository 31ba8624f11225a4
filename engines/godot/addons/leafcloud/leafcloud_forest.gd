@tool
class_name LeafcloudForest
extends Node3D
## Many copies of one tree, each with the level for its own distance from the camera: one MultiMesh for each level.
##
## The root of an imported NAME_forest.glb gets this script. Or set `tree` and `places`, or call `plant`. Trees are sorted into levels again when the camera has moved, which takes
## some milliseconds for a thousand trees.

const Levels := preload("leafcloud_tree.gd")

## Metadata of level 0 with the places of a forest.
const PLACES := &"leafcloud_places"

## A scene that was imported from a GLB file of Leafcloud. Of several trees in it, each place has all.
@export var tree: PackedScene:
	set(value):
		tree = value
		_rebuild()

## The place of each copy, in the coordinates of this node. Copies may turn, and scale by the same factor in all
## directions.
@export var places: Array[Transform3D] = []:
	set(value):
		places = value
		_rebuild()

## Factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time.
@export_range(0.1, 10.0, 0.01, "or_greater") var lod_distance := 1.0

## Largest change of a tree's switch distances by its place, as a fraction, so that neighbors do not switch together.
## 0: none.
@export_range(0.0, 0.5, 0.01) var stagger := 0.1:
	set(value):
		stagger = value
		_factor = 0.0

## The camera may move by this share of the shortest hand-over distance before trees are sorted again.
const PATIENCE := 0.02

## One entry a level or shadow proxy: its numbers in the file, the center of its leaves in the tree, its place in the tree, and its drawing.
var _levels: Array[Dictionary] = []
var _sorted_from := Vector3.ZERO
var _sorted_at := Transform3D.IDENTITY
var _factor := 0.0


## Reads NAME_forest.glb while the game runs, from any folder. Null, with an error in the log, if it cannot be read or has
## no forest. Not for several threads at a time.
static func load_glb(path: String) -> LeafcloudForest:
	var scene := Levels.load_glb(path)
	if scene == null:
		return null
	adopt(scene)
	var root: Node = scene
	if not root is LeafcloudForest:
		push_error("%s has no forest. Load the file of Export Forest, which ends in _forest.glb." % path)
		root.free()
		return null
	return root as LeafcloudForest


## Makes the root of a scene with levels and places a forest. Its tree is that scene.
static func adopt(scene: Node) -> void:
	var planted: Array[Transform3D] = []
	for levels in Levels.trees_of(scene):
		planted.assign(levels[0].get_meta(PLACES, planted))
	if planted.is_empty():
		return
	var packed := PackedScene.new()
	packed.pack(scene)
	for child in scene.get_children():
		scene.remove_child(child)
		child.free()
	scene.set_script(LeafcloudForest)
	scene.set("tree", packed)
	scene.set("places", planted)


func _ready() -> void:
	_rebuild()


## Replaces all copies.
func plant(new_places: Array[Transform3D]) -> void:
	places = new_places


func _rebuild() -> void:
	_clear()
	if tree == null or not is_node_ready():
		return
	var source: Node3D = tree.instantiate()
	for levels in Levels.trees_of(source):
		var box := Levels.common_box(levels)
		for part in Levels.parts_of(levels):
			var offset := part.transform
			_levels.append({
				"numbers": Levels.numbers_of(part),
				"centre": offset * box.get_center(),
				"offset": offset,
				"drawing": _drawing(part, offset * box),
			})
	source.free()
	if _levels.is_empty():
		push_error("%s has no levels of Leafcloud. Use the file with all levels, without _LOD in its name; if it was imported before the plugin was turned on, reimport it." % tree.resource_path)


func _process(_delta: float) -> void:
	var view := Levels.view_of(self)
	var camera := view.get_camera_3d()
	if camera == null or _levels.is_empty():
		return
	var factor := lod_distance * Levels.view_factor(view)
	var eye := to_local(camera.global_position)
	var ends := _levels.map(func(level: Dictionary) -> float: return level["numbers"]["fade_out"].x)
	var patience: float = PATIENCE * ends.min() * factor * _least_scale()
	var has_moved := eye.distance_to(_sorted_from) > patience or global_transform != _sorted_at
	if has_moved or absf(factor - _factor) > 0.001 * factor:
		_sorted_from = eye
		_sorted_at = global_transform
		_factor = factor
		_sort(eye, factor, patience)


func _least_scale() -> float:
	var least := INF
	for place in places:
		least = minf(least, place.basis.x.length())
	return least


func _clear() -> void:
	for level in _levels:
		level["drawing"].queue_free()
	_levels.clear()
	_factor = 0.0


func _drawing(part: MeshInstance3D, box: AABB) -> MultiMeshInstance3D:
	var copies := MultiMesh.new()
	copies.transform_format = MultiMesh.TRANSFORM_3D
	copies.mesh = part.mesh
	copies.instance_count = places.size()
	copies.visible_instance_count = 0
	copies.custom_aabb = _box_of_all(box)
	var drawing := MultiMeshInstance3D.new()
	drawing.multimesh = copies
	drawing.cast_shadow = part.cast_shadow
	drawing.lod_bias = part.lod_bias
	add_child(drawing)
	return drawing


func _box_of_all(box: AABB) -> AABB:
	var whole := AABB()
	for i in places.size():
		whole = places[i] * box if i == 0 else whole.merge(places[i] * box)
	return whole


## Gives every copy to the level for its distance, or to two while they fade. `patience`: how far the camera may move until
## copies are sorted again; the shader leaves out what is drawn too much.
func _sort(eye: Vector3, factor: float, patience: float) -> void:
	for level in _levels:
		var numbers: Dictionary = level["numbers"]
		var range_in: float = numbers["fade_in"].x
		var range_out: float = numbers["fade_out"].y
		var centre: Vector3 = level["centre"]
		var offset: Transform3D = level["offset"]
		var chosen: Array[Transform3D] = []
		for place in places:
			var distance := (place * centre).distance_to(eye)
			var origin := global_transform * (place * offset.origin)
			var scale := place.basis.x.length() * factor * Levels.stagger_at(origin, stagger)
			if distance >= range_in * scale - patience and distance < range_out * scale + patience:
				chosen.append(place)
		var drawing: MultiMeshInstance3D = level["drawing"]
		drawing.multimesh.visible_instance_count = chosen.size()
		drawing.visible = not chosen.is_empty()
		drawing.set_instance_shader_parameter("lod_factor", factor)
		drawing.set_instance_shader_parameter("lod_stagger", stagger)
		for slot in chosen.size():
			drawing.multimesh.set_instance_transform(slot, chosen[slot] * offset)
