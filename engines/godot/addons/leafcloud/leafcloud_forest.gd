class_name LeafcloudForest
extends Node3D
## Many copies of one tree, each with the level for its own distance from the camera: one MultiMesh for each mesh of
## each level.
##
## Set `tree` and `places`, or call `plant`. Trees are sorted into levels again when the camera has moved, which takes
## some milliseconds for a thousand trees.

const Levels := preload("leafcloud_tree.gd")

## A scene that was imported from a GLB file of Leafcloud.
@export var tree: PackedScene

## The place of each copy, in the coordinates of this node. Copies may turn, and scale by the same factor in all
## directions.
@export var places: Array[Transform3D] = []

## Factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time.
@export_range(0.1, 10.0, 0.01, "or_greater") var lod_distance := 1.0

## The camera may move by this share of the shortest hand-over distance before trees are sorted again.
const PATIENCE := 0.02

## One entry a level: its numbers in the file, and its drawings.
var _levels: Array[Dictionary] = []
var _centre := Vector3.ZERO
var _sorted_for := Transform3D()
var _factor := 0.0


func _ready() -> void:
	if tree != null:
		plant(places)


## Replaces all copies.
func plant(new_places: Array[Transform3D]) -> void:
	places = new_places
	_clear()
	var source: Node3D = tree.instantiate()
	var levels := Levels.levels_of(source)
	var box := Levels.common_box(levels)
	_centre = box.get_center()
	for parts in levels:
		var drawings: Array[MultiMeshInstance3D] = []
		for part: MeshInstance3D in parts:
			drawings.append(_drawing(part, part.transform if part != parts[0] else Transform3D(), box))
		_levels.append({"numbers": parts[0].get_meta(Levels.META), "drawings": drawings})
	source.free()


func _process(_delta: float) -> void:
	var camera := get_viewport().get_camera_3d()
	if camera == null or _levels.is_empty():
		return
	var factor := lod_distance * Levels.view_factor(get_viewport())
	var nearest: float = _levels[0]["numbers"]["fade_out"].x * factor
	var moved := camera.global_position.distance_to(_sorted_for.origin) > PATIENCE * nearest
	if moved or absf(factor - _factor) > 0.001 * factor:
		_sorted_for = camera.global_transform
		_factor = factor
		_sort(to_local(camera.global_position), factor)


func _clear() -> void:
	for level in _levels:
		for drawing: Node in level["drawings"]:
			drawing.queue_free()
	_levels.clear()
	_factor = 0.0


func _drawing(part: MeshInstance3D, offset: Transform3D, box: AABB) -> MultiMeshInstance3D:
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
	drawing.set_meta("offset", offset)
	add_child(drawing)
	return drawing


func _box_of_all(box: AABB) -> AABB:
	var whole := AABB()
	for i in places.size():
		whole = places[i] * box if i == 0 else whole.merge(places[i] * box)
	return whole


## Gives every copy to the level for its distance, or to two while they fade.
func _sort(eye: Vector3, factor: float) -> void:
	var chosen: Array[PackedInt32Array] = []
	chosen.resize(_levels.size())
	for i in places.size():
		var place := places[i]
		var distance := (place * _centre).distance_to(eye) / (place.basis.x.length() * factor)
		for number in _levels.size():
			var numbers: Dictionary = _levels[number]["numbers"]
			if distance >= numbers["fade_in"].x and distance < numbers["fade_out"].y:
				chosen[number].append(i)
	for number in _levels.size():
		for drawing: MultiMeshInstance3D in _levels[number]["drawings"]:
			drawing.multimesh.visible_instance_count = chosen[number].size()
			drawing.visible = not chosen[number].is_empty()
			drawing.set_instance_shader_parameter("lod_factor", factor)
			var offset: Transform3D = drawing.get_meta("offset")
			for slot in chosen[number].size():
				drawing.multimesh.set_instance_transform(slot, places[chosen[number][slot]] * offset)
