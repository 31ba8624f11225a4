// Textures that the extras of a file's materials name; glTF itself has no place for them.
import { SRGBColorSpace } from "three";

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
