// The levels of a file: read once (`sourcesOf`), then dressed in materials for each tree or forest (`Level`).
import * as THREE from "three";
import { addAttributes, addTangents, hasLeaves, nameNumbers, sharing } from "./attributes.js";
import { BlendOrder } from "./blending.js";
import { HAND_OVER, keepAt, NEVER, PLACE_TURNS, windForce } from "./laws.js";
import { cutOf } from "./shares.js";
import { alphaIsShare, bentNormalOf, keepCoverage, pagesOf } from "./textures.js";
import { newUniforms } from "./uniforms.js";

/**
 * Reads the levels of tree number `tree` of a file that GLTFLoader loaded, the leaves first. The file's meshes become the sources
 * of all copies; its scene has only this tree's levels afterwards.
 *
 * Each source has `object`, its node; `parts`, its meshes; the distances `start` and `end` of its morph, and `handOver`,
 * where the next level begins to appear; `pruning` and `wind`, their numbers.
 */
export async function sourcesOf(gltf, tree) {
  await keepLevels(gltf, tree);
  const textures = { bentNormal: await bentNormalOf(gltf), octahedral: await pagesOf(gltf) };
  const found = objectsOf(gltf.scene).filter(({ userData }) => userData.leafcloud?.level !== undefined);
  if (found.length === 0) throw new Error("No levels in this file: open a NAME.glb that Leafcloud wrote.");
  if (!found[0].userData.leafcloud.centre) throw new Error("An older Leafcloud wrote this file: bake the tree again.");
  const byNumber = (a, b) => a.userData.leafcloud.level - b.userData.leafcloud.level;
  const sources = found.sort(byNumber).map((object) => newSource(object, gltf.parser, textures));
  sources.forEach((source, i) => {
    const switchDistance = sources[i + 1]?.switchDistance ?? Infinity;
    source.handOver = source.morphs ? source.start + HAND_OVER * (source.end - source.start) : switchDistance;
  });
  return sources;
}

/** Adds the levels that `MSFT_lod` names to the scene, because no scene of the file has them, and removes the other trees. */
async function keepLevels({ scene, parser }, tree) {
  const chains = chainsIn(parser.json);
  if (chains.length > 0 && !chains[tree]) {
    throw new Error(`The file has ${chains.length} trees, and no tree ${tree}: choose a number below ${chains.length}.`);
  }
  const own = chains[tree] ?? [];
  const others = objectsOf(scene).filter((object) => {
    const { nodes } = parser.associations.get(object) ?? {};
    return chains.flat().includes(nodes) && !own.includes(nodes) && object.userData.leafcloud;
  });
  others.forEach((object) => object.removeFromParent());
  const behind = await Promise.all(own.slice(1).map((id) => parser.getDependency("node", id)));
  behind.forEach((level) => scene.add(level));
}

/** Returns the numbers of the nodes of each tree's levels. A file of one level has one for each tree. */
export function chainsIn({ nodes }) {
  const hasLevel = (node) => node.extras?.leafcloud?.level !== undefined;
  const behind = nodes.flatMap(({ extensions }) => extensions?.MSFT_lod?.ids ?? []);
  const firsts = nodes.map((_, number) => number).filter((number) => hasLevel(nodes[number]) && !behind.includes(number));
  return firsts.map((number) => [number, ...(nodes[number].extensions?.MSFT_lod?.ids ?? [])]);
}

function newSource(object, parser, textures) {
  const extras = object.userData.leafcloud;
  const { level: number, transition_start: start, transition_end: end, wind = null, octahedral } = extras;
  const morphs = Number.isFinite(end);
  object.updateMatrixWorld(true);
  return {
    number,
    object,
    morphs,
    ...(morphs ? { start, end } : { start: NEVER, end: NEVER }),
    switchDistance: (octahedral ?? extras).switch_distance,
    centre: new THREE.Vector3(...extras.centre),
    radius: extras.radius,
    // The shader measures the scale of a place along the same axis.
    scale: new THREE.Vector3().setFromMatrixColumn(object.matrixWorld, 0).length(),
    pruning: pruningOf(extras),
    wind,
    parts: partsOf(object, parser, textures, { number, wind, impostor: octahedral }),
  };
}

/** Returns a level's pruning numbers from its extras; without them the level is not pruned. */
function pruningOf(extras) {
  return {
    start: extras.prune_start ?? Infinity,
    half: extras.prune_half ?? 0.5,
    growth: extras.growth ?? [0, 0],
    contrast: extras.contrast ?? [0, 0],
    mean: extras.mean_color ?? [0, 0, 0],
  };
}

/** Returns the meshes below `object`, each with its place among all objects there. */
function partsOf(object, parser, { bentNormal, octahedral }, { number, wind, impostor }) {
  return objectsOf(object)
    .map((mesh, place) => ({ mesh, place }))
    .filter(({ mesh }) => mesh.isMesh)
    .map(({ mesh, place }) => {
      const pages = octahedral.get(mesh.material);
      if (pages) return { place, geometry: QUAD, impostor: { numbers: impostor, ...pages }, material: mesh.material };
      const shading = bentNormal.get(mesh.material);
      if (shading) addTangents(mesh.geometry);
      const made = prepared(mesh, parser, wind);
      if (number === 0 && !made.isTrunk) keepCoverage(mesh.material);
      const cut = !made.isTrunk && alphaIsShare(mesh.material) ? cutOf(mesh.material) : null;
      return { place, ...made, material: mesh.material, shading, cut };
    });
}

/** Gives a mesh the attributes of the shaders. Returns its geometry and tables. */
function prepared(mesh, parser, wind) {
  const { geometry } = mesh;
  const table = tableOf(mesh, parser);
  if (table.firstTexcoord) nameNumbers(geometry, table.firstTexcoord);
  const leaves = !table.isTrunk && hasLeaves(geometry);
  if (leaves) addAttributes(geometry, wind);
  geometry.morphAttributes = {};
  return { geometry, leaves, ...table };
}

/** Returns the mesh's tables. Reads the file itself, because in `userData` a node's extras may overwrite its mesh's. */
function tableOf(mesh, parser) {
  const { meshes, primitives } = parser.associations.get(mesh);
  const extras = parser.json.meshes[meshes].extras?.leafcloud ?? {};
  const { area_shares: shares, prefixes, blend_order: orders, first_texcoord: firstTexcoord } = extras;
  const isTrunk = primitives >= (extras.first_trunk_primitive ?? Infinity);
  if (isTrunk) return { isTrunk };
  return { isTrunk, shares, prefixes: prefixes?.[primitives].triangles, order: orders?.[primitives], firstTexcoord };
}

export function objectsOf(root) {
  const found = [];
  root.traverse((object) => found.push(object));
  return found;
}

/** A level's meshes with materials and uniforms of their own. */
export class Level {
  #looks;

  /** `object`: a copy of the source's object, for the meshes. `looks`: the module of the materials for the renderer. */
  constructor(source, object, looks) {
    this.#looks = looks;
    Object.assign(this, source, { object, uniforms: newUniforms(source), pruned: [], blended: [], meshes: [] });
    const objects = objectsOf(object);
    for (const part of source.parts) this.#dress(objects[part.place], part);
  }

  #dress(mesh, part) {
    const { uniforms } = this;
    mesh.geometry = sharing(part.geometry);
    mesh.morphTargetInfluences = mesh.morphTargetDictionary = undefined;
    mesh.userData = { ...mesh.userData, isTrunk: part.isTrunk ?? false };
    this.meshes.push(mesh);
    this.#looks.dress(mesh, part, uniforms);
    if (part.impostor) {
      mesh.frustumCulled = false; // Its corners are not where the geometry says.
      return;
    }
    if (part.leaves || this.wind) mesh.frustumCulled = false; // Leaves grow, and the wind moves points, out of the bounds.
    const blends = part.material.transparent;
    if (blends) this.blended.push(new BlendOrder(mesh, part.order ?? null));
    if (part.shares) uniforms.lcShares.value = part.shares;
    // Blended triangles are not in rank order, so prefixes do not apply; pruned leaves have zero size there.
    if (part.shares && !blends) this.pruned.push({ geometry: mesh.geometry, prefixes: part.prefixes });
  }

  /** Frees the level's own materials and geometries. Attributes and textures belong to all copies of the tree. */
  dispose() {
    for (const mesh of this.meshes) {
      const { geometry, material } = mesh;
      Object.keys(geometry.attributes).forEach((name) => geometry.deleteAttribute(name));
      if (this.blended.length === 0) geometry.setIndex(null);
      geometry.dispose();
      material.dispose();
      this.#looks.undress(mesh);
    }
  }

  /** Length of the fade to the next level, as a fraction of the distance. */
  fade({ fade, fadeBehindMorph }) {
    return this.morphs ? fadeBehindMorph : fade;
  }

  /** Distance from which the level is no longer drawn. */
  goneAt(settings) {
    return this.handOver * (1 + this.fade(settings));
  }

  /** d₀ and h of the law of λ. */
  keepLaw({ pruneStart, pruneHalf }) {
    const [start, half] = pruneStart === null ? [this.pruning.start, this.pruning.half] : [pruneStart, pruneHalf];
    return [Math.min(start, NEVER), half];
  }

  /** Sets the laws for a camera at `distance`: `transition` is {start, end}, `keep` is [start, half]. */
  move(distance, transition, keep, { contrast, shadows }) {
    const { lcTransitionAt, lcKeepAt, lcContrast, lcShadows } = this.uniforms;
    lcTransitionAt.value.set(distance, transition.start, transition.end);
    lcKeepAt.value.fromArray(keep);
    lcContrast.value.fromArray(contrast ? this.pruning.contrast : [0, 0]);
    lcShadows.value = Number(shadows);
    for (const { geometry, prefixes } of this.pruned) {
      const step = Math.min(Math.ceil(keepAt(distance, ...keep) * (prefixes.length - 1) + 1e-6), prefixes.length - 1);
      geometry.setDrawRange(0, 3 * prefixes[step]);
    }
  }

  /**
   * Sets the wind at the time `seconds`. `strength`: null for the file's. The file's direction is in world space; `toLevel`
   * turns it into the level's coordinates, and `place` is the tree's in the world. Instances add their own.
   */
  blow(strength, seconds, toLevel, place) {
    if (!this.wind) return;
    const { value } = this.uniforms.lcWind;
    value.direction.fromArray(this.wind.direction).transformDirection(toLevel);
    value.force = windForce(strength ?? this.wind.strength);
    value.turns = seconds / this.wind.period + place.dot(PLACE);
  }
}

const PLACE = new THREE.Vector3(...PLACE_TURNS);

/** The corners of a quad, for all octahedral impostors. */
const QUAD = new THREE.PlaneGeometry(2, 2);
