// Mip levels of PNG textures in which leaves neither dissolve nor swell, in place of box-filtered ones.
import { Constants, Material, Texture } from "@babylonjs/core";
import { shareMips } from "./mips.js";

/** Textures with such mip levels: whether alpha is the share of drawn texels in these. */
const replaced = new WeakMap();

/** Returns whether a texture has such mip levels. Copies may be read from the file again, without them. */
export function hasReplacedLevels(texture) {
  return replaced.has(texture);
}

/** Returns whether alpha is the share of drawn texels in the mip levels of a texture. */
export function alphaIsShare(texture) {
  return replaced.get(texture) ?? false;
}

/** Gives the PNG texture of the leaves mip levels with the share of drawn texels, if they are cut out. */
export async function keepShares({ albedoTexture: texture, alphaCutOff, transparencyMode }) {
  if (transparencyMode > Material.MATERIAL_ALPHATEST) texture.updateSamplingMode(Texture.LINEAR_LINEAR);
  if (transparencyMode !== Material.MATERIAL_ALPHATEST || hasReplacedLevels(texture) || !hasGeneratedLevels(texture)) return;
  const data = await texture.readPixels();
  if (!data) return;
  setLevels(texture, 1, shareMips({ data, ...texture.getSize() }, alphaCutOff));
  replaced.set(texture, true);
}

/**
 * Gives the PNG texture of an atlas page the mip levels of its file. They lie under one another in the PNG image `bytes`; the first replaces
 * the page. A page of another size, as other tools write, keeps its own.
 */
export async function useLevels(texture, bytes) {
  if (hasReplacedLevels(texture) || !hasGeneratedLevels(texture)) return;
  const image = await read(bytes, texture.getScene(), `mip levels of texture ${texture.uniqueId}`);
  const data = await image?.readPixels();
  const { width, height } = image?.getSize() ?? {};
  image?.dispose();
  const sizes = sizesOf(texture.getSize());
  if (!data || width !== sizes[0].width || height !== sizes.reduce((sum, size) => sum + size.height, 0)) return;
  setLevels(texture, 0, cut(data, width, sizes));
  replaced.set(texture, false);
}

/** Returns the texture of a PNG image as it is; null for a broken one. `name`: Babylon.js shares the textures of a name. */
function read(bytes, scene, name) {
  return new Promise((done) => {
    const own = { buffer: bytes, mimeType: "image/png", invertY: false, noMipmap: true, samplingMode: Texture.NEAREST_SAMPLINGMODE };
    const texture = new Texture(`data:${name}`, scene, { ...own, onLoad: () => done(texture), onError: () => done(null) });
  });
}

/** Returns the sizes {width, height} of a texture and its mip levels. */
function sizesOf({ width, height }) {
  const count = Math.floor(Math.log2(Math.max(width, height))) + 1;
  return Array.from({ length: count }, (_, i) => ({ width: Math.max(width >> i, 1), height: Math.max(height >> i, 1) }));
}

/** Returns pictures {data, width, height} of these sizes that lie under one another, at the left side of an image of such width. */
function cut(image, columns, sizes) {
  let top = 0;
  return sizes.map(({ width, height }) => {
    const data = new Uint8Array(4 * width * height);
    for (let y = 0; y < height; y++) data.set(image.subarray(4 * (top + y) * columns).subarray(0, 4 * width), 4 * y * width);
    top += height;
    return { data, width, height };
  });
}

/** Returns whether Babylon.js made the mip levels of a texture, as for a PNG file. */
function hasGeneratedLevels(texture) {
  const internal = texture.getInternalTexture();
  const isFiltered = internal?.format === Constants.TEXTUREFORMAT_RGBA && internal.generateMipMaps && !internal.invertY;
  return isFiltered && texture.mimeType !== "image/ktx2";
}

function setLevels(texture, first, levels) {
  texture.updateSamplingMode(Texture.TRILINEAR_SAMPLINGMODE);
  const engine = texture.getScene().getEngine();
  levels.forEach(({ data, width, height }, i) => {
    engine.updateTextureData(texture.getInternalTexture(), new Uint8Array(data.buffer), 0, 0, width, height, 0, first + i);
  });
}
