// The laws in Babylon.js's own materials: a plug-in that fades pixels, grows and shrinks leaves, and keeps contrast.
import { MaterialPluginBase } from "@babylonjs/core";
import { LAWS } from "./glsl.js";

/** Kinds of vertex data: rank and pivot; pivot on the billboard. */
export const LEAF = "lcLeaf";
export const TARGET = "lcPivotTarget";

const UNIFORMS = [
  { name: "lcFade", size: 2, type: "vec2" }, // appeared, gone
  { name: "lcNumbers", size: 4, type: "vec4" }, // transition, keep, scale, contrast
  { name: "lcMean", size: 3, type: "vec3" },
];
// Morph targets are Babylon.js's own, so the point is already on its way to the billboard.
const PLACE = `
    positionUpdated = lc_place(positionUpdated, positionUpdated, lcLeaf.yzw, lcPivotTarget, lcNumbers.x,
        lc_growth(lcLeaf.x, lcNumbers.y, lcNumbers.z));
`;
const FADE = `
    if (!lc_shown(lcFade.x, gl_FragCoord.xy) || lc_shown(lcFade.y, gl_FragCoord.xy)) discard;
`;
const CONTRAST = `
    surfaceAlbedo = lc_toward_mean(surfaceAlbedo, lcMean, lcNumbers.w);
`;

/** Code for both kinds of meshes: the constructor of a plug-in asks for it before it knows the kind. */
const CODE = {
  vertex: {
    CUSTOM_VERTEX_DEFINITIONS: `
#ifdef LEAFCLOUD_LEAVES
attribute vec4 ${LEAF};
attribute vec3 ${TARGET};
${LAWS}
#endif
`,
    CUSTOM_VERTEX_UPDATE_POSITION: `
#ifdef LEAFCLOUD_LEAVES
${PLACE}
#endif
`,
  },
  fragment: {
    CUSTOM_FRAGMENT_DEFINITIONS: LAWS,
    CUSTOM_FRAGMENT_MAIN_BEGIN: FADE,
    CUSTOM_FRAGMENT_UPDATE_ALBEDO: `
#ifdef LEAFCLOUD_LEAVES
${CONTRAST}
#endif
`,
  },
};

export class LevelPlugin extends MaterialPluginBase {
  /** Shares of pixels: this level has appeared, the next has. */
  fade = [1, 0];
  /** a, λ, s·γ and κ of the laws. */
  numbers = [0, 1, 1, 1];
  /** Mean color of the leaves. */
  mean = [0, 0, 0];
  #leaves;

  /** `leaves`: whether the mesh has the vertex data of leaves. */
  constructor(material, leaves) {
    super(material, "Leafcloud", 200, { LEAFCLOUD_LEAVES: false }, true, true);
    this.#leaves = leaves;
  }

  isCompatible(language) {
    return language === 0; // GLSL
  }

  getClassName() {
    return "LevelPlugin";
  }

  prepareDefines(defines) {
    defines.LEAFCLOUD_LEAVES = this.#leaves;
  }

  getAttributes(attributes) {
    if (this.#leaves) attributes.push(LEAF, TARGET);
  }

  getUniforms() {
    const declared = UNIFORMS.map(({ name, type }) => `uniform ${type} ${name};`).join("\n");
    return { ubo: UNIFORMS, vertex: declared, fragment: declared };
  }

  bindForSubMesh(buffer) {
    buffer.updateFloat2("lcFade", ...this.fade);
    buffer.updateFloat4("lcNumbers", ...this.numbers);
    buffer.updateFloat3("lcMean", ...this.mean);
  }

  getCustomCode(kind) {
    return CODE[kind] ?? null;
  }
}
