@tool
extends EditorScenePostImportPlugin
## Makes the root of an imported tree a LeafcloudTree.

const META := &"leafcloud"
const LeafcloudTree := preload("leafcloud_tree.gd")


func _post_process(scene: Node) -> void:
	for node in scene.find_children("*", "MeshInstance3D", true, false):
		if node.has_meta(META):
			scene.set_script(LeafcloudTree)
			return
