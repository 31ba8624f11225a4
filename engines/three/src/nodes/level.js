// What all materials of levels share: the numbers of the drawn object's level, its place, and the fades.
//
// The nodes exist once for all trees, so that copies of a tree share shaders. Numbers come from `laws` of the drawn
// object's own material: the uniforms that levels and forests set.
import * as THREE from "three";
import {
  attribute,
  distance,
  Fn,
  length,
  mat3,
  mat4,
  modelWorldMatrix,
  normalLocal,
  screenCoordinate,
  screenSize,
  tangentLocal,
  transformNormal,
  uniform,
  uniformArray,
  varying,
  vec2,
  vec4,
} from "three/tsl";
import { isShown, keepOf, SHARES, staggerOf, transitionOf } from "./laws.js";

const FIRST = {
  float: () => 0,
  vec2: () => new THREE.Vector2(),
  vec3: () => new THREE.Vector3(),
  vec4: () => new THREE.Vector4(),
};

/** Returns the node of a number of the drawn object's level. `read` finds it in the level's uniforms. */
export function numberOf(type, read) {
  return uniform(FIRST[type]()).onObjectUpdate(({ object }) => read(object.material.laws));
}

export const transitionAt = numberOf("vec3", (laws) => laws.lcTransitionAt.value);
export const keepAt = numberOf("vec2", (laws) => laws.lcKeepAt.value);
const fade = numberOf("vec2", (laws) => laws.lcFade.value);
const viewer = numberOf("vec3", (laws) => laws.lcViewer.value);
const centre = numberOf("vec3", (laws) => laws.lcCentre.value);
const unit = numberOf("float", (laws) => laws.lcUnit.value);
const stagger = numberOf("float", (laws) => laws.lcStagger.value);
const fadeAt = numberOf("vec4", (laws) => laws.lcFadeAt.value);
export const shares = uniformArray(new Array(SHARES).fill(0), "float").onObjectUpdate(({ object }, node) => {
  node.array = object.material.laws.lcShares.value;
});

/** Columns of a copy's matrix. */
const COLUMNS = ["lcColumn0", "lcColumn1", "lcColumn2", "lcColumn3"];

/**
 * A mesh drawn at many places. Node materials of three.js apply the matrix of an `InstancedMesh` before any node of the
 * material, and do not pass it on; the laws need the copy's own coordinates and its place.
 */
export class Copies extends THREE.Mesh {
  constructor(geometry, material, capacity) {
    super(geometry, material);
    this.instanceMatrix = new THREE.InstancedInterleavedBuffer(new Float32Array(16 * capacity), 16);
    COLUMNS.forEach((name, i) => {
      geometry.setAttribute(name, new THREE.InterleavedBufferAttribute(this.instanceMatrix, 4, 4 * i));
    });
  }

  setMatrixAt(slot, matrix) {
    matrix.toArray(this.instanceMatrix.array, 16 * slot);
  }

  dispose() {
    this.dispatchEvent({ type: "dispose" });
  }
}

const isCopied = (builder) => builder.hasGeometryAttribute(COLUMNS[0]);
const columns = mat4(...COLUMNS.map((name) => attribute(name, "vec4")));

/** The matrix from the level's coordinates to the world. */
export const toWorld = Fn((builder) => (isCopied(builder) ? modelWorldMatrix.mul(columns) : modelWorldMatrix), "mat4")();

/** Returns a node for copies and one for single trees in one. Both are functions, as only one of them may be built. */
export function copied(type, copy, single) {
  return Fn((builder) => (isCopied(builder) ? copy() : single()), type)();
}

/**
 * Returns a material's positionNode: the point that `pointOf` returns, in the level's coordinates, moved by its copy's matrix.
 * Turns the normals, too.
 */
export function placed(pointOf) {
  return Fn((builder) => {
    const point = pointOf();
    if (!isCopied(builder)) return point;
    if (builder.hasGeometryAttribute("normal")) normalLocal.assign(transformNormal(normalLocal, columns));
    if (builder.hasGeometryAttribute("tangent")) tangentLocal.assign(mat3(columns).mul(tangentLocal));
    return columns.mul(vec4(point, 1)).xyz;
  }, "vec3")();
}

/** The distance by which the laws decide, in the file's units: of a single tree from the processor. */
export const distanceSeen = copied(
  "float",
  () =>
    distance(viewer, toWorld.mul(vec4(centre, 1)).xyz)
      .div(length(toWorld.element(0).xyz).mul(unit))
      .div(staggerOf(toWorld.element(3).xyz, stagger)),
  () => transitionAt.x,
);

/** The same in the fragment shader, where all pixels of a copy need the same number. */
const distanceOfPixel = copied(
  "float",
  () => varying(distanceSeen).setInterpolation("flat"),
  () => transitionAt.x,
);

/** The fraction of the pixels that this level draws, and the fraction that the next one draws. */
const fades = copied(
  "vec2",
  () => vec2(transitionOf(distanceOfPixel, fadeAt.x, fadeAt.y), transitionOf(distanceOfPixel, fadeAt.z, fadeAt.w)),
  () => fade,
);

/** The transition a, and the fraction λ of the leaves. */
export const transition = transitionOf(distanceSeen, transitionAt.y, transitionAt.z);
export const keep = keepOf(distanceSeen, keepAt.x, keepAt.y);
export const keepOfPixel = keepOf(distanceOfPixel, keepAt.x, keepAt.y);

/** The pixel, with rows counted from below as in WebGL, so that both renderers fade by the same pattern. */
const pixel = vec2(screenCoordinate.x, screenSize.y.sub(screenCoordinate.y));

/** Returns whether a pattern of pixels draws this one, for a fraction of all pixels. */
export const inPattern = (share) => isShown(share, pixel);

/** Whether this level draws the pixel. */
export const drawn = inPattern(fades.x).and(inPattern(fades.y).not());
