@tool
extends RefCounted
## Mip levels in place of Godot's, in which thin leaves dissolve and take the color of transparent texels.

## Image.convert rounds down.
const HALF_A_CODE := 0.5 / 255.0


## The texture of the leaves themselves with mip levels in which alpha is the share of the texels that the cutoff leaves, and
## the color is the mean of these texels.
static func with_mips(texture: Texture2D, cutoff: float) -> Texture2D:
	var image := texture.get_image()
	if image.is_compressed():
		image.decompress()
	image.clear_mipmaps()
	image.convert(Image.FORMAT_RGBA8)
	var smaller := _smaller_levels(image, cutoff)
	image.fix_alpha_edges()
	image.set_data(image.get_width(), image.get_height(), true, Image.FORMAT_RGBA8, image.get_data() + smaller.get_data())
	return _stored(image)


## The texture with Godot's own mip levels.
static func with_plain_mips(texture: Texture2D) -> Texture2D:
	var image := texture.get_image()
	image.generate_mipmaps()
	return _stored(image)


static func _stored(image: Image) -> Texture2D:
	if not Engine.is_editor_hint():
		return ImageTexture.create_from_image(image)
	# Small in the file of the imported scene.
	var made := PortableCompressedTexture2D.new()
	made.create_from_image(image, PortableCompressedTexture2D.COMPRESSION_MODE_LOSSLESS)
	return made


## The mip levels from the first on, as an image of half the size with mip levels.
static func _smaller_levels(image: Image, cutoff: float) -> Image:
	var drawn := _drawn_texels(image.get_data(), 255.0 * cutoff)
	var small := Image.create_from_data(
		image.get_width(), image.get_height(), false, Image.FORMAT_RGBAF, drawn.to_byte_array())
	small.shrink_x2()
	small.generate_mipmaps()
	var numbers := small.get_data().to_float32_array()
	for level in range(small.get_mipmap_count(), -1, -1):
		_divide_by_alpha(numbers, small, level)
	small.set_data(small.get_width(), small.get_height(), true, Image.FORMAT_RGBAF, numbers.to_byte_array())
	small.convert(Image.FORMAT_RGBA8)
	return small


## Four numbers a texel: linear color and 1, or zeros below the cutoff.
static func _drawn_texels(bytes: PackedByteArray, cutoff: float) -> PackedFloat32Array:
	var linear := PackedFloat32Array()
	for code in 256:
		linear.append(Color8(code, code, code).srgb_to_linear().r)
	var numbers := PackedFloat32Array()
	numbers.resize(bytes.size())
	for i in range(0, bytes.size(), 4):
		if bytes[i + 3] >= cutoff:
			numbers[i] = linear[bytes[i]]
			numbers[i + 1] = linear[bytes[i + 1]]
			numbers[i + 2] = linear[bytes[i + 2]]
			numbers[i + 3] = 1.0
	return numbers


## Turns sums of drawn texels into their mean, as sRGB. Texels without any take the color of the next smaller level, which
## must be done: filtering mixes them into leaves.
static func _divide_by_alpha(numbers: PackedFloat32Array, image: Image, level: int) -> void:
	var size := _size(image, level)
	var next := mini(level + 1, image.get_mipmap_count())
	var next_size := _size(image, next)
	for y in size.y:
		for x in size.x:
			var at := image.get_mipmap_offset(level) / 4 + 4 * (y * size.x + x)
			var color := Color(numbers[at], numbers[at + 1], numbers[at + 2])
			if numbers[at + 3] > 0.0:
				color = (color / numbers[at + 3]).linear_to_srgb()
			else:
				var row := mini(y / 2, next_size.y - 1)
				var from := image.get_mipmap_offset(next) / 4 + 4 * (row * next_size.x + mini(x / 2, next_size.x - 1))
				color = Color(numbers[from] - HALF_A_CODE, numbers[from + 1] - HALF_A_CODE, numbers[from + 2] - HALF_A_CODE)
			numbers[at] = color.r + HALF_A_CODE
			numbers[at + 1] = color.g + HALF_A_CODE
			numbers[at + 2] = color.b + HALF_A_CODE
			numbers[at + 3] += HALF_A_CODE


static func _size(image: Image, level: int) -> Vector2i:
	return Vector2i(maxi(image.get_width() >> level, 1), maxi(image.get_height() >> level, 1))
