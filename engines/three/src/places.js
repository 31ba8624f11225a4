// The places of a forest's trees in a file: instances of level 0 by EXT_mesh_gpu_instancing.
import * as THREE from "three";

const INSTANCING = "EXT_mesh_gpu_instancing";

/** A plug-in of GLTFLoader in place of its own, which would draw level 0 at all places. */
export const withoutInstances = () => ({ name: INSTANCING });

/**
 * Returns the places (Matrix4) of the trees; node number `node`, drawn by `object`, is their level 0. Null in a file of one tree.
 * An instance lies within the node N, a place moves the node: P · N = N · I.
 */
export async function placesOf({ parser }, node, object) {
  const { attributes } = parser.json.nodes[node].extensions?.[INSTANCING] ?? {};
  if (!attributes) return null;
  const read = (name) => (name in attributes ? parser.getDependency("accessor", attributes[name]) : null);
  const [translations, rotations, scales] = await Promise.all(["TRANSLATION", "ROTATION", "SCALE"].map(read));
  object.updateWorldMatrix(true, false);
  const back = object.matrixWorld.clone().invert();
  const [place, turn, size] = [new THREE.Vector3(), new THREE.Quaternion(), new THREE.Vector3(1, 1, 1)];
  return Array.from({ length: (translations ?? rotations ?? scales).count }, (_, i) => {
    if (translations) place.fromBufferAttribute(translations, i);
    if (rotations) turn.fromBufferAttribute(rotations, i);
    if (scales) size.fromBufferAttribute(scales, i);
    return new THREE.Matrix4().compose(place, turn, size).premultiply(object.matrixWorld).multiply(back);
  });
}
