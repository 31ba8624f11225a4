@tool
extends EditorPlugin
## Makes the importer read the levels of Leafcloud's GLB files.

const Levels := preload("gltf_levels.gd")
const TreeImport := preload("tree_import.gd")

var _levels := Levels.new()
var _trees := TreeImport.new()


func _enter_tree() -> void:
	GLTFDocument.register_gltf_document_extension(_levels, true)
	add_scene_post_import_plugin(_trees)


func _exit_tree() -> void:
	remove_scene_post_import_plugin(_trees)
	GLTFDocument.unregister_gltf_document_extension(_levels)
