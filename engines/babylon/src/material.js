// The laws in Babylon.js's own materials: a plug-in that moves leaves and trunk, fades pixels, and keeps contrast.
import { MaterialPluginBase } from "@babylonjs/core";
import { ATTRIBUTES } from "./attributes.js";
import { LAWS, SHARES } from "./glsl.js";
import { NEVER } from "./laws.js";
import { MIPS } from "./shares.js";

/** Uniforms of a level's shaders, with their numbers at rest. Distances are in the file's units. */
const UNIFORMS = {
  lcViewer: [0, 0, 0], // in the world
  lcCentre: [0, 0, 0], // of the leaves, in the level's coordinates
  lcUnit: [1], // the file's unit of distance in the level's coordinates, for the view
  lcStagger: [0],
  lcTransitionAt: [NEVER, NEVER], // start, end
  lcFadeAt: [-2, -1, NEVER, 2 * NEVER], // appears from, to; goes from, to
  lcKeepAt: [NEVER, 0.5], // prune start, prune half
  lcGrowth: [0, 0],
  lcContrast: [0, 0],
  lcMean: [0, 0, 0], // color of the leaves
  lcWindDirection: [1, 0, 0], // in the world
  lcWindUp: [0, 1, 0],
  lcWindFoot: [0, 0, 0],
  lcWindShape: [1, 1, 0, 0], // height, spread, gusts, flutter
  lcWindMotion: [0, 0, 0, 0], // force, turns, sway, branches
  lcMultisampled: [0], // 1 if the picture has several samples a pixel
};
const NO_PIVOTS = new Array(MIPS).fill(0);
/** The table of areas of a level without pruning. */
const EVEN_SHARES = Array.from({ length: 65 }, (_, i) => (i / 64) ** 2);

const TYPES = [null, "float", "vec2", "vec3", "vec4"];

/** Returns the declarations of uniforms, for a plug-in, by their numbers. */
export function declared(uniforms) {
  return Object.entries(uniforms).map(([name, { length }]) => ({ name, size: length, type: TYPES[length] }));
}

const tableOf = (name, { length }) => ({ name, size: 1, type: "float", arraySize: length });
const DECLARED = [...declared(UNIFORMS), tableOf("lcShares", EVEN_SHARES), tableOf("lcPivots", NO_PIVOTS)];

/** The tree's place in the world, and the distance by which the laws decide, also for each instance. */
export const DISTANCE = `
flat varying float lcDistanceSeen;
varying vec3 lcRest; // the place on the leaf at rest

mat4 lcTreePlace() {
#ifdef INSTANCES
    mat4 place = mat4(world0, world1, world2, world3);
#ifdef THIN_INSTANCES
    place = world * place;
#endif
    return place;
#else
    return world;
#endif
}

float lcDistance(mat4 place) {
    float unit = length(place[0].xyz) * lcUnit * lc_stagger(place[3].xyz, lcStagger);
    return distance(lcViewer, (place * vec4(lcCentre, 1.0)).xyz) / unit;
}

LcWind lcWindAt(mat4 place) {
    vec3 direction = normalize(inverse(mat3(place)) * lcWindDirection);
    float turns = lcWindMotion.y + dot(LC_PLACE_TURNS, place[3].xyz);
    return LcWind(direction, lcWindUp, lcWindFoot, lcWindShape.x, lcWindShape.y, lcWindMotion.x, lcWindShape.z, turns,
        lcWindMotion.z, lcWindMotion.w, lcWindShape.w);
}
`;
const LEAVES = `
#ifdef LEAFCLOUD_LEAVES
${Object.entries(ATTRIBUTES).map(([name, width]) => `attribute vec${width} ${name};`).join("\n")}

vec3 lcMoved(vec3 point, mat4 place) {
    float seen = lcDistance(place);
    float transition = lc_transition(seen, lcTransitionAt.x, lcTransitionAt.y);
    float keep = lc_keep(seen, lcKeepAt.x, lcKeepAt.y);
    float scale = lc_area_scale(keep, lcShares) * lc_trend(keep, lcGrowth);
    float growth = lc_growth(lcLeaf.x, keep, scale);
    vec3 placed = lc_place(point, lcTarget, lcLeaf.yzw, lcOnBillboard.xyz, transition, growth);
#ifdef LEAFCLOUD_WIND
    LcWind wind = lcWindAt(place);
    vec3 pivot = mix(lcLeaf.yzw, lcOnBillboard.xyz, transition);
    vec3 turned = lc_flutter(placed, pivot, lcOnBillboard.w, lcBillboard.w, transition, wind);
    return lc_blown(turned, lcLeaf.yzw, lcBillboard.xyz, transition, wind);
#else
    return placed;
#endif
}
#else
vec3 lcMoved(vec3 point, mat4 place) {
#ifdef LEAFCLOUD_WIND
    return lc_blown(point, point, point, 0.0, lcWindAt(place));
#else
    return point;
#endif
}
#endif
`;
const MOVE = `
    mat4 lcPlace = lcTreePlace();
    lcDistanceSeen = lcDistance(lcPlace);
    lcRest = positionUpdated;
    positionUpdated = lcMoved(positionUpdated, lcPlace);
`;
export const FADE = `
    if (!lc_shown(lc_transition(lcDistanceSeen, lcFadeAt.x, lcFadeAt.y), gl_FragCoord.xy)
        || lc_shown(lc_transition(lcDistanceSeen, lcFadeAt.z, lcFadeAt.w), gl_FragCoord.xy)) discard;
`;
const CONTRAST = `
#ifdef LEAFCLOUD_LEAVES
    float lcKept = lc_keep(lcDistanceSeen, lcKeepAt.x, lcKeepAt.y);
    surfaceAlbedo = lc_toward_mean(surfaceAlbedo, lcMean, lc_contrast(lcKept, lcContrast));
#endif
`;
const HAS_SHARES = "#if defined(LEAFCLOUD_SHARES) && defined(ALBEDO) && defined(ALPHATEST)";
/** The alpha test that follows discards or sets alpha to 1. */
const CUT = `
${HAS_SHARES}
    vec2 lcTexel = vAlbedoUV * vec2(textureSize(albedoSampler, 0));
    float lcLevel = lc_mip_level(lcTexel);
    float lcRandom = lc_share_cutoff(lcRest, lcTexel, lcLevel);
    lcDrawn = lc_drawn(alpha, ALPHATESTVALUE, lc_pivot(lcPivots, lcLevel), lcRandom, lcLevel, lcMultisampled > 0.5);
    alpha = lcDrawn > 0.0 ? 1.0 : 0.0;
#endif
`;
const COVER = `
${HAS_SHARES}
    alpha = lcDrawn;
#endif
`;
/** Code for all meshes: the constructor of a plug-in asks for it before it knows the kind. */
const CODE = {
  vertex: { CUSTOM_VERTEX_DEFINITIONS: LAWS + DISTANCE + LEAVES, CUSTOM_VERTEX_UPDATE_POSITION: MOVE },
  fragment: {
    CUSTOM_FRAGMENT_DEFINITIONS: `${LAWS}${SHARES}flat varying float lcDistanceSeen;\nvarying vec3 lcRest;\nfloat lcDrawn;\n`,
    CUSTOM_FRAGMENT_MAIN_BEGIN: FADE,
    CUSTOM_FRAGMENT_UPDATE_ALBEDO: CONTRAST + CUT,
    CUSTOM_FRAGMENT_UPDATE_ALPHA: COVER,
  },
};

/** Returns the numbers of a level's shaders, at rest. All materials of the level read them. */
export function newNumbers() {
  return { ...UNIFORMS, lcShares: EVEN_SHARES };
}

export class LevelPlugin extends MaterialPluginBase {
  #numbers;
  #leaves;
  #wind;
  #pivots;

  /**
   * `numbers`: of the level's shaders. `leaves`: whether the mesh has the attributes of leaves. `wind`: whether the tree has wind.
   * `pivots`: of a texture whose alpha is a share; or null.
   */
  constructor(material, { numbers, leaves, wind, pivots = null }) {
    super(material, "Leafcloud", 200, { LEAFCLOUD_LEAVES: false, LEAFCLOUD_WIND: false, LEAFCLOUD_SHARES: false }, true, true);
    this.#numbers = numbers;
    this.#leaves = leaves;
    this.#wind = wind;
    this.#pivots = pivots;
  }

  isCompatible(language) {
    return language === 0; // GLSL
  }

  getClassName() {
    return "LevelPlugin";
  }

  prepareDefines(defines) {
    defines.LEAFCLOUD_LEAVES = this.#leaves;
    defines.LEAFCLOUD_WIND = this.#wind;
    defines.LEAFCLOUD_SHARES = this.#pivots !== null;
  }

  getAttributes(attributes) {
    if (this.#leaves) attributes.push(...Object.keys(ATTRIBUTES));
  }

  /** Uniforms of the shaders. */
  get declared() {
    return DECLARED;
  }

  getUniforms() {
    const line = ({ name, type, arraySize }) => `uniform ${type} ${name}${arraySize ? `[${arraySize}]` : ""};`;
    const text = this.declared.map(line).join("\n");
    return { ubo: this.declared, vertex: text, fragment: text };
  }

  bindForSubMesh(buffer, scene, engine) {
    const own = { lcPivots: this.#pivots ?? NO_PIVOTS, lcMultisampled: [Number(engine.currentSampleCount > 1)] };
    for (const { name, size, arraySize } of this.declared) {
      const numbers = own[name] ?? this.#numbers[name];
      if (arraySize) buffer.updateFloatArray(name, numbers);
      else buffer[`updateFloat${size > 1 ? size : ""}`](name, ...numbers);
    }
  }

  getCustomCode(kind) {
    return CODE[kind] ?? null;
  }
}
