// Textures that the extras of a file's materials name; glTF itself has no place for them.
import { LinearFilter, LinearMipmapLinearFilter, SRGBColorSpace } from "three";
import { shareMips } from "./mips.js";

/** Textures of the leaves: whether alpha is the share of drawn texels in their mip levels. */
const leaves = new WeakMap();

/** Gives the PNG texture of the leaves mip levels with the share of drawn texels, if they are cut out. */
export function keepCoverage({ map, alphaTest, transparent }) {
  if (!map || leaves.has(map)) return;
  const cut = alphaTest > 0 && !transparent && !map.isCompressedTexture;
  leaves.set(map, cut);
  if (cut) {
    const mips = shareMips(pixelsOf(map.image), alphaTest).map(({ data, width, height }) => new ImageData(data, width, height));
    Object.assign(map, { mipmaps: [map.image, ...mips], minFilter: LinearMipmapLinearFilter, generateMipmaps: false, needsUpdate: true });
  } else if (transparent && !map.isCompressedTexture) {
    Object.assign(map, { minFilter: LinearFilter, generateMipmaps: false });
  }
}

/** Returns whether alpha of a cut-out material is a share: on atlas pages, and on textures of leaves with such mip levels. */
export function alphaIsShare({ map, alphaTest, transparent }) {
  return Boolean(map) && alphaTest > 0 && !transparent && (leaves.get(map) ?? true);
}

function pixelsOf(image) {
  const { width, height } = image;
  const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, width, height);
}

/** Returns a Map from material to its bent-normal occlusion texture, for the materials that have one. */
export async function bentNormalOf(gltf) {
  const found = new Map();
  gltf.scene.traverse(({ material }) => material && found.set(material, material.userData.leafcloud?.bentNormalTexture));
  const loaded = [...found].filter(([material, reference]) => reference && material.roughnessMap);
  const textures = loaded.map(([, { index }]) => gltf.parser.getDependency("texture", index));
  return new Map((await Promise.all(textures)).map((texture, i) => [loaded[i][0], texture]));
}

/** Returns a Map from the cross impostor's material to the textures {color, normalDepth} of the octahedral impostor. */
export async function pagesOf(gltf) {
  const found = new Map();
  const texture = (reference) => gltf.parser.getDependency("texture", reference.index);
  const waiting = [];
  gltf.scene.traverse(({ material }) => {
    const { octahedralTexture, octahedralNormalTexture } = material?.userData.leafcloud ?? {};
    if (!octahedralTexture || !octahedralNormalTexture || found.has(material)) return;
    found.set(material, {});
    waiting.push(
      Promise.all([texture(octahedralTexture), texture(octahedralNormalTexture)]).then(([color, normalDepth]) => {
        color.colorSpace = SRGBColorSpace;
        found.set(material, { color, normalDepth });
      }),
    );
  });
  await Promise.all(waiting);
  return found;
}
