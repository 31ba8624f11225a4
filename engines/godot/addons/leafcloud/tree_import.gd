@tool
extends EditorScenePostImportPlugin
## Makes the root of an imported tree a LeafcloudTree, and turns off Godot's own levels of its meshes.

const LeafcloudTree := preload("leafcloud_tree.gd")


func _post_process(scene: Node) -> void:
	LeafcloudTree.adopt(scene)
