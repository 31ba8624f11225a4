@tool
extends GLTFDocumentExtension
## Reads the levels of a tree from NAME.glb: all of them, not only the leaves that plain readers show.
##
## The morph targets become a vertex attribute (CUSTOM3), because a MultiMesh has no blend shapes. The materials become
## shaders that morph, fade, prune and blow the leaves by the distance of the camera.

## Metadata of a level's node: its extras in the file, in "chain" the number of its tree, in "shares" the area table of
## its mesh, and in "trunk" the number of the first surface of the trunk.
const META := &"leafcloud"

## The extension with the places of a forest, and the metadata of level 0 that keeps them.
const INSTANCING := "EXT_mesh_gpu_instancing"
const PLACES := &"leafcloud_places"

const LeafcloudTree := preload("leafcloud_tree.gd")
const LeafTexture := preload("leaf_texture.gd")
const ShadowProxy := preload("shadow_proxy.gd")

## By sides, then by light.
const SHADERS := [
	[preload("level_one_sided.gdshader"), preload("level_one_sided_unlit.gdshader")],
	[preload("level_two_sided.gdshader"), preload("level_two_sided_unlit.gdshader")],
]

## Places of the target's three numbers.
const TARGET_FORMAT := (
	Mesh.ARRAY_FORMAT_CUSTOM3 | (Mesh.ARRAY_CUSTOM_RGB_FLOAT << Mesh.ARRAY_FORMAT_CUSTOM3_SHIFT)
)


func _import_preflight(state: GLTFState, extensions: PackedStringArray) -> Error:
	if not extensions.has("MSFT_lod"):
		return ERR_SKIP
	if extensions.has("KHR_texture_basisu"):
		push_warning("Leafcloud: Godot draws the KTX2 textures of this file far too dark. Bake it with --engine godot.")
	# The other levels are in no scene, so that plain readers show the tree once.
	var json := state.json
	var levels := []
	for number in json["nodes"].size():
		var node: Dictionary = json["nodes"][number]
		if not node.get("extras", {}).has("leafcloud"):
			continue
		if not node.get("extensions", {}).has("MSFT_lod"):
			continue
		var ids: Array = node["extensions"]["MSFT_lod"].get("ids", [])
		levels.append_array(ids)
		for id: int in [number] + ids:
			json["nodes"][id]["extras"]["leafcloud"]["chain"] = number
	if levels.is_empty():
		return ERR_SKIP
	var shown: Array = json["scenes"][int(json.get("scene", 0))]["nodes"]
	shown.append_array(levels.filter(func(id: Variant) -> bool: return not shown.has(id)))
	state.json = json
	return OK


func _get_supported_extensions() -> PackedStringArray:
	return ["MSFT_lod", INSTANCING]


func _import_node(state: GLTFState, gltf_node: GLTFNode, json: Dictionary, node: Node) -> Error:
	var extras: Dictionary = json.get("extras", {}).get("leafcloud", {})
	if not extras.has("level"):
		return OK
	var level := extras.duplicate(true)
	var mesh: Dictionary = state.json["meshes"][gltf_node.mesh]
	var tables: Dictionary = mesh.get("extras", {}).get("leafcloud", {})
	if tables.has("area_shares"):
		level["shares"] = tables["area_shares"]
	level["trunk"] = int(tables.get("first_trunk_primitive", mesh["primitives"].size()))
	node.set_meta(META, level)
	if json.get("extensions", {}).has(INSTANCING):
		var own := (node as Node3D).transform
		var places := _instances(state, json["extensions"][INSTANCING]["attributes"])
		# A place moves the tree from the origin; the file has the places within the node of level 0.
		node.set_meta(PLACES, places.map(func(place: Transform3D) -> Transform3D: return own * place * own.affine_inverse()))
	return OK


## The transforms of instances within their node.
static func _instances(state: GLTFState, attributes: Dictionary) -> Array[Transform3D]:
	var moves := _numbers(state, attributes.get("TRANSLATION", -1))
	var turns := _numbers(state, attributes.get("ROTATION", -1))
	var scales := _numbers(state, attributes.get("SCALE", -1))
	var found: Array[Transform3D] = []
	for i in maxi(moves.size() / 3, maxi(turns.size() / 4, scales.size() / 3)):
		var turn := Basis.IDENTITY
		if not turns.is_empty():
			turn = Basis(Quaternion(turns[4 * i], turns[4 * i + 1], turns[4 * i + 2], turns[4 * i + 3]).normalized())
		var scale := Vector3.ONE
		if not scales.is_empty():
			scale = Vector3(scales[3 * i], scales[3 * i + 1], scales[3 * i + 2])
		var move := Vector3.ZERO
		if not moves.is_empty():
			move = Vector3(moves[3 * i], moves[3 * i + 1], moves[3 * i + 2])
		found.append(Transform3D(turn * Basis.from_scale(scale), move))
	return found


## The numbers of an accessor in single precision; none of another kind, or without one.
static func _numbers(state: GLTFState, number: int) -> PackedFloat32Array:
	if number < 0:
		return PackedFloat32Array()
	var accessor: Dictionary = state.json["accessors"][number]
	if accessor["componentType"] != 5126:
		push_warning("Leafcloud: the places of the forest are not in single precision. Export the forest again.")
		return PackedFloat32Array()
	var view: GLTFBufferView = state.buffer_views[int(accessor["bufferView"])]
	var width := 4 if accessor["type"] == "VEC4" else 3
	var start := int(accessor.get("byteOffset", 0))
	return view.load_buffer_view_data(state).slice(start, start + 4 * width * int(accessor["count"])).to_float32_array()


func _import_post(state: GLTFState, root: Node) -> Error:
	var proxies := ShadowProxy.meshes_beside(state)
	for levels: Array in LeafcloudTree.chains_in(root.find_children("*", "", true, false)):
		var own := _leaf_textures(levels[0])
		for number in levels.size():
			var level: Dictionary = levels[number].get_meta(META)
			var next: Dictionary = levels[number + 1].get_meta(META) if number + 1 < levels.size() else {}
			level["fade_in"] = levels[number - 1].get_meta(META)["fade_out"] if number > 0 else Vector2.ZERO
			level["fade_out"] = _fade(level, next)
			levels[number].set_meta(META, level)
		var name := state.get_nodes()[levels[0].get_meta(META)["chain"]].original_name.trim_suffix("_LOD0")
		if proxies.has(name):
			_add_shadow(levels, proxies[name], own, state)
		for level: Node in levels:
			if level is ImporterMeshInstance3D:
				_prepare(level, level.get_meta(META), own, state)
	return OK


## Adds the proxy that casts the shadow of the levels up to the first one of billboards. Farther levels have as few
## triangles themselves.
static func _add_shadow(
	levels: Array, proxy: ImporterMesh, own: Dictionary[Texture2D, Texture2D], state: GLTFState
) -> void:
	var clouds := levels.filter(func(level: Node) -> bool: return level.get_meta(META).has("max_deviation"))
	if clouds.is_empty():
		return
	var first: ImporterMeshInstance3D = clouds[0]
	var numbers: Dictionary = first.get_meta(META)
	var node := ImporterMeshInstance3D.new()
	node.name = first.name.get_slice("_LOD", 0) + "_shadow"
	node.transform = first.transform
	node.mesh = ShadowProxy.with_trunk(proxy, first.mesh, numbers["trunk"])
	var shadow := numbers.duplicate()
	shadow["level"] = 0
	shadow["last_level"] = levels.find(first)
	shadow["fade_in"] = Vector2.ZERO
	shadow["trunk"] = proxy.get_surface_count()
	for name: String in ["transition_start", "transition_end", "prune_start"]:
		shadow.erase(name)
	node.set_meta(LeafcloudTree.SHADOW, shadow)
	first.get_parent().add_child(node)
	node.owner = first.owner
	_prepare(node, shadow, own, state)


## The distances at which the next level begins to appear and at which this one is gone; never for the last one.
static func _fade(level: Dictionary, next: Dictionary) -> Vector2:
	if next.is_empty():
		return Vector2(INF, INF)
	if level.has("transition_end"):
		# At the end itself overlapping leaves have almost no depth order.
		var start := lerpf(level["transition_start"], level["transition_end"], 0.998)
		return Vector2(start, 1.08 * start)
	return Vector2(next["switch_distance"], 1.15 * next["switch_distance"])


## The base textures of the leaves themselves that are cut out, each with the texture that is drawn.
static func _leaf_textures(leaves: Node) -> Dictionary[Texture2D, Texture2D]:
	var found: Dictionary[Texture2D, Texture2D] = {}
	if leaves is ImporterMeshInstance3D:
		for i in leaves.mesh.get_surface_count():
			var material := leaves.mesh.get_surface_material(i) as BaseMaterial3D
			if material != null and material.albedo_texture != null and _is_cut(material):
				found[material.albedo_texture] = LeafTexture.with_mips(material.albedo_texture, material.alpha_scissor_threshold)
	return found


static func _is_cut(material: BaseMaterial3D) -> bool:
	return material.transparency == BaseMaterial3D.TRANSPARENCY_ALPHA_SCISSOR


## Makes the mesh of a level, its leaves and its trunk, follow the camera. `own`: see _leaf_textures.
static func _prepare(
	node: ImporterMeshInstance3D, level: Dictionary, own: Dictionary[Texture2D, Texture2D], state: GLTFState
) -> void:
	var old := node.mesh
	var mesh := ImporterMesh.new()
	for i in old.get_surface_count():
		var arrays := old.get_surface_arrays(i)
		var format := old.get_surface_format(i)
		if old.get_blend_shape_count() > 0:
			var target: PackedVector3Array = old.get_surface_blend_shape_arrays(i, 0)[Mesh.ARRAY_VERTEX]
			arrays[Mesh.ARRAY_CUSTOM3] = target.to_byte_array().to_float32_array()
			format |= TARGET_FORMAT
		var material := _material(old.get_surface_material(i), own)
		if material is ShaderMaterial:
			var has_leaves: bool = i < level["trunk"]
			var has_pivots: bool = arrays[Mesh.ARRAY_CUSTOM0] != null
			_set_laws(material, level, node.transform.basis.x.length(), has_leaves, has_pivots)
			_set_all(material, _unread(state, material.resource_name))
		mesh.add_surface(old.get_surface_primitive_type(i), arrays, [], {}, material, old.get_surface_name(i), format)
	mesh.resource_name = old.resource_name
	node.mesh = mesh


## The shader with the numbers and textures of a material. Blended materials stay: shaders that discard cannot blend.
static func _material(from: Material, own: Dictionary[Texture2D, Texture2D]) -> Material:
	var plain := from as BaseMaterial3D
	if plain == null or plain.transparency == BaseMaterial3D.TRANSPARENCY_ALPHA:
		return from
	var made := ShaderMaterial.new()
	made.resource_name = plain.resource_name
	var sides := 1 if plain.cull_mode == BaseMaterial3D.CULL_DISABLED else 0
	made.shader = SHADERS[sides][1 if plain.shading_mode == BaseMaterial3D.SHADING_MODE_UNSHADED else 0]
	_set_all(made, {
		"base_texture": own.get(plain.albedo_texture, plain.albedo_texture),
		"base_color": plain.albedo_color,
		"alpha_cutoff": plain.alpha_scissor_threshold if _is_cut(plain) else 0.0,
		"normal_texture": plain.normal_texture if plain.normal_enabled else null,
		"normal_scale": plain.normal_scale if plain.normal_enabled else 0.0,
		"roughness_texture": plain.roughness_texture,
		"roughness": plain.roughness,
		"metallic": plain.metallic,
		"ao_texture": plain.ao_texture if plain.ao_enabled else null,
		"has_vertex_colors": plain.vertex_color_use_as_albedo,
		"uv_scale": Vector2(plain.uv1_scale.x, plain.uv1_scale.y),
		"uv_offset": Vector2(plain.uv1_offset.x, plain.uv1_offset.y),
	})
	return made


## What the file says of a material and Godot's importer does not read: light that goes through leaves, and the strength
## of baked light, whose colors end at 1.
static func _unread(state: GLTFState, name: String) -> Dictionary:
	for material: Dictionary in state.json.get("materials", []):
		if name == "" or material.get("name", "") != name:
			continue
		var through: Dictionary = material.get("extensions", {}).get("KHR_materials_diffuse_transmission", {})
		var own: Dictionary = material.get("extras", {}).get("leafcloud", {})
		return {
			"light_strength": own.get("light_strength"),
			"translucency": through.get("diffuseTransmissionFactor"),
			"translucency_texture": _texture(state, through.get("diffuseTransmissionColorTexture", {})),
		}
	return {}


## The texture of a reference in a material; null if it has none, as after tools that number textures anew.
static func _texture(state: GLTFState, info: Dictionary) -> Texture2D:
	var number := int(info.get("index", -1))
	var textures := state.get_textures()
	if number < 0 or number >= textures.size():
		return null
	var image := textures[number].src_image
	var images := state.get_images()
	return images[image] if image >= 0 and image < images.size() else null


## Sets the numbers of the laws: distances in units of the mesh, because the shader divides by its scale.
static func _set_laws(
	material: ShaderMaterial, level: Dictionary, scale: float, has_leaves: bool, has_pivots: bool
) -> void:
	_set_all(material, {
		"crown_centre": _vector(level["centre"]),
		"fade_in": level["fade_in"] / scale,
		"fade_out": level["fade_out"] / scale,
		"is_first": level["level"] == 0,
		"is_last": level["fade_out"].x == INF,
		"has_leaves": has_leaves,
		"has_pivots": has_pivots,
	})
	if has_leaves and level.has("transition_end"):
		var transition := Vector2(level["transition_start"], level["transition_end"])
		_set_all(material, {"transition_range": transition / scale})
	if has_leaves and level.has("prune_start"):
		_set_all(material, {
			"prune_start": level["prune_start"] / scale,
			"prune_half": level.get("prune_half", 0.5),
			"growth_numbers": _pair(level.get("growth", [0, 0])),
			"contrast_numbers": _pair(level.get("contrast", [0, 0])),
			"mean_color": _vector(level.get("mean_color", [0, 0, 0])),
			"area_shares": PackedFloat32Array(level["shares"]) if level.has("shares") else null,
		})
	for name: String in level.get("wind", {}):
		var value: Variant = level["wind"][name]
		_set_all(material, {"wind_" + name: _vector(value) if value is Array else value})


## Sets the parameters that have a value: the others keep that of the shader.
static func _set_all(material: ShaderMaterial, numbers: Dictionary) -> void:
	for name: String in numbers:
		var value: Variant = numbers[name]
		if value != null and not (value is Vector2 and value.x == INF):
			material.set_shader_parameter(name, _with_mips(value) if value is ImageTexture else value)


## Textures that a running game reads have no mip levels.
static func _with_mips(texture: ImageTexture) -> ImageTexture:
	var image := texture.get_image()
	if not image.has_mipmaps() and not image.is_compressed() and image.generate_mipmaps() == OK:
		texture.set_image(image)
	return texture


static func _vector(numbers: Array) -> Vector3:
	return Vector3(numbers[0], numbers[1], numbers[2])


static func _pair(numbers: Array) -> Vector2:
	return Vector2(numbers[0], numbers[1])
