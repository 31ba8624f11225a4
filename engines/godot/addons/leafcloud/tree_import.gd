@tool
extends EditorScenePostImportPlugin
## Makes the root of an imported tree a LeafcloudTree, that of a forest a LeafcloudForest, and turns off Godot's own levels
## of its meshes.

const LeafcloudTree := preload("leafcloud_tree.gd")
const LeafcloudForest := preload("leafcloud_forest.gd")


func _post_process(scene: Node) -> void:
	LeafcloudTree.adopt(scene)
	LeafcloudForest.adopt(scene)
