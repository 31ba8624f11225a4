// Materials of levels for WebGLRenderer: three.js's own, with the laws in their shaders. nodes/ has those for WebGPURenderer.
import * as THREE from "three";
import { LAWS, SHARES } from "./glsl.js";
import { octahedralMaterial } from "./octahedral.js";
import { after, before, replaced } from "./patching.js";
import { shadeItself } from "./self_shadowing.js";
import { FRACTIONAL } from "./shares.js";

/**
 * The distance by which the laws decide, in the file's units. The fraction of the pixels that this level draws, and the fraction
 * that the next one draws. The processor computes them for a single tree, the shader for each instance.
 */
const DISTANCE = `
uniform vec3 lcTransitionAt; // distance, start, end
uniform vec2 lcFade; // appeared, gone
#ifdef USE_INSTANCING
uniform vec3 lcViewer; // in the world
uniform vec3 lcCentre; // of the leaves, in the level's coordinates
uniform float lcUnit; // the file's unit of distance in the level's coordinates, for the view
uniform float lcStagger;
uniform vec4 lcFadeAt; // distances: appears from, to; goes from, to
#endif
flat out vec2 lcFades;
flat out float lcDistanceSeen;
out vec3 lcRest; // the place on the leaf at rest

float lcDistance() {
#ifdef USE_INSTANCING
    mat4 place = modelMatrix * instanceMatrix;
    float unit = length(place[0].xyz) * lcUnit * lc_stagger(place[3].xyz, lcStagger);
    return distance(lcViewer, (place * vec4(lcCentre, 1.0)).xyz) / unit;
#else
    return lcTransitionAt.x;
#endif
}

vec2 lcFadesHere() {
#ifdef USE_INSTANCING
    float d = lcDistance();
    return vec2(lc_transition(d, lcFadeAt.x, lcFadeAt.y), lc_transition(d, lcFadeAt.z, lcFadeAt.w));
#else
    return lcFade;
#endif
}
`;
const LEAVES = `
uniform vec2 lcKeepAt; // prune start, prune half
uniform float lcShares[LC_SHARES];
uniform vec2 lcGrowth;
in vec3 lcTarget;
in vec3 lcLeaf; // rank, phase, freedom
in vec3 lcPivot;
in vec3 lcPivotTarget;

vec3 lcPlaced(vec3 point) {
    float transition = lc_transition(lcDistance(), lcTransitionAt.y, lcTransitionAt.z);
    float keep = lc_keep(lcDistance(), lcKeepAt.x, lcKeepAt.y);
    float scale = lc_area_scale(keep, lcShares) * lc_trend(keep, lcGrowth);
    float growth = lc_growth(lcLeaf.x, keep, scale);
    return lc_place(point, lcTarget, lcPivot, lcPivotTarget, transition, growth);
}
`;
/** The file's wind in the level's coordinates: a tree's own come from the processor, instances turn it in the shader. */
const WIND = `
uniform LcWind lcWind;

LcWind lcWindHere() {
    LcWind wind = lcWind;
#ifdef USE_INSTANCING
    mat4 place = modelMatrix * instanceMatrix;
    wind.direction = normalize(inverse(mat3(place)) * lcWind.direction);
    wind.turns += dot(LC_PLACE_TURNS, place[3].xyz);
#endif
    return wind;
}
`;
const BLOWN_LEAVES = `
in vec3 lcBillboardPivot;

vec3 lcBlownLeaf(vec3 point) {
    LcWind wind = lcWindHere();
    float transition = lc_transition(lcDistance(), lcTransitionAt.y, lcTransitionAt.z);
    vec3 pivot = mix(lcPivot, lcPivotTarget, transition);
    vec3 turned = lc_flutter(lcPlaced(point), pivot, lcLeaf.y, lcLeaf.z, transition, wind);
    return lc_blown(turned, lcPivot, lcBillboardPivot, transition, wind);
}
`;
const BLOWN_TRUNK = `
vec3 lcBlownTrunk(vec3 point) {
    return lc_blown(point, point, point, 0.0, lcWindHere());
}
`;
const PASS_ON = `
    lcFades = lcFadesHere();
    lcDistanceSeen = lcDistance();
    lcRest = position;
`;
const FRAGMENT = `
uniform vec2 lcKeepAt;
uniform vec3 lcMean;
uniform vec2 lcContrast;
flat in vec2 lcFades;
flat in float lcDistanceSeen;
in vec3 lcRest;
`;
const FADE = `
    if (!lc_shown(lcFades.x, gl_FragCoord.xy) || lc_shown(lcFades.y, gl_FragCoord.xy)) discard;
`;
const CONTRAST = `
    float lcKept = lc_keep(lcDistanceSeen, lcKeepAt.x, lcKeepAt.y);
    diffuseColor.rgb = lc_toward_mean(diffuseColor.rgb, lcMean, lc_contrast(lcKept, lcContrast));
`;
const CUT = `
    vec2 lcTexel = vMapUv * vec2(textureSize(map, 0));
    float lcLevel = lc_mip_level(lcTexel);
    float lcRandom = lc_share_cutoff(lcRest, lcTexel, lcLevel);
    diffuseColor.a = lc_drawn(diffuseColor.a, lcCutoff, lc_pivot(lcPivots, lcLevel), lcRandom, lcLevel, lcMultisampled);
    if (diffuseColor.a == 0.0) discard;
`;
const SHARE = `
uniform float lcCutoff;
uniform float lcPivots[LC_MIPS];
uniform bool lcMultisampled;
`;

/** Whether the picture that is drawn has several samples a pixel. Shadow maps have one. */
const MULTISAMPLED = { value: false };
const ONE_SAMPLE = { value: false };

/** For `onBeforeRender` of meshes: only then the target of the picture is known. */
function countSamples(renderer) {
  MULTISAMPLED.value = (renderer.getRenderTarget() ?? renderer.capabilities).samples > 1;
}

/** Gives a mesh of a level its materials. `part`: a mesh of the source; `uniforms`: of the level. */
export function dress(mesh, part, uniforms) {
  if (part.impostor) {
    mesh.material = octahedralMaterial(part.impostor, part.material, (shader) => {
      addFade(shader, uniforms);
      shader.uniforms.lcMultisampled = MULTISAMPLED;
    });
    mesh.customDepthMaterial = mesh.customDistanceMaterial = NO_SHADOW;
    return;
  }
  mesh.onBeforeRender = countSamples;
  mesh.material = patched(part, uniforms);
  mesh.customDepthMaterial = shadowing(part, uniforms);
}

/** A quad that turns to the camera has no shadow of the tree. */
const NO_SHADOW = new THREE.MeshDepthMaterial({ colorWrite: false, depthWrite: false });

/** Returns a mesh that draws `mesh` at as many places as `capacity`. */
export function newCopies({ geometry, material, customDepthMaterial }, capacity) {
  const own = { customDepthMaterial, onBeforeRender: countSamples };
  return Object.assign(new THREE.InstancedMesh(geometry, material, capacity), own);
}

/** Frees the material for shadow maps. */
export function undress({ customDepthMaterial }) {
  if (customDepthMaterial !== NO_SHADOW) customDepthMaterial.dispose();
}

/** Returns a copy of the material of `part` that includes the laws. */
function patched({ material: original, leaves, shading, cut }, uniforms) {
  const material = original.clone();
  if (cut) Object.assign(material, FRACTIONAL);
  material.forceSinglePass = true; // Otherwise three.js draws all blended backs before all fronts.
  material.color.multiplyScalar(original.userData.leafcloud?.light_strength ?? 1);
  const wind = "lcWind" in uniforms;
  material.customProgramCacheKey = () => `leafcloud ${leaves} ${wind} ${Boolean(shading)} ${Boolean(cut)}`;
  material.onBeforeCompile = (shader) => {
    moveAndFade(shader, uniforms, leaves);
    if (cut) cutByShare(shader, cut, MULTISAMPLED);
    if (shading) shadeItself(shader, shading);
  };
  return material;
}

/** Returns the material for shadow maps, which move and fade like the one of `part`. */
function shadowing({ material: original, leaves, cut }, uniforms) {
  const { map, alphaTest, side, transparent } = original;
  const look = { alphaTest, alphaHash: transparent };
  const made = new THREE.MeshDepthMaterial({ depthPacking: THREE.RGBADepthPacking, map, side, ...look });
  made.customProgramCacheKey = () => `leafcloud shadow ${leaves} ${"lcWind" in uniforms} ${Boolean(cut)}`;
  made.onBeforeCompile = (shader) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = movedVertices(shader.vertexShader, leaves, "lcWind" in uniforms);
    shader.fragmentShader = faded(shader.fragmentShader);
    if (cut) cutByShare(shader, cut, ONE_SAMPLE);
  };
  return made;
}

/** Adds fades, and for leaves all laws of their vertices and colors, to a shader. */
function moveAndFade(shader, uniforms, leaves) {
  Object.assign(shader.uniforms, uniforms);
  shader.vertexShader = movedVertices(shader.vertexShader, leaves, "lcWind" in uniforms);
  const colored = leaves ? after("#include <color_fragment>", CONTRAST, shader.fragmentShader) : shader.fragmentShader;
  shader.fragmentShader = faded(colored);
}

/** Adds the cross-fade alone to a shader. Another patch moves its vertices, at `#include <begin_vertex>`. */
function addFade(shader, uniforms) {
  Object.assign(shader.uniforms, uniforms);
  shader.vertexShader = before("void main()", LAWS + DISTANCE, after("#include <begin_vertex>", PASS_ON, shader.vertexShader));
  shader.fragmentShader = faded(shader.fragmentShader);
}

/** Returns the declarations of a vertex shader for leaves or for the trunk, and the expression of the moved point. */
export function placing(leaves, wind) {
  const declared = LAWS + DISTANCE + (leaves ? LEAVES : "") + (wind ? WIND : "");
  if (leaves && wind) return [declared + BLOWN_LEAVES, "lcBlownLeaf(position)"];
  if (leaves) return [declared, "lcPlaced(position)"];
  return wind ? [declared + BLOWN_TRUNK, "lcBlownTrunk(position)"] : [declared, "position"];
}

function movedVertices(source, leaves, wind) {
  const [declarations, place] = placing(leaves, wind);
  const moved = replaced(source, "#include <begin_vertex>", `vec3 transformed = ${place};${PASS_ON}`);
  return before("void main()", declarations, moved);
}

function faded(source) {
  return before("void main()", LAWS + FRAGMENT, after("#include <clipping_planes_fragment>", FADE, source));
}

/** Replaces the alpha test of a shader by the law of shares. `multisampled`: the uniform. */
function cutByShare(shader, { cutoff, pivots }, multisampled) {
  Object.assign(shader.uniforms, { lcCutoff: { value: cutoff }, lcPivots: { value: pivots }, lcMultisampled: multisampled });
  const cut = replaced(shader.fragmentShader, "#include <alphatest_fragment>", CUT);
  shader.fragmentShader = before("void main()", SHARES + SHARE, cut);
}
