// Trees with levels of detail in three.js: loads NAME.glb and draws the level for the camera's distance, morphed and
// pruned by the laws of ../leafcloud.glsl.
//
//     const tree = await Tree.load("NAME.glb", { renderer });
//     scene.add(tree);
//     … before each picture: tree.update(camera, seconds);
//
// The shaders read uniforms and these attributes of a level's geometry: lcTarget, lcRank, lcPivot, lcPivotTarget. For
// files with wind also lcBillboardPivot, lcPhase and lcFreedom; `seconds` is the time of the wind.
import * as THREE from "three";
import { BlendOrder } from "./blending.js";
import { loadFile } from "./loading.js";
import { pagesOf, replaceByOctahedral } from "./octahedral.js";
import { after, before, replaced } from "./patching.js";
import { addTangents, shadeItself, bentNormalOf } from "./self_shadowing.js";

/** Source of ../leafcloud.glsl. The declarations below follow it in a vertex shader. */
export const LAWS = await text(new URL("../leafcloud.glsl", import.meta.url));
const DECLARATIONS = `
uniform vec3 lcTransitionAt; // distance, start, end
uniform vec3 lcKeepAt; // distance, prune start, prune half
uniform float lcShares[LC_SHARES];
uniform vec2 lcGrowth;
in vec3 lcTarget;
in float lcRank;
in vec3 lcPivot;
in vec3 lcPivotTarget;

vec3 lcPlaced(vec3 point) {
    float transition = lc_transition(lcTransitionAt.x, lcTransitionAt.y, lcTransitionAt.z);
    float keep = lc_keep(lcKeepAt.x, lcKeepAt.y, lcKeepAt.z);
    float scale = lc_area_scale(keep, lcShares) * lc_trend(keep, lcGrowth);
    float growth = lc_growth(lcRank, keep, scale);
    return lc_place(point, lcTarget, lcPivot, lcPivotTarget, transition, growth);
}
`;

/** Further declarations of vertex shaders for files with wind, for leaves and for the trunk. */
const WIND_DECLARATIONS = `
uniform LcWind lcWind;
in vec3 lcBillboardPivot;
in float lcPhase;
in float lcFreedom;

vec3 lcBlownLeaf(vec3 point) {
    float transition = lc_transition(lcTransitionAt.x, lcTransitionAt.y, lcTransitionAt.z);
    vec3 pivot = mix(lcPivot, lcPivotTarget, transition);
    vec3 turned = lc_flutter(lcPlaced(point), pivot, lcPhase, lcFreedom, transition, lcWind);
    return lc_blown(turned, lcPivot, lcBillboardPivot, transition, lcWind);
}
`;
const TRUNK_DECLARATIONS = `
uniform LcWind lcWind;

vec3 lcBlownTrunk(vec3 point) {
    return lc_blown(point, point, point, 0.0, lcWind);
}
`;

const FRAGMENT_DECLARATIONS = `
uniform vec3 lcKeepAt;
uniform vec3 lcMean;
uniform vec2 lcContrast;
uniform float lcShare; // fraction of the pixels that the next level draws
uniform bool lcNext; // true if this is the next level
`;
const FADE = `
    if (lc_shown(lcShare, gl_FragCoord.xy) != lcNext) discard;
`;
const CONTRAST = `
    float lcKept = lc_keep(lcKeepAt.x, lcKeepAt.y, lcKeepAt.z);
    diffuseColor.rgb = lc_toward_mean(diffuseColor.rgb, lcMean, lc_contrast(lcKept, lcContrast));
`;

/** The a at which the next level takes over: at 1 itself overlapping leaves have almost no depth order. */
const HAND_OVER = 0.998;

/** tan(½ fov) / pixels of the view that a file's distances are for: 50° over 1080 pixels. */
const FILE_VIEW = Math.tan((25 * Math.PI) / 180) / 1080;

/**
 * Settings of a tree's drawing. Distances are in the tree's own units.
 *
 * level: number of the level to show at all distances. null: the level for the distance.
 * lodDistance: factor on the distances of all levels. At 2 finer levels are drawn twice as far away, which costs time.
 * pixels: height of the picture in pixels. The distances then suit it and the camera's field of view, so that levels
 *   take over at the size in pixels for which they were baked. null: the file's distances, for 50° over 1080 pixels.
 * pruneStart: d₀ of the law of λ, for all levels. Infinity: no pruning. null: each level as it was baked.
 * pruneHalf: h of that law. Used if pruneStart is a number.
 * fade: fade length of a level that no level morphs to, as a fraction of its switch distance.
 * fadeBehindMorph: the same after a morph, for the remaining changes of lighting and alpha edges.
 * hysteresis: without a fade, the fraction of the distance by which a level stays longer when the camera returns, so
 *   that levels do not flicker.
 * wind: strength of the wind, like that of Blender's force fields; 0: no motion. null: the file's number. Files without
 *   wind ignore it.
 * contrast: true to move the colors of kept leaves toward their mean, if the file has the numbers.
 * byHand: {transition, keep} to replace the numbers for the camera's distance. The level still follows the distance.
 */
export const SETTINGS = {
  level: null,
  lodDistance: 1,
  pixels: null,
  pruneStart: null,
  pruneHalf: 0.5,
  fade: 0.25,
  fadeBehindMorph: 0.1,
  hysteresis: 0.02,
  contrast: true,
  wind: null,
  byHand: null,
};

export class Tree extends THREE.Group {
  /** The distance by which the file's numbers decide. */
  #seenFrom = 0;

  /**
   * Loads the tree from the GLB file at `url`. It is at rest until the first update. With the `renderer` that draws it,
   * the file's KTX2 textures are read, else its PNG textures.
   */
  static async load(url, { renderer } = {}) {
    const gltf = await loadFile(url, renderer);
    await addLevels(gltf);
    return new Tree(gltf, { bentNormal: await bentNormalOf(gltf), octahedral: await pagesOf(gltf) });
  }

  /** `textures`: Maps from materials to textures that three.js itself does not read. */
  constructor(gltf, textures) {
    super();
    this.add(gltf.scene);
    this.settings = { ...SETTINGS };
    this.levels = levelsOf(gltf, textures);
    this.level = 0;
    /** Distance of the camera from the center of the leaves, in the tree's own units. */
    this.distance = 0;
    const { center, radius } = sphereOf(this.levels[0], this);
    this.centre = center;
    this.radius = radius;
    this.levels.forEach((level) => (level.object.visible = level === this.levels[0]));
  }

  /** Shows the level for the camera's distance, with the wind at the time `seconds`. */
  update(camera, seconds = 0) {
    const eye = camera.getWorldPosition(new THREE.Vector3());
    this.distance = this.worldToLocal(eye.clone()).distanceTo(this.centre);
    this.#seenFrom = this.distance / this.#viewFactor(camera);
    this.level = this.#wantedLevel() ?? this.#levelAt(this.#seenFrom);
    const share = this.#shareOfNext();
    this.levels.forEach((level, number) => {
      const next = number === this.level + 1;
      level.object.visible = number === this.level || (next && share > 0);
      if (!level.object.visible) return;
      Object.assign(level.uniforms.lcShare, { value: share });
      Object.assign(level.uniforms.lcNext, { value: next });
      this.#move(level);
      level.blended.forEach((order) => order.update(eye));
      if (level.wind) this.#blow(level, seconds);
    });
  }

  /** The drawn level and its a and λ, as in the shaders. */
  get state() {
    const [transition, keep] = this.#laws(this.levels[this.level]);
    return { level: this.level, transition: transitionAt(...transition), keep: keepAt(...keep) };
  }

  /** The level of the settings, at most the last one; null: none is wanted. */
  #wantedLevel() {
    const { level } = this.settings;
    return Number.isInteger(level) ? Math.min(Math.max(level, 0), this.levels.length - 1) : null;
  }

  /** Factor on the file's distances for a camera. */
  #viewFactor(camera) {
    const { lodDistance, pixels } = this.settings;
    const fits = pixels !== null && camera.isPerspectiveCamera;
    const view = fits ? Math.tan((camera.getEffectiveFOV() * Math.PI) / 360) / pixels : FILE_VIEW;
    return (lodDistance * FILE_VIEW) / view;
  }

  #levelAt(distance) {
    const { levels } = this;
    let number = this.level;
    while (number + 1 < levels.length && distance >= this.#end(levels[number])) number++;
    while (number > 0 && distance < this.#end(levels[number - 1]) * (1 - this.#delay(levels[number - 1]))) number--;
    return number;
  }

  #fade(level) {
    return level.morphs ? this.settings.fadeBehindMorph : this.settings.fade;
  }

  /** Distance from which the level is no longer drawn. */
  #end(level) {
    return level.handOver * (1 + this.#fade(level));
  }

  /** Hysteresis of the level's end. A fade needs none: it is the same in both directions. */
  #delay(level) {
    return this.#fade(level) > 0 ? 0 : this.settings.hysteresis;
  }

  /** Fraction of the pixels that the next level draws. */
  #shareOfNext() {
    const level = this.levels[this.level];
    const fades = isFinite(level.handOver) && this.#fade(level) > 0 && this.#wantedLevel() === null;
    return fades ? transitionAt(this.#seenFrom, level.handOver, this.#end(level)) : 0;
  }

  /** Arguments of lc_transition and lc_keep. */
  #laws({ start, end, pruning }) {
    const { pruneStart, pruneHalf, byHand } = this.settings;
    if (byHand) return [[byHand.transition, 0, 1], [1, byHand.keep, 0.5]];
    const [from, half] = pruneStart === null ? [pruning.start, pruning.half] : [pruneStart, pruneHalf];
    return [[this.#seenFrom, start, end], [this.#seenFrom, Math.min(from, NEVER), half]];
  }

  /** Sets the wind. The file's direction is in world space; the shaders need it in the level's own coordinates. */
  #blow({ object, wind, uniforms }, seconds) {
    const strength = this.settings.wind ?? wind.strength;
    object.updateWorldMatrix(true, false);
    const place = new THREE.Vector3().setFromMatrixPosition(object.matrixWorld);
    const value = uniforms.lcWind.value;
    value.direction.fromArray(wind.direction).transformDirection(object.matrixWorld.clone().invert());
    value.force = strength / (Math.abs(strength) + 4);
    value.turns = seconds / wind.period + PLACE_TURNS.dot(place);
  }

  #move(level) {
    const [transition, keep] = this.#laws(level);
    level.uniforms.lcTransitionAt.value.fromArray(transition);
    level.uniforms.lcKeepAt.value.fromArray(keep);
    level.uniforms.lcContrast.value.fromArray(this.settings.contrast ? level.pruning.contrast : [0, 0]);
    for (const { geometry, prefixes } of level.pruned) {
      const step = Math.min(Math.ceil(keepAt(...keep) * (prefixes.length - 1) + 1e-6), prefixes.length - 1);
      geometry.setDrawRange(0, 3 * prefixes[step]);
    }
  }
}

/** A distance that no camera reaches. */
const NEVER = 1e9;

/** LC_PLACE_TURNS of leafcloud.glsl. */
const PLACE_TURNS = new THREE.Vector3(0.1732, 0.2236, -0.1414);

/** clamp((d − start) / (end − start), 0, 1), as in leafcloud.glsl. */
function transitionAt(distance, start, end) {
  return Math.min(Math.max((distance - start) / Math.max(end - start, 1e-30), 0), 1);
}

/** min((d₀/d)^(log_h ½), 1), as in leafcloud.glsl. */
function keepAt(distance, start, half) {
  return (start / Math.max(distance, start)) ** (Math.log(0.5) / Math.log(half));
}

async function text(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: ${response.status}`);
  return response.text();
}

/** Adds the levels that `MSFT_lod` names to the scene, because no scene of the file has them. */
async function addLevels({ scene, parser }) {
  const ids = parser.json.nodes.flatMap(({ extensions }) => extensions?.MSFT_lod?.ids ?? []);
  const behind = await Promise.all(ids.map((id) => parser.getDependency("node", id)));
  behind.forEach((level) => scene.add(level));
}

function levelsOf({ scene, parser }, textures) {
  const found = objectsOf(scene).filter(({ userData }) => userData.leafcloud?.level !== undefined);
  if (found.length === 0) throw new Error("No levels in this file: open a NAME.glb that Leafcloud wrote.");
  if (!found[0].userData.leafcloud.centre) throw new Error("An older Leafcloud wrote this file: bake the tree again.");
  const byNumber = (a, b) => a.userData.leafcloud.level - b.userData.leafcloud.level;
  const levels = found.sort(byNumber).map((object) => newLevel(object, parser, textures));
  levels.forEach((level, i) => {
    const switchDistance = levels[i + 1]?.switchDistance ?? Infinity;
    level.handOver = level.morphs ? level.start + HAND_OVER * (level.end - level.start) : switchDistance;
  });
  return levels;
}

function newLevel(object, parser, { bentNormal, octahedral }) {
  const { level, transition_start: start, transition_end: end, octahedral: impostor } = object.userData.leafcloud;
  const morphs = Number.isFinite(end);
  const pruning = pruningOf(object.userData.leafcloud);
  const { wind = null } = object.userData.leafcloud;
  const uniforms = newUniforms(pruning, wind);
  const [pruned, blended] = [[], []];
  for (const mesh of objectsOf(object).filter(({ isMesh }) => isMesh)) {
    if (octahedral.has(mesh.material)) {
      replaceByOctahedral(mesh, impostor, octahedral.get(mesh.material), (shader) => addFade(shader, uniforms));
      continue;
    }
    const table = tableOf(mesh, parser);
    if (table?.firstTexcoord) nameNumbers(mesh.geometry, table.firstTexcoord);
    const leaves = moves(mesh.geometry);
    if (wind) mesh.frustumCulled = false; // The wind moves points out of the bounds.
    if (mesh.material.transparent) blended.push(new BlendOrder(mesh, table?.order ?? null));
    if (leaves) {
      addAttributes(mesh.geometry, wind);
      mesh.frustumCulled = false; // Leaves grow out of the bounds.
      mesh.morphTargetInfluences = mesh.morphTargetDictionary = undefined;
      if (table?.shares) uniforms.lcShares.value = table.shares;
      // Blended triangles are not in rank order, so prefixes do not apply; pruned leaves have zero size there.
      if (table?.shares && !mesh.material.transparent) pruned.push({ geometry: mesh.geometry, prefixes: table.prefixes });
    }
    const shading = bentNormal.get(mesh.material);
    if (shading) addTangents(mesh.geometry);
    mesh.material = patched(mesh.material, uniforms, leaves, shading);
    // Mip levels would thin out the leaves' own textures, and the first cloud, which keeps its coverage, would pop.
    if (leaves && level === 0 && mesh.material.map) mesh.material.map.minFilter = THREE.LinearFilter;
  }
  const reach = morphs ? { start, end } : { start: NEVER, end: NEVER };
  const switchDistance = (impostor ?? object.userData.leafcloud).switch_distance;
  return { number: level, object, morphs, ...reach, switchDistance, pruning, wind, uniforms, pruned, blended };
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

function newUniforms({ growth, mean }, wind) {
  return {
    ...(wind && { lcWind: { value: newWind(wind) } }),
    lcTransitionAt: { value: new THREE.Vector3(0, NEVER, NEVER) },
    lcKeepAt: { value: new THREE.Vector3(0, NEVER, 0.5) },
    lcShares: { value: Array.from({ length: 65 }, (_, i) => (i / 64) ** 2) },
    lcGrowth: { value: new THREE.Vector2(...growth) },
    lcContrast: { value: new THREE.Vector2() },
    lcMean: { value: new THREE.Vector3(...mean) },
    lcShare: { value: 0 },
    lcNext: { value: false },
  };
}

/** Returns an LcWind of leafcloud.glsl without force. */
function newWind({ up, foot, height, spread, gusts, sway, branches, flutter }) {
  const [upward, standing] = [up, foot].map((vector) => new THREE.Vector3(...vector));
  const shape = { up: upward, foot: standing, height, spread, gusts, sway, branches, flutter };
  return { direction: new THREE.Vector3(1, 0, 0), ...shape, force: 0, turns: 0 };
}

function objectsOf(root) {
  const found = [];
  root.traverse((object) => found.push(object));
  return found;
}

function moves({ attributes, morphAttributes }) {
  return "_leaf_rank" in attributes || "_leaf_pivot" in attributes || "position" in morphAttributes;
}

/** Returns the mesh's tables. Reads the file itself, because in `userData` a node's extras may overwrite its mesh's. */
function tableOf(mesh, parser) {
  const { meshes, primitives } = parser.associations.get(mesh);
  const extras = parser.json.meshes[meshes].extras?.leafcloud;
  if (!extras) return undefined;
  const { area_shares: shares, prefixes, blend_order: orders, first_texcoord: firstTexcoord } = extras;
  return { shares, prefixes: prefixes?.[primitives].triangles, order: orders?.[primitives], firstTexcoord };
}

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

/** Makes named attributes from texture coordinates, for files of engines that drop custom attributes. */
function nameNumbers(geometry, first) {
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
function addAttributes(geometry, wind) {
  const { position, _leaf_rank: rank, _leaf_pivot: pivot, _leaf_pivot_target: pivotTarget } = geometry.attributes;
  geometry.setAttribute("lcTarget", targetsOf(geometry));
  const ranks = (_, i) => (rank ? rank.getX(i) : -1);
  geometry.setAttribute("lcRank", new THREE.BufferAttribute(Float32Array.from({ length: position.count }, ranks), 1));
  geometry.setAttribute("lcPivot", pivot ?? position);
  geometry.setAttribute("lcPivotTarget", pivotTarget ?? pivot ?? position);
  if (wind) addWind(geometry, pivot ?? position);
  Object.keys(NUMBERS).forEach((name) => geometry.deleteAttribute(name));
}

/** Adds the wind's attributes. Vertices without a target billboard use their own pivot; only leaves flutter. */
function addWind(geometry, pivot) {
  const { position, _leaf_billboard_pivot: billboardPivot, _leaf_rank: own } = geometry.attributes;
  const column = (at) => new THREE.BufferAttribute(Float32Array.from({ length: position.count }, (_, i) => at(i)), 1);
  geometry.setAttribute("lcBillboardPivot", billboardPivot ?? pivot);
  geometry.setAttribute("lcPhase", column((i) => own?.getY(i) ?? 0));
  geometry.setAttribute("lcFreedom", column((i) => own?.getZ(i) ?? 0));
}

/** Returns the morph target as an attribute of positions; three.js itself uses a texture of offsets. */
function targetsOf(geometry) {
  const { position } = geometry.attributes;
  const [offsets] = geometry.morphAttributes.position ?? [];
  geometry.morphAttributes = {};
  if (!offsets) return position;
  return new THREE.BufferAttribute(position.array.map((value, i) => value + offsets.array[i]), 3);
}

/**
 * Returns the bounding sphere of a level's leaves without trunk, in `root`'s coordinates. Distances are from its
 * center.
 */
function sphereOf({ object }, root) {
  root.updateWorldMatrix(true, true);
  const { centre, radius } = object.userData.leafcloud;
  const toRoot = root.matrixWorld.clone().invert().multiply(object.matrixWorld);
  return new THREE.Sphere(new THREE.Vector3(...centre), radius).applyMatrix4(toRoot);
}

/** Returns a copy of the material that includes the laws; with `shading` it has self-shadowing. */
function patched(original, uniforms, leaves, shading) {
  const material = original.clone();
  material.forceSinglePass = true; // Otherwise three.js draws all blended backs before all fronts.
  material.color.multiplyScalar(original.userData.leafcloud?.light_strength ?? 1);
  const wind = "lcWind" in uniforms;
  material.customProgramCacheKey = () => `leafcloud ${leaves} ${wind} ${Boolean(shading)}`;
  material.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = vertexShader(shader.vertexShader, leaves, wind);
    shader.fragmentShader = fragmentShader(shader.fragmentShader, leaves);
    if (shading) shadeItself(shader, shading);
  };
  return material;
}

/** Adds the cross-fade alone to a shader. */
function addFade(shader, uniforms) {
  Object.assign(shader.uniforms, uniforms);
  shader.fragmentShader = fragmentShader(shader.fragmentShader, false);
}

/** Returns the declarations of a vertex shader for leaves or for the trunk, and the expression of the moved point. */
export function placing(leaves, wind) {
  if (leaves && wind) return [LAWS + DECLARATIONS + WIND_DECLARATIONS, "lcBlownLeaf(position)"];
  if (leaves) return [LAWS + DECLARATIONS, "lcPlaced(position)"];
  return wind ? [LAWS + TRUNK_DECLARATIONS, "lcBlownTrunk(position)"] : ["", "position"];
}

function vertexShader(source, leaves, wind) {
  const [declarations, place] = placing(leaves, wind);
  const placed =
    place === "position" ? source : replaced(source, "#include <begin_vertex>", `vec3 transformed = ${place};`);
  return before("void main()", declarations, placed);
}

function fragmentShader(source, leaves) {
  const faded = after("#include <clipping_planes_fragment>", FADE, source);
  const shaded = leaves ? after("#include <color_fragment>", CONTRAST, faded) : faded;
  return before("void main()", LAWS + FRAGMENT_DECLARATIONS, shaded);
}
