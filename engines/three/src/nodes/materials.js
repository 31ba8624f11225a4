// Materials of levels for WebGPURenderer: three.js's node materials with the laws. materials.js has those for WebGLRenderer.
import * as THREE from "three";
import { attribute, bool, diffuseColor, mat3, mix, normalize, positionGeometry, texture } from "three/tsl";
import { MeshBasicNodeMaterial, MeshPhysicalNodeMaterial, MeshStandardNodeMaterial } from "three/webgpu";
import { FRACTIONAL } from "../shares.js";
import { LEAST_ALPHA } from "../uniforms.js";
import { areaScale, blownAlone, blownOf, flutterOf, growthOf, placeOf, towardMean, trendOf, turnsAt } from "./laws.js";
import { copied, Copies, drawn, inPattern, keep, keepOfPixel, numberOf, placed, shares, toWorld, transition } from "./level.js";
import { impostorNodes } from "./octahedral.js";
import { shadeItself } from "./self_shadowing.js";
import { drawnOfLeaf } from "./shares.js";

const growth = numberOf("vec2", (laws) => laws.lcGrowth.value);
const mean = numberOf("vec3", (laws) => laws.lcMean.value);
const contrast = numberOf("vec2", (laws) => laws.lcContrast.value);
const target = attribute("lcTarget", "vec3");
const leaf = attribute("lcLeaf", "vec3"); // rank, phase, freedom
const pivot = attribute("lcPivot", "vec3");
const pivotTarget = attribute("lcPivotTarget", "vec3");
const billboardPivot = attribute("lcBillboardPivot", "vec3");

const windNumber = (type) => (name) => [name, numberOf(type, (laws) => laws.lcWind.value[name])];
const given = Object.fromEntries([
  ...["direction", "up", "foot"].map(windNumber("vec3")),
  ...["height", "spread", "force", "gusts", "turns", "sway", "branches", "flutter"].map(windNumber("float")),
]);
/** The file's wind in the level's coordinates: a tree's own come from the processor, copies turn it in the shader. */
const wind = {
  ...given,
  direction: copied(
    "vec3",
    () => normalize(mat3(toWorld).inverse().mul(given.direction)),
    () => given.direction,
  ),
  turns: copied(
    "float",
    () => given.turns.add(turnsAt(toWorld.element(3).xyz)),
    () => given.turns,
  ),
};

// Variables keep shaders short: each branch of a `select` otherwise has code of its own for all that only the branch needs.
function leafAt(a) {
  const kept = keep.toVar();
  const scale = areaScale(kept, shares).mul(trendOf(kept, growth));
  return placeOf(positionGeometry, target, pivot, pivotTarget, a, growthOf(leaf.x, kept, scale).toVar()).toVar();
}

function blownLeafAt(a) {
  const turned = flutterOf(leafAt(a), mix(pivot, pivotTarget, a).toVar(), leaf.y, leaf.z, a, wind).toVar();
  return blownOf(turned, pivot, billboardPivot, a, wind);
}

/** Positions of vertices: one node for all materials, so that they share shaders. */
const POSITIONS = {
  leaves: { still: placed(() => leafAt(transition.toVar())), blown: placed(() => blownLeafAt(transition.toVar())) },
  trunk: { still: placed(() => positionGeometry), blown: placed(() => blownAlone(positionGeometry, wind)) },
};

/** Returns a class of materials that includes the laws; `Base` is one of three.js's. */
const lawful = (Base) =>
  class extends Base {
    static get type() {
      return `Leafcloud${Base.type}`;
    }

    setupVariants(builder) {
      if (this.hasLeaves) diffuseColor.rgb.assign(towardMean(diffuseColor.rgb, mean, keepOfPixel, contrast));
      super.setupVariants(builder);
      if (!this.alphaToCoverage) return;
      diffuseColor.a.assign(this.coverNode);
      diffuseColor.a.lessThanEqual(0).discard();
    }

    setupLightingModel(builder) {
      const model = super.setupLightingModel(builder);
      return this.bentNormalNode ? shadeItself(model, this.bentNormalNode, this.opennessNode) : model;
    }
  };

const Standard = lawful(MeshStandardNodeMaterial);
const Physical = lawful(MeshPhysicalNodeMaterial);
const Basic = lawful(MeshBasicNodeMaterial);

function materialFor({ isMeshPhysicalMaterial, isMeshBasicMaterial }) {
  if (isMeshPhysicalMaterial) return new Physical();
  return isMeshBasicMaterial ? new Basic() : new Standard();
}

/** Returns what `make` made of the same `key` before: copies of a tree then share nodes, and so shaders. */
function once(made, key, make) {
  if (!made.has(key)) made.set(key, make());
  return made.get(key);
}

/** For shadows: a quad that turns to the camera has none of the tree. */
const NOWHERE = bool(false);
const impostors = new WeakMap();
const textures = new WeakMap();
const packed = new WeakMap();
const cuts = new WeakMap();

const textureNode = (each) => once(textures, each, () => texture(each));

/** Gives a mesh of a level its material. `part`: a mesh of the source; `uniforms`: of the level. */
export function dress(mesh, part, uniforms) {
  mesh.material = part.impostor ? impostorMaterial(part) : levelMaterial(part, Boolean(uniforms.lcWind));
  mesh.material.laws = uniforms;
  if (part.leaves) pack(mesh.geometry, part.geometry);
}

/** Returns a mesh that draws `mesh` at as many places as `capacity`. */
export function newCopies({ geometry, material }, capacity) {
  return new Copies(geometry, material, capacity);
}

/** Node materials need no material for shadow maps. */
export function undress() {}

function levelMaterial({ material: original, leaves, shading, cut }, blows) {
  const material = materialFor(original).copy(original);
  material.forceSinglePass = true; // Otherwise three.js draws all blended backs before all fronts.
  material.color.multiplyScalar(original.userData.leafcloud?.light_strength ?? 1);
  material.hasLeaves = leaves;
  material.positionNode = POSITIONS[leaves ? "leaves" : "trunk"][blows ? "blown" : "still"];
  material.maskNode = drawn;
  if (cut) {
    const { map } = original;
    const [coverNode, ofShadow] = once(cuts, original, () => {
      const [cover, isDrawn] = drawnOfLeaf(textureNode(map), map, cut);
      return [cover, drawn.and(isDrawn)];
    });
    // The alpha test would cut again.
    Object.assign(material, FRACTIONAL, { alphaTest: 0, coverNode, maskShadowNode: ofShadow });
  }
  if (original.transparent && original.map) material.maskShadowNode = drawn.and(inPattern(textureNode(original.map).a));
  if (shading) {
    material.bentNormalNode = textureNode(shading);
    material.opennessNode = textureNode(original.roughnessMap);
  }
  return material;
}

/** Returns the material of an octahedral impostor. */
function impostorMaterial({ impostor, material: { roughness, metalness } }) {
  const nodes = once(impostors, impostor, () => impostorNodes(impostor));
  const look = { roughness, metalness, transparent: true, alphaTest: LEAST_ALPHA };
  return Object.assign(new Standard(look), nodes, { maskNode: drawn, maskShadowNode: NOWHERE });
}

/** Puts the laws' attributes of a geometry into one buffer: WebGPU has room for eight. `source` has those of all copies. */
function pack(geometry, source) {
  const names = Object.keys(source.attributes).filter((name) => /^lc(?!Tangent)/.test(name));
  const attributes = once(packed, source, () => interleaved(names.map((name) => source.attributes[name])));
  names.forEach((name, i) => geometry.setAttribute(name, attributes[i]));
}

function interleaved(attributes) {
  const stride = attributes.reduce((sum, { itemSize }) => sum + itemSize, 0);
  const { count } = attributes[0];
  const buffer = new THREE.InterleavedBuffer(new Float32Array(stride * count), stride);
  let offset = 0;
  return attributes.map((attribute) => {
    const { itemSize } = attribute;
    const made = new THREE.InterleavedBufferAttribute(buffer, itemSize, offset);
    for (let i = 0; i < count * itemSize; i++) {
      made.setComponent(Math.floor(i / itemSize), i % itemSize, attribute.getComponent(Math.floor(i / itemSize), i % itemSize));
    }
    offset += itemSize;
    return made;
  });
}
