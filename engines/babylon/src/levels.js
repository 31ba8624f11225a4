// The levels of a file: read once (`sourcesOf`), then dressed in materials for each tree or forest (`Level`).
import { BoundingInfo, ShadowDepthWrapper, Vector3, VertexBuffer } from "@babylonjs/core";
import { addAttributes } from "./attributes.js";
import { HAND_OVER, keepAt, NEVER, windForce } from "./laws.js";
import { LevelPlugin, newNumbers } from "./material.js";
import { ImpostorPlugin, impostorNumbers, impostorMaterial, QUAD } from "./octahedral.js";
import { drawShares, pivotsOf } from "./shares.js";
import { hasShares, keepShares } from "./textures.js";

/** Reach of growing leaves in crown radii: they extend beyond the crown. */
const REACH = 1.2;

/**
 * Gives the meshes of a loaded container the attributes of the shaders. Returns the sources of all copies, the leaves first. Each has
 * `name`, of its node; `extras` and `tables`; `pages`, the textures of an octahedral impostor; the distances `start` and `end` of its
 * morph, and `handOver`, where the next level begins to appear.
 */
export async function sourcesOf(container, levels) {
  for (const { name, extras, numbers, pages } of levels) {
    const meshes = meshesOf(container.getNodes().find((node) => node.name === name));
    if (pages) {
      meshes[0].removeVerticesData(VertexBuffer.TangentKind);
      QUAD.applyToMesh(meshes[0]);
      continue;
    }
    numbers.forEach((each, i) => addAttributes(meshes[i], each));
    for (const { material } of meshes.slice(0, numbers.length)) {
      if (!material?.albedoTexture) continue;
      // Wide filters would mix the leaves with the empty texels around them.
      material.albedoTexture.anisotropicFilteringLevel = 1;
      if (extras.level === 0) await keepShares(material);
    }
  }
  const sources = levels.map(({ name, extras, tables, numbers, pages }) => {
    const morphs = Number.isFinite(extras.transition_end);
    const { transition_start: start, transition_end: end } = extras;
    return { name, extras, tables, pages, leaves: numbers.length, morphs, ...(morphs ? { start, end } : { start: NEVER, end: NEVER }) };
  });
  sources.forEach((source, i) => {
    const { extras } = sources[i + 1] ?? {};
    const next = (extras?.octahedral ?? extras)?.switch_distance ?? Infinity;
    source.handOver = source.morphs ? source.start + HAND_OVER * (source.end - source.start) : next;
  });
  return sources;
}

/** Returns the meshes of a node in the order of its primitives. */
function meshesOf(node) {
  return node.getChildMeshes(false).length ? node.getChildMeshes(false) : [node];
}

/**
 * Returns for each level the distances at which it appears (from, to) and goes (from, to). `wanted`: the level for all distances,
 * or null.
 */
export function rangesOf(levels, wanted, settings) {
  const fade = ({ morphs }) => (morphs ? settings.fadeBehindMorph : settings.fade);
  const ends = levels.slice(0, -1).map((level) => [level.handOver, level.handOver * (1 + fade(level))]);
  const always = [-2, -1, NEVER, 2 * NEVER];
  if (wanted !== null) return levels.map((_, number) => (number === wanted ? always : [NEVER, NEVER, NEVER, NEVER]));
  return levels.map((_, number) => [...(ends[number - 1] ?? always.slice(0, 2)), ...(ends[number] ?? always.slice(2))]);
}

/** A level's meshes below a tree's root, with materials of their own. */
export class Level {
  #numbers = newNumbers();
  #pruned = [];

  /** `root`: the node of a copy of the file's scene. */
  constructor(source, root) {
    const { name, extras, tables, leaves } = source;
    Object.assign(this, source);
    this.node = root.getDescendants(false).find((each) => each.name === name);
    this.meshes = meshesOf(this.node);
    /** Factor of length of the level's node. */
    this.scale = scaleOf(this.node.computeWorldMatrix(true)) / scaleOf(root.computeWorldMatrix(true));
    this.wind = extras.wind ?? null;
    this.#set(extras, tables.area_shares);
    this.meshes.forEach((mesh, i) => this.#dress(mesh, i < leaves, tables.prefixes?.[i]?.triangles));
  }

  #set(extras, shares) {
    const found = {
      lcCentre: extras.centre,
      lcTransitionAt: [this.start, this.end],
      lcKeepAt: [Math.min(extras.prune_start ?? NEVER, NEVER), extras.prune_half ?? 0.5],
      lcGrowth: extras.growth,
      lcContrast: extras.contrast,
      lcMean: extras.mean_color,
      lcShares: shares,
    };
    Object.entries(found).forEach(([name, value]) => value && (this.#numbers[name] = value));
  }

  #dress(mesh, leaves, prefixes) {
    const pivots = leaves && !this.pages ? pivotsOf(mesh.material) : null;
    mesh.material = this.pages ? this.#impostor(mesh.material) : this.#cloud(mesh.material, leaves, pivots);
    if (this.pages || pivots) drawShares(mesh);
    const { material } = mesh;
    material.shadowDepthWrapper = new ShadowDepthWrapper(material, mesh.getScene(), { standalone: true });
    // The wind moves points out of any bounds.
    mesh.alwaysSelectAsActiveMesh = this.wind !== null;
    widen(mesh, this.extras);
    if (leaves && prefixes) this.#pruned.push({ mesh, prefixes });
  }

  #cloud(original, leaves, pivots) {
    const material = original.clone(original.name);
    if (hasShares(original.albedoTexture)) {
      material.albedoTexture.dispose();
      material.albedoTexture = original.albedoTexture;
    }
    // Levels with baked light store colors above 1 with this factor.
    material.albedoColor?.scaleInPlace(material.metadata?.gltf?.extras?.leafcloud?.light_strength ?? 1);
    new LevelPlugin(material, { numbers: this.#numbers, leaves, wind: this.wind !== null, pivots });
    return material;
  }

  #impostor(original) {
    Object.assign(this.#numbers, impostorNumbers(this.extras.octahedral));
    const material = impostorMaterial(original);
    new ImpostorPlugin(material, { numbers: this.#numbers, pages: this.pages });
    return material;
  }

  /**
   * Sets the laws for a picture. `eye`: the camera's place in the world. `factor`: on the file's distances. `range`: distances at
   * which the level appears and goes. `nearest`: distance of the nearest tree; its kept leaves are drawn.
   */
  move({ eye, factor, range, nearest, settings }) {
    const numbers = this.#numbers;
    const view = { lcViewer: eye.asArray(), lcUnit: [factor / this.scale], lcStagger: [settings.stagger] };
    Object.assign(numbers, view, { lcFadeAt: range });
    if (this.wind) this.#blow(this.wind, settings);
    for (const { mesh, prefixes } of this.#pruned) {
      const keep = keepAt(nearest, ...numbers.lcKeepAt);
      const step = Math.min(Math.ceil(keep * (prefixes.length - 1) + 1e-6), prefixes.length - 1);
      mesh.subMeshes[0].indexCount = 3 * prefixes[step];
    }
  }

  #blow({ direction: [x, y, z], up, foot, height, spread, gusts, flutter, strength, period, sway, branches }, { wind, seconds }) {
    // Babylon.js mirrors the x of files in left-handed scenes.
    const handed = this.node.getScene().useRightHandedSystem ? 1 : -1;
    Object.assign(this.#numbers, {
      lcWindDirection: [handed * x, y, z],
      lcWindUp: up,
      lcWindFoot: foot,
      lcWindShape: [height, spread, gusts, flutter],
      lcWindMotion: [windForce(wind ?? strength), seconds / period, sway, branches],
    });
  }

  /** Frees the level's own materials. */
  dispose() {
    for (const { material } of this.meshes) {
      material.shadowDepthWrapper.dispose();
      material.dispose();
    }
  }
}

/** Returns the factor of length of a matrix. */
export function scaleOf(matrix) {
  return Math.cbrt(Math.abs(matrix.determinant()));
}

function widen(mesh, { centre, radius }) {
  const [middle, half] = [Vector3.FromArray(centre), new Vector3(REACH * radius, REACH * radius, REACH * radius)];
  const { minimum, maximum } = mesh.getBoundingInfo();
  const [least, most] = [middle.subtract(half), middle.add(half)];
  mesh.setBoundingInfo(new BoundingInfo(Vector3.Minimize(minimum, least), Vector3.Maximize(maximum, most)));
}
