// Sorts alpha-blended triangles from back to front, for the camera position of each picture.
//
// Files split billboards where they cross, and store a BSP tree in the mesh's extras (leafcloud.blend_order). At each
// node draw the far side first, then the triangles in its plane, then the near side. Meshes without a tree, such as
// leaves, are sorted by the centers of their triangles, which is wrong where triangles cross.
import * as THREE from "three";

/** Camera motion, as a fraction of its distance, after which the order is updated. */
const STEP = 0.01;

/** Sorts the indices of `mesh`. `tree` is null or {planes, children, ranges}. */
export class BlendOrder {
  #mesh;
  #indices;
  #walk;
  #middle;
  #eye = null;

  constructor(mesh, tree) {
    this.#mesh = mesh;
    mesh.geometry.computeBoundingSphere();
    this.#middle = mesh.geometry.boundingSphere.center.clone();
    this.#indices = indicesOf(mesh.geometry);
    this.#walk = tree ? (eye) => walked(tree, eye) : byDistance(mesh.geometry.attributes.position, this.#indices);
    mesh.geometry.setIndex(new THREE.BufferAttribute(this.#indices.slice(), 1));
  }

  /** Updates the order before a picture. `place`: the camera's position in the world. */
  update(place) {
    this.#mesh.updateWorldMatrix(true, false);
    const eye = this.#mesh.worldToLocal(place.clone());
    if (this.#eye && this.#eye.distanceTo(eye) < STEP * eye.distanceTo(this.#middle)) return;
    this.#eye = eye;
    const { index } = this.#mesh.geometry;
    let at = 0;
    for (const [first, behind] of this.#walk(eye)) {
      index.array.set(this.#indices.subarray(3 * first, 3 * behind), at);
      at += 3 * (behind - first);
    }
    index.needsUpdate = true;
  }
}

function indicesOf({ index, attributes }) {
  return index ? Uint32Array.from(index.array) : Uint32Array.from({ length: attributes.position.count }, (_, i) => i);
}

/** Returns the ranges [first, end) of triangles from the farthest to the nearest. */
export function walked({ planes, children, ranges }, eye) {
  const drawn = [];
  const waiting = ranges.length ? [[0, false]] : [];
  while (waiting.length) {
    const [node, ready] = waiting.pop();
    if (ready) {
      drawn.push([ranges[2 * node], ranges[2 * node + 1]]);
      continue;
    }
    const [x, y, z, d] = planes.slice(4 * node, 4 * node + 4);
    const front = x * eye.x + y * eye.y + z * eye.z > d;
    const [near, far] = front ? [0, 1] : [1, 0];
    const put = (side) => children[2 * node + side] >= 0 && waiting.push([children[2 * node + side], false]);
    put(near);
    waiting.push([node, true]);
    put(far);
  }
  return drawn;
}

function byDistance(position, indices) {
  const count = indices.length / 3;
  const middles = Float32Array.from({ length: 3 * count }, (_, i) => {
    const corner = (k) => position.getComponent(indices[3 * Math.floor(i / 3) + k], i % 3);
    return (corner(0) + corner(1) + corner(2)) / 3;
  });
  return (eye) => {
    const away = Float32Array.from({ length: count }, (_, i) =>
      Math.hypot(middles[3 * i] - eye.x, middles[3 * i + 1] - eye.y, middles[3 * i + 2] - eye.z),
    );
    const order = Uint32Array.from({ length: count }, (_, i) => i).sort((a, b) => away[b] - away[a]);
    return Array.from(order, (triangle) => [triangle, triangle + 1]);
  };
}
