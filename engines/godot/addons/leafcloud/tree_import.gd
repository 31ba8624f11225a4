@tool
extends EditorScenePostImportPlugin
## Makes the root of an imported tree a LeafcloudTree, and turns off Godot's own levels of its meshes.

const META := &"leafcloud"
## The greatest value: Godot then draws the meshes as they are. Its simplification removes leaves.
const MOST_DETAIL := 128.0

const LeafcloudTree := preload("leafcloud_tree.gd")


func _post_process(scene: Node) -> void:
	var trees := LeafcloudTree.trees_of(scene)
	for levels in trees:
		for part: MeshInstance3D in levels:
			part.lod_bias = MOST_DETAIL
	if not trees.is_empty():
		scene.set_script(LeafcloudTree)
