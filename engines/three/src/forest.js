// Many copies of one tree, each with the level for its own distance.
import * as THREE from "three";
import { NEVER, staggerAt, viewFactor } from "./laws.js";
import { Level } from "./levels.js";
import { fieldOfView, forPicture, SETTINGS, wantedLevel } from "./settings.js";
import { FRACTIONAL } from "./shares.js";

/** Reach of the leaves in crown radii, when few are left and grow, and in wind. */
const GROWN = 1.2;

/**
 * A forest: one instanced mesh for each material of each level. Before each picture the trees in view are sorted into
 * levels; the shader morphs, fades and prunes each tree by its own distance. Cost of the sorting: linear in the trees.
 *
 * Blended leaves are cut out by a pattern of pixels, because instances are not sorted from back to front.
 */
export class Forest extends THREE.Group {
  #tree;
  #layers;
  #source;
  #places;
  #spheres;
  #origins;
  #capacity;
  #reach;

  /** `tree`: a loaded `Tree`; it can be drawn beside the forest. `places`: Matrix4 of each copy, in the forest's coordinates. */
  constructor(tree, places) {
    super();
    this.#tree = tree;
    this.#source = tree.source;
    this.#capacity = places.length;
    this.settings = { ...SETTINGS };
    /** false: trees outside of the picture are drawn, too, for the shadows that they cast into it. */
    this.culling = true;
    this.centre = tree.centre.clone();
    this.radius = tree.radius;
    this.#reach = reachOf(this.#source.levels[0]) / this.radius;
    this.#layers = this.#source.levels.map((source) => this.#newLayer(source, places.length));
    this.plant(places);
  }

  /** Moves the trees to new places. Their number is at most that of the constructor's places. */
  plant(places) {
    if (places.length > this.#capacity) {
      throw new Error(`${places.length} places are more than the ${this.#capacity} of the forest: make a new Forest`);
    }
    this.#places = places.map((place) => place.clone());
    const [{ offset }] = this.#layers[0].meshes;
    const origin = new THREE.Vector3().setFromMatrixPosition(offset);
    this.#origins = places.map((place) => origin.clone().applyMatrix4(place));
    this.#spheres = places.map((place) => new THREE.Sphere(this.centre.clone(), this.radius).applyMatrix4(place));
  }

  clone() {
    return new Forest(this.#tree, this.#places).copy(this);
  }

  copy(other) {
    super.copy(other, false);
    Object.assign(this.settings, other.settings);
    this.culling = other.culling;
    return this;
  }

  /** Numbers of trees that each level drew in the last picture. Trees that fade count in both levels. */
  get counts() {
    return this.#layers.map(({ count }) => count);
  }

  /** Shows each tree in the level for the camera's distance, with the wind at the time `seconds`. */
  update(camera, seconds = 0) {
    const settings = forPicture(this.settings, this.#source.renderer);
    this.updateWorldMatrix(true, false);
    camera.updateMatrixWorld();
    const eye = new THREE.Vector3().setFromMatrixPosition(camera.matrixWorld);
    const factor = viewFactor(fieldOfView(camera), settings);
    const distances = this.#distances(this.worldToLocal(eye.clone()), factor, settings.stagger);
    const shown = this.culling ? this.#inView(camera) : this.#places.map(() => true);
    const wanted = wantedLevel(settings, this.#layers.length);
    this.#layers.forEach((layer, number) => {
      const range = this.#range(number, wanted, settings);
      this.#fill(layer, (i) => shown[i] && distances[i] >= range[0] && distances[i] < range[3]);
      this.#set(layer, { eye, range, factor, settings, seconds, nearest: nearestOf(distances, range) });
    });
  }

  dispose() {
    this.#layers.forEach(({ level, meshes }) => {
      level.dispose();
      meshes.forEach(({ mesh }) => mesh.dispose());
    });
  }

  /** Returns the level with an instanced mesh for each of its meshes; `offset` is the mesh's matrix in the tree. */
  #newLayer(source, capacity) {
    const object = source.object.clone();
    const { looks } = this.#source;
    const level = new Level(source, object, looks);
    const meshes = level.meshes.map((mesh, i) => {
      cutOut(mesh.material, source.parts[i]);
      const instanced = looks.newCopies(mesh, capacity);
      instanced.frustumCulled = false; // The forest leaves out the trees that the camera does not see.
      Object.assign(instanced, { count: 0, visible: false });
      this.add(instanced);
      return { mesh: instanced, offset: offsetOf(object, mesh, source.object.matrixWorld) };
    });
    return { level, meshes, count: 0 };
  }

  /** Distances of the trees from an eye, in the file's units. */
  #distances(eye, factor, stagger) {
    const staggered = (i) => staggerAt(this.#origins[i].clone().applyMatrix4(this.matrixWorld).toArray(), stagger);
    return this.#spheres.map(
      ({ center, radius }, i) => (center.distanceTo(eye) * this.radius) / (radius * factor * staggered(i)),
    );
  }

  #inView(camera) {
    const view = new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    const frustum = new THREE.Frustum().setFromProjectionMatrix(view.multiply(this.matrixWorld), camera.coordinateSystem);
    const whole = new THREE.Sphere();
    return this.#spheres.map(({ center, radius }) => frustum.intersectsSphere(whole.set(center, this.#reach * radius)));
  }

  /** Distances at which a level appears (from, to) and goes (from, to). */
  #range(number, wanted, settings) {
    if (wanted !== null) return number === wanted ? [-2, -1, NEVER, 2 * NEVER] : [NEVER, NEVER, NEVER, NEVER];
    const before = this.#layers[number - 1]?.level;
    const { level } = this.#layers[number];
    const last = number + 1 === this.#layers.length;
    return [
      ...(before ? [before.handOver, before.goneAt(settings)] : [-2, -1]),
      ...(last ? [NEVER, 2 * NEVER] : [level.handOver, level.goneAt(settings)]),
    ];
  }

  #fill(layer, isIn) {
    const places = this.#places.filter((_, i) => isIn(i));
    layer.count = places.length;
    const matrix = new THREE.Matrix4();
    for (const { mesh, offset } of layer.meshes) {
      mesh.count = places.length;
      mesh.visible = places.length > 0;
      if (!mesh.visible) continue;
      places.forEach((place, slot) => mesh.setMatrixAt(slot, matrix.multiplyMatrices(place, offset)));
      mesh.instanceMatrix.clearUpdateRanges();
      mesh.instanceMatrix.addUpdateRange(0, 16 * places.length);
      mesh.instanceMatrix.needsUpdate = true;
    }
  }

  #set({ level, count }, { eye, range, factor, settings, seconds, nearest }) {
    if (count === 0) return;
    const { uniforms } = level;
    uniforms.lcViewer.value.copy(eye);
    uniforms.lcUnit.value = factor / level.scale;
    uniforms.lcStagger.value = settings.stagger;
    uniforms.lcFadeAt.value.fromArray(range);
    // The nearest tree decides how many leaves are drawn at all; those of farther trees shrink to points.
    level.move(nearest, level, level.keepLaw(settings), settings);
    // The shader turns the wind into each tree's coordinates.
    level.blow(settings.wind, seconds, WORLD, ORIGIN);
  }
}

const WORLD = new THREE.Matrix4();
const ORIGIN = new THREE.Vector3();

function nearestOf(distances, range) {
  return distances.reduce((least, each) => (each >= range[0] ? Math.min(least, each) : least), NEVER);
}

/** Returns the matrix of a mesh below `object` in the tree's coordinates; `toTree` is that of `object`. */
function offsetOf(object, mesh, toTree) {
  const offset = new THREE.Matrix4();
  for (let each = mesh; each !== object; each = each.parent) {
    each.updateMatrix();
    offset.premultiply(each.matrix);
  }
  return offset.premultiply(toTree);
}

/** Instances are not sorted, so nothing is blended: impostors draw a share of the samples, blended leaves a pattern of pixels. */
function cutOut(material, { impostor }) {
  if (!material.transparent) return;
  Object.assign(material, { transparent: false }, impostor ? { ...FRACTIONAL, alphaTest: 0 } : { alphaHash: true });
}

/** Radius of a sphere around the center of the leaves that holds the tree, also in wind and with grown leaves. */
function reachOf({ centre, radius, parts, object }) {
  const own = new THREE.Box3();
  parts.forEach(({ geometry }) => {
    geometry.computeBoundingBox();
    own.union(geometry.boundingBox);
  });
  // The farthest corner of the box.
  const corner = own.min.clone().sub(centre).negate().max(own.max.clone().sub(centre));
  return object.matrixWorld.getMaxScaleOnAxis() * Math.max(GROWN * radius, corner.length());
}
