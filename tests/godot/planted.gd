extends SceneTree
## Writes the places of the forest of forest.glb, as the editor imports it and as a running game reads it:
## godot --script planted.gd -- FOLDER.

const Stage := preload("stage.gd")


func _initialize() -> void:
	await process_frame
	var found := []
	for forest: LeafcloudForest in [
		load("res://forest.glb").instantiate(),
		LeafcloudForest.load_glb(ProjectSettings.globalize_path("res://forest.glb")),
	]:
		root.add_child(forest)
		await process_frame
		var places := forest.places.map(func(place: Transform3D) -> Array:
			return [place.origin.x, place.origin.y, place.origin.z, place.basis.x.length()])
		found.append({"places": places, "levels": forest.get_child_count()})
	Stage.write(OS.get_cmdline_user_args()[0] + "/planted.json", found)
	quit()
