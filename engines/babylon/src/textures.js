// Mip levels of the leaves' PNG textures with the share of drawn texels as alpha, in place of box-filtered ones.
import { Constants, Material, Texture } from "@babylonjs/core";
import { shareMips } from "./mips.js";

/** Textures of the leaves: whether alpha is the share of drawn texels in their mip levels. */
const leaves = new WeakMap();

/** Returns whether a texture of the leaves has such mip levels; undefined for other textures. */
export function hasShares(texture) {
  return leaves.get(texture);
}

/** Gives the PNG texture of the leaves mip levels with the share of drawn texels, if they are cut out. */
export async function keepShares({ albedoTexture: texture, alphaCutOff, transparencyMode }) {
  if (leaves.has(texture)) return;
  if (transparencyMode > Material.MATERIAL_ALPHATEST) texture.updateSamplingMode(Texture.LINEAR_LINEAR);
  const cut = transparencyMode === Material.MATERIAL_ALPHATEST && hasGeneratedLevels(texture);
  const data = cut ? await texture.readPixels() : null;
  leaves.set(texture, data !== null);
  if (data) setLevels(texture, shareMips({ data, ...texture.getSize() }, alphaCutOff));
}

/** Returns whether Babylon.js made the mip levels of a texture, as for a PNG file. */
function hasGeneratedLevels(texture) {
  const internal = texture.getInternalTexture();
  return internal?.format === Constants.TEXTUREFORMAT_RGBA && internal.generateMipMaps && !internal.invertY && texture.mimeType !== "image/ktx2";
}

function setLevels(texture, levels) {
  texture.updateSamplingMode(Texture.TRILINEAR_SAMPLINGMODE);
  const engine = texture.getScene().getEngine();
  levels.forEach(({ data, width, height }, i) => {
    engine.updateTextureData(texture.getInternalTexture(), new Uint8Array(data.buffer), 0, 0, width, height, 0, 1 + i);
  });
}
