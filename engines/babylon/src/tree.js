// A tree with levels of detail in Babylon.js.
import { BaseTexture, BoundingInfo, Camera, LoadAssetContainerAsync, Texture, Vector3, VertexBuffer } from "@babylonjs/core";
import "@babylonjs/loaders/glTF/index.js";
import { joined, levelsIn, split, withLevels } from "./glb.js";
import { areaScale, HAND_OVER, keepAt, NEVER, transitionAt, trend, viewFactor } from "./laws.js";
import { LEAF, LevelPlugin, TARGET } from "./material.js";

/**
 * Settings of a tree. Distances are in the tree's own units.
 *
 * level: number of the level to show at all distances. null: the level for the distance.
 * lodDistance: factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time.
 * pixels: height of the picture in pixels; null: that of the engine.
 * fade: fade length of a level that no level morphs to, as a fraction of its switch distance.
 * fadeBehindMorph: the same after a morph.
 */
export const SETTINGS = { level: null, lodDistance: 1, pixels: null, fade: 0.25, fadeBehindMorph: 0.1 };

/** Length of a box's half over the crown's radius: growing leaves reach beyond the crown. */
const REACH = 1.2;

/** Kinds that hold numbers, from TEXCOORD_2 on; Babylon.js reads no more than these. */
const NUMBERS = [VertexBuffer.UV3Kind, VertexBuffer.UV4Kind, VertexBuffer.UV5Kind, VertexBuffer.UV6Kind];

/**
 * Loads a tree from the GLB file at `url` into `scene`. It switches by itself before each picture. `ktx2`: read KTX2
 * textures, which needs Babylon.js's transcoder. `tree`: its number, in a file of several. The file must be baked with
 * `--engine babylon`.
 */
export async function loadTree(url, scene, { ktx2 = false, tree = 0 } = {}) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: ${response.status}`);
  const { document, rest } = split(await response.arrayBuffer());
  const levels = levelsIn(document, tree);
  const content = joined(withLevels(document, { ktx2, tree }), rest);
  const container = await LoadAssetContainerAsync(content, scene, { pluginExtension: ".glb", name: url });
  // A texture that arrives later would get the sampling of its file again.
  await new Promise((done) => BaseTexture.WhenAllReady(container.textures, done));
  prepare(container, levels);
  return new Tree({ container, levels }, scene);
}

/** Gives the meshes of leaves the vertex data of the plug-in. */
function prepare(container, levels) {
  for (const { name, tables, primitives, extras } of levels) {
    const meshes = meshesOf(container.getNodes().find((node) => node.name === name));
    const firstTrunk = tables.first_trunk_primitive ?? primitives;
    meshes.slice(firstTrunk).forEach((mesh) => (mesh.morphTargetManager = null));
    for (const mesh of meshes.slice(0, firstTrunk)) {
      if (tables.first_texcoord) nameNumbers(mesh);
      else if (tables.prefixes) throw new Error("The file has numbers that Babylon.js drops: bake with --engine babylon.");
      if (mesh.material?.albedoTexture) sharpen(mesh.material.albedoTexture, extras.level);
    }
  }
}

/** Wide filters would mix the leaves with the empty texels around them. */
function sharpen(texture, level) {
  texture.anisotropicFilteringLevel = 1;
  // Mip levels would thin out the leaves' own textures, and the first cloud, which keeps its coverage, would pop.
  if (level === 0) texture.updateSamplingMode(Texture.LINEAR_LINEAR);
}

function nameNumbers(mesh) {
  const sets = NUMBERS.map((kind) => mesh.getVerticesData(kind));
  const numbers = (width, at) => Float32Array.from({ length: width * mesh.getTotalVertices() }, (_, i) => at(Math.floor(i / width), i % width));
  const number = (vertex, place) => sets[place >> 1]?.[2 * vertex + (place % 2)] ?? 0;
  mesh.setVerticesData(LEAF, numbers(4, number), false, 4);
  // A level that does not morph has no second pivot.
  const first = sets[2] ? 4 : 1;
  mesh.setVerticesData(TARGET, numbers(3, (vertex, i) => number(vertex, first + i)), false, 3);
  NUMBERS.forEach((kind) => mesh.removeVerticesData(kind));
}

/** Returns the meshes of a node in the order of its primitives. */
function meshesOf(node) {
  return node.getChildMeshes(false).length ? node.getChildMeshes(false) : [node];
}

export class Tree {
  #source;
  #scene;
  #observer;
  #levels;

  constructor(source, scene) {
    this.#source = source;
    this.#scene = scene;
    this.settings = { ...SETTINGS };
    this.level = 0;
    /** Distance of the camera from the center of the leaves, in the tree's own units. */
    this.distance = 0;
    const made = source.container.instantiateModelsToScene((name) => name, false, { doNotInstantiate: true });
    /** The node to place the tree by. */
    this.root = made.rootNodes[0];
    this.#levels = source.levels.map((each) => newLevel(each, this.root));
    this.#levels.forEach((level, i) => {
      const next = this.#levels[i + 1]?.switchDistance ?? Infinity;
      level.handOver = level.isMorphing ? level.start + HAND_OVER * (level.end - level.start) : next;
    });
    this.centre = Vector3.FromArray(source.levels[0].extras.centre);
    this.radius = source.levels[0].extras.radius;
    this.update(null);
    this.#observer = scene.onBeforeRenderObservable.add(() => this.update(scene.activeCamera));
  }

  /** Returns a tree with the same geometry and textures. */
  clone() {
    return Object.assign(new Tree(this.#source, this.#scene), { settings: { ...this.settings } });
  }

  dispose() {
    this.#scene.onBeforeRenderObservable.remove(this.#observer);
    this.#levels.forEach(({ materials, morphs }) => [...materials, ...morphs].forEach((each) => each.dispose()));
    this.root.dispose(false, false);
  }

  /** Shows the level for the camera's distance. The scene calls it before each picture. */
  update(camera) {
    const seenFrom = camera ? this.#measure(camera) : 0;
    this.level = this.#wanted() ?? this.#levels.filter((level) => seenFrom >= this.#goneAt(level)).length;
    const share = this.#shareOfNext(seenFrom);
    this.#levels.forEach((level, number) => {
      const next = number === this.level + 1;
      const shown = number === this.level || (next && share > 0);
      level.node.setEnabled(shown);
      if (shown) move(level, seenFrom, next ? [share, 0] : [1, share]);
    });
  }

  /** Returns the distance by which the file's numbers decide. */
  #measure(camera) {
    const { node } = this.#levels[0];
    const place = node.computeWorldMatrix(true);
    const scale = Math.cbrt(Math.abs(place.determinant()));
    const away = Vector3.Distance(camera.globalPosition, Vector3.TransformCoordinates(this.centre, place));
    const own = Math.cbrt(Math.abs(node.scaling.x * node.scaling.y * node.scaling.z));
    this.distance = (away * own) / scale;
    const pixels = this.settings.pixels ?? this.#scene.getEngine().getRenderHeight();
    return this.distance / viewFactor(this.#fieldOfView(camera), { ...this.settings, pixels });
  }

  #fieldOfView(camera) {
    if (camera.mode !== Camera.PERSPECTIVE_CAMERA) return null;
    const upright = camera.fovMode === Camera.FOVMODE_VERTICAL_FIXED;
    const aspect = this.#scene.getEngine().getAspectRatio(camera);
    return upright ? camera.fov : 2 * Math.atan(Math.tan(camera.fov / 2) / aspect);
  }

  #wanted() {
    const { level } = this.settings;
    return Number.isInteger(level) ? Math.min(Math.max(level, 0), this.#levels.length - 1) : null;
  }

  #fade(level) {
    return level.isMorphing ? this.settings.fadeBehindMorph : this.settings.fade;
  }

  #goneAt(level) {
    return level.handOver * (1 + this.#fade(level));
  }

  #shareOfNext(seenFrom) {
    const level = this.#levels[this.level];
    const fades = isFinite(level.handOver) && this.#wanted() === null;
    return fades ? transitionAt(seenFrom, level.handOver, this.#goneAt(level)) : 0;
  }
}

/** Returns a level below `root`, with materials of its own. */
function newLevel({ name, extras, tables, primitives }, root) {
  const node = root.getDescendants(false).find((each) => each.name === name);
  const isMorphing = Number.isFinite(extras.transition_end);
  const level = {
    node,
    isMorphing,
    start: isMorphing ? extras.transition_start : NEVER,
    end: isMorphing ? extras.transition_end : NEVER,
    switchDistance: extras.switch_distance,
    extras,
    shares: tables.area_shares,
    plugins: [],
    materials: [],
    morphs: [],
    pruned: [],
  };
  const firstTrunk = tables.first_trunk_primitive ?? primitives;
  meshesOf(node).forEach((mesh, number) => dress(level, mesh, number < firstTrunk ? tables.prefixes?.[number]?.triangles : null));
  return level;
}

function dress(level, mesh, prefixes) {
  const { centre, radius, mean_color: mean } = level.extras;
  mesh.material = mesh.material.clone(mesh.material.name);
  level.materials.push(mesh.material);
  // Levels with baked light store colors above 1 with this factor.
  mesh.material.albedoColor?.scaleInPlace(mesh.material.metadata?.gltf?.extras?.leafcloud?.light_strength ?? 1);
  const plugin = new LevelPlugin(mesh.material, mesh.isVerticesDataPresent(LEAF));
  if (mean) plugin.mean = mean;
  level.plugins.push(plugin);
  const [middle, half] = [Vector3.FromArray(centre), new Vector3(REACH * radius, REACH * radius, REACH * radius)];
  const box = mesh.getBoundingInfo();
  const [least, most] = [middle.subtract(half), middle.add(half)];
  mesh.setBoundingInfo(new BoundingInfo(Vector3.Minimize(box.minimum, least), Vector3.Maximize(box.maximum, most)));
  if (mesh.morphTargetManager) {
    mesh.morphTargetManager = mesh.morphTargetManager.clone();
    level.morphs.push(mesh.morphTargetManager);
  }
  if (prefixes) level.pruned.push({ part: mesh.subMeshes[0], prefixes });
}

/** Sets the laws of a level for a camera at `distance`. `fade`: the shares of pixels of this level and of the next. */
function move(level, distance, fade) {
  const { extras, shares } = level;
  const transition = transitionAt(distance, level.start, level.end);
  const keep = extras.prune_start ? keepAt(distance, extras.prune_start, extras.prune_half ?? 0.5) : 1;
  const scale = shares ? areaScale(keep, shares) * trend(keep, extras.growth ?? [0, 0]) : 1;
  const contrast = Math.min(trend(keep, extras.contrast ?? [0, 0]), 1);
  level.plugins.forEach((plugin) => Object.assign(plugin, { fade, numbers: [transition, keep, scale, contrast] }));
  level.morphs.forEach((morph) => (morph.getTarget(0).influence = transition));
  for (const { part, prefixes } of level.pruned) {
    const step = Math.min(Math.ceil(keep * (prefixes.length - 1) + 1e-6), prefixes.length - 1);
    part.indexCount = 3 * prefixes[step];
  }
}
