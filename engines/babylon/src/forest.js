// Many copies of one tree, each with the level for its own distance.
import { BoundingInfo, Frustum, Geometry, Matrix, Vector3, VertexBuffer } from "@babylonjs/core";
import { NEVER, staggerAt, viewFactor } from "./laws.js";
import { rangesOf, scaleOf } from "./levels.js";
import { fieldOfView, forPicture, SETTINGS, wantedLevel } from "./settings.js";
import { copyOf } from "./tree.js";

/**
 * A forest: thin instances of each mesh of each level. When the camera moves, the trees in view are sorted into levels again;
 * the shader morphs, fades, prunes and blows each tree by its own distance and place. Cost of the sorting: linear in the trees.
 */
export class Forest {
  #tree;
  #scene;
  #observer;
  #layers;
  #places = [];
  #spheres = [];
  #origins = [];
  #capacity;
  #reach;
  #sortedFor = "";

  /** `tree`: a loaded `Tree`; it can be drawn beside the forest. `places`: Matrix of each copy, in the coordinates of the forest. */
  constructor(tree, places) {
    const { source } = tree;
    this.#tree = tree;
    this.#scene = source.scene;
    this.#capacity = places.length;
    this.settings = { ...SETTINGS };
    /** false: trees outside of the picture are drawn, too, for the shadows that they cast into it. */
    this.culling = true;
    const { root, levels } = copyOf(source, this.#scene, "forest");
    /** The node to place the forest by. */
    this.root = root;
    this.#layers = levels.map((level) => newLayer(level, places.length));
    const [{ level, toTree }] = this.#layers;
    this.centre = Vector3.TransformCoordinates(tree.centre, toTree);
    this.radius = tree.radius * level.scale;
    this.#reach = reachOf(level, tree.centre) * level.scale;
    this.plant(places);
    this.#observer = this.#scene.onBeforeRenderObservable.add(() => this.update(this.#scene.activeCamera));
  }

  /** Moves the trees to new places. Their number is at most that of the constructor's places. */
  plant(places) {
    if (places.length > this.#capacity) {
      throw new Error(`${places.length} places are more than the ${this.#capacity} of the forest: make a new Forest`);
    }
    this.#places = places.map((place) => place.clone());
    const [{ toTree }] = this.#layers;
    this.#origins = places.map((place) => Vector3.TransformCoordinates(toTree.getTranslation(), place));
    this.#spheres = places.map((place) => ({ middle: Vector3.TransformCoordinates(this.centre, place), scale: scaleOf(place) }));
    this.#layers.forEach((layer) => {
      layer.matrices = this.#places.map((place) => layer.matrixAt(place));
      bound(layer, this.#spheres, this.#reach);
    });
    this.#sortedFor = "";
  }

  /** Returns a forest of the same trees. */
  clone() {
    const { settings, culling } = this;
    return Object.assign(new Forest(this.#tree, this.#places), { settings: { ...settings }, culling });
  }

  /** Numbers of trees that each level drew in the last picture. Trees that fade count in both levels. */
  get counts() {
    return this.#layers.map(({ count }) => count);
  }

  /** Shows each tree in the level for the camera's distance. The scene calls it before each picture. */
  update(camera) {
    if (!camera || !this.root.isEnabled()) return;
    const settings = forPicture(this.settings, this.#scene.getEngine());
    const factor = viewFactor(fieldOfView(camera), settings);
    const ranges = rangesOf(this.#layers.map(({ level }) => level), wantedLevel(settings, this.#layers.length), settings);
    this.#sort(camera, { factor, ranges, stagger: settings.stagger });
    this.#layers.forEach(({ level, nearest }, number) => {
      level.move({ eye: camera.globalPosition, factor, range: ranges[number], nearest, settings });
    });
  }

  /** Sorts the trees into levels, unless nothing has moved since the last time. */
  #sort(camera, { factor, ranges, stagger }) {
    const view = camera.getTransformationMatrix();
    const place = this.root.computeWorldMatrix(true);
    const state = [...view.asArray(), ...place.asArray(), ...ranges.flat(), factor, stagger, this.culling].join();
    if (state === this.#sortedFor) return;
    this.#sortedFor = state;
    const planes = this.culling ? Frustum.GetPlanes(view) : [];
    const scale = scaleOf(place);
    const distances = this.#spheres.map(({ middle, scale: own }, i) => {
      const there = Vector3.TransformCoordinates(middle, place);
      const isSeen = planes.every((plane) => plane.dotCoordinate(there) >= -this.#reach * own * scale);
      const origin = Vector3.TransformCoordinates(this.#origins[i], place).asArray();
      const unit = own * scale * factor * staggerAt(origin, stagger);
      return isSeen ? Vector3.Distance(there, camera.globalPosition) / unit : NaN;
    });
    this.#layers.forEach((layer, number) => fill(layer, distances, ranges[number]));
  }

  /** Frees this forest. Geometry and textures of the file stay with the scene. */
  dispose() {
    this.#scene.onBeforeRenderObservable.remove(this.#observer);
    this.#layers.forEach(({ level }) => level.dispose());
    this.root.dispose(false, false);
  }
}

/** Returns a level with room for `capacity` instances. `toTree`: the matrix of its node in the tree. */
function newLayer(level, capacity) {
  const toTree = level.node.computeWorldMatrix(true).clone();
  const back = Matrix.Invert(toTree);
  const instances = new Float32Array(16 * capacity);
  for (const mesh of level.meshes) {
    sharing(mesh.geometry, mesh.getScene()).applyToMesh(mesh);
    mesh.doNotSyncBoundingInfo = true;
    mesh.alwaysSelectAsActiveMesh = true; // The forest leaves out the trees that the camera does not see.
    mesh.thinInstanceSetBuffer("matrix", instances, 16, false);
  }
  // Babylon.js places an instance in the coordinates of its mesh.
  return { level, toTree, back, instances, count: 0, nearest: NEVER, matrixAt: (place) => toTree.multiply(place).multiply(back) };
}

/** Returns a geometry with the same buffers, for instances of its own. */
function sharing(geometry, scene) {
  const made = new Geometry(geometry.id, scene);
  for (const kind of geometry.getVerticesDataKinds()) {
    const own = geometry.getVertexBuffer(kind);
    const { byteStride, byteOffset, type, normalized } = own;
    const layout = { stride: byteStride, offset: byteOffset, size: own.getSize(), type, normalized, useBytes: true };
    const buffer = new VertexBuffer(scene.getEngine(), own.getWrapperBuffer(), kind, { ...layout, takeBufferOwnership: true });
    made.setVerticesBuffer(buffer, geometry.getTotalVertices());
  }
  made.setIndices(geometry.getIndices());
  return made;
}

/** Gives the meshes of a level a box around all trees, which lights ask for. `reach`: radius of a tree. */
function bound({ level, back }, spheres, reach) {
  const [least, most] = [new Vector3(Infinity, Infinity, Infinity), new Vector3(-Infinity, -Infinity, -Infinity)];
  for (const { middle, scale } of spheres) {
    const own = Vector3.TransformCoordinates(middle, back);
    const half = new Vector3(1, 1, 1).scaleInPlace((reach * scale) / level.scale);
    least.minimizeInPlace(own.subtract(half));
    most.maximizeInPlace(own.add(half));
  }
  level.meshes.forEach((mesh) => mesh.setBoundingInfo(new BoundingInfo(least, most)));
}

/** Gives a level the trees at distances in its range. */
function fill(layer, distances, [from, , , gone]) {
  const { level, matrices, instances } = layer;
  let count = 0;
  let nearest = NEVER;
  distances.forEach((distance, i) => {
    if (!(distance >= from && distance < gone)) return;
    matrices[i].copyToArray(instances, 16 * count++);
    nearest = Math.min(nearest, distance);
  });
  Object.assign(layer, { count, nearest });
  level.node.setEnabled(count > 0);
  for (const mesh of level.meshes) {
    mesh.thinInstanceCount = count;
    mesh.thinInstanceBufferUpdated("matrix");
  }
}

/** Returns the radius of a sphere around the center of the leaves that holds the level, also with grown leaves. */
function reachOf({ meshes }, centre) {
  const corners = meshes.flatMap((mesh) => mesh.getBoundingInfo().boundingBox.vectors);
  return Math.max(...corners.map((corner) => Vector3.Distance(corner, centre)));
}
