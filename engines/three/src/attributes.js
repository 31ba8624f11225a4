// Vertex attributes of a level's leaves, under the names that the shaders read: lcTarget, lcLeaf (rank, phase, freedom),
// lcPivot, lcPivotTarget, and for files with wind lcBillboardPivot. WebGL has room for 16, and instances take four.
import * as THREE from "three";

/** GLTFLoader's names of the sets of texture coordinates. */
const SETS = ["uv", "uv1", "uv2", "uv3", "texcoord_4", "texcoord_5", "texcoord_6", "texcoord_7"];

/** Indices of each attribute's components among the numbers of these sets, counted from the first set without texture
 * coordinates of images. */
const NUMBERS = {
  _leaf_rank: [0, 7, 11],
  _leaf_pivot: [1, 2, 3],
  _leaf_pivot_target: [4, 5, 6],
  _leaf_billboard_pivot: [8, 9, 10],
};

/** Returns whether a mesh has anything that morphs or is pruned. */
export function hasLeaves({ attributes, morphAttributes }) {
  return "_leaf_rank" in attributes || "_leaf_pivot" in attributes || "position" in morphAttributes;
}

/** Makes named attributes from texture coordinates, for files of engines that drop custom attributes. */
export function nameNumbers(geometry, first) {
  const sets = SETS.slice(first).flatMap((name) => geometry.attributes[name] ?? []);
  const number = (vertex, place) => sets[place >> 1]?.getComponent(vertex, place % 2) ?? 0;
  for (const [name, places] of Object.entries(NUMBERS)) {
    if (places[0] >= 2 * sets.length) continue;
    const values = Float32Array.from({ length: places.length * geometry.attributes.position.count }, (_, i) =>
      number(Math.floor(i / places.length), places[i % places.length]),
    );
    geometry.setAttribute(name, new THREE.BufferAttribute(values, places.length));
  }
  SETS.slice(first).forEach((name) => geometry.deleteAttribute(name));
}

/** Names the attributes as the shaders read them. Without ranks all leaves are protected. */
export function addAttributes(geometry, wind) {
  const { position, ...given } = geometry.attributes;
  const pivot = given._leaf_pivot ?? position;
  geometry.setAttribute("lcTarget", targetsOf(geometry));
  geometry.setAttribute("lcLeaf", given._leaf_rank ?? unranked(position.count));
  geometry.setAttribute("lcPivot", pivot);
  geometry.setAttribute("lcPivotTarget", given._leaf_pivot_target ?? pivot);
  // Vertices without a target billboard use their own pivot.
  if (wind) geometry.setAttribute("lcBillboardPivot", given._leaf_billboard_pivot ?? pivot);
  Object.keys(NUMBERS).forEach((name) => geometry.deleteAttribute(name));
}

/** Names the tangents as the shaders read them; they are the axes of the texture. */
export function addTangents(geometry) {
  geometry.setAttribute("lcTangent", geometry.attributes.tangent);
}

/** Returns the numbers of leaves that are never pruned and do not flutter. */
function unranked(count) {
  return new THREE.BufferAttribute(Float32Array.from({ length: 3 * count }, (_, i) => (i % 3 ? 0 : -1)), 3);
}

/** Returns the morph target as an attribute of positions; three.js itself uses a texture of offsets. */
function targetsOf(geometry) {
  const { position } = geometry.attributes;
  const [offsets] = geometry.morphAttributes.position ?? [];
  geometry.morphAttributes = {};
  if (!offsets) return position;
  return new THREE.BufferAttribute(position.array.map((value, i) => value + offsets.array[i]), 3);
}

/** Returns a geometry with the same attributes, and an index and a range of its own. */
export function sharing(geometry) {
  const made = new THREE.BufferGeometry();
  Object.entries(geometry.attributes).forEach(([name, attribute]) => made.setAttribute(name, attribute));
  made.setIndex(geometry.index);
  made.boundingBox = geometry.boundingBox;
  made.boundingSphere = geometry.boundingSphere;
  return made;
}
