@tool
extends RefCounted
## The shadow proxies of NAME_shadow.glb: few billboards that cast the shadow of all leaves.

const LeafTexture := preload("leaf_texture.gd")

const ENDING := "_shadow"


## The meshes of the file beside the one that is read, by the names of their trees; empty if there is no such file.
static func meshes_beside(state: GLTFState) -> Dictionary[String, ImporterMesh]:
	var found: Dictionary[String, ImporterMesh] = {}
	var path := state.base_path.path_join(state.filename + ENDING + ".glb")
	if not FileAccess.file_exists(path):
		path = state.base_path.path_join(state.filename.trim_suffix("_forest") + ENDING + ".glb")
	var own := GLTFState.new()
	# The importer would make files of the images.
	own.handle_binary_image_mode = GLTFState.HANDLE_BINARY_IMAGE_MODE_EMBED_AS_UNCOMPRESSED
	if not FileAccess.file_exists(path) or GLTFDocument.new().append_from_file(path, own) != OK:
		return found
	for node in own.get_nodes():
		if node.mesh >= 0:
			found[node.original_name.trim_suffix(ENDING)] = own.get_meshes()[node.mesh].mesh
	for material: BaseMaterial3D in own.get_materials():
		material.albedo_texture = LeafTexture.with_plain_mips(material.albedo_texture)
	return found


## A mesh of the proxy and the trunk, whose first surface has this number in the mesh of a level.
static func with_trunk(proxy: ImporterMesh, level: ImporterMesh, trunk: int) -> ImporterMesh:
	var joined := ImporterMesh.new()
	for i in proxy.get_surface_count():
		_copy_surface(proxy, i, joined)
	for i in range(trunk, level.get_surface_count()):
		_copy_surface(level, i, joined)
	return joined


static func _copy_surface(from: ImporterMesh, i: int, to: ImporterMesh) -> void:
	# The arrays of the level are changed later.
	var arrays := from.get_surface_arrays(i).duplicate()
	to.add_surface(
		from.get_surface_primitive_type(i), arrays, [], {}, from.get_surface_material(i),
		from.get_surface_name(i), from.get_surface_format(i))
