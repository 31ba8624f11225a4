// Octahedral impostors: a quad in place of the cross impostor of the last level, by the law of octahedral.glsl.
import { PBRMaterial, Texture, VertexData } from "@babylonjs/core";
import { LAWS, OCTAHEDRAL, SHARES } from "./glsl.js";
import { declared, DISTANCE, FADE, LevelPlugin } from "./material.js";

/** The corners of a quad; the shader places them. */
export const QUAD = Object.assign(new VertexData(), {
  positions: [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0],
  normals: [0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1],
  uvs: [0, 0, 1, 0, 1, 1, 0, 1],
  indices: [0, 1, 2, 0, 2, 3],
});

/** Returns the numbers of an impostor's shaders by the extras of its level. */
export function impostorNumbers({ to_layout: rows, extent, half, grid, texels }) {
  const layout = { lcLayoutX: rows.slice(0, 4), lcLayoutY: rows.slice(4, 8), lcLayoutZ: rows.slice(8, 12) };
  return { ...layout, lcExtent: extent, lcHalfBox: half, lcViews: [grid, texels] };
}

const ROW = [0, 0, 0, 0];
const SIZES = { lcLayoutX: ROW, lcLayoutY: ROW, lcLayoutZ: ROW, lcExtent: [0, 0], lcHalfBox: [0, 0, 0], lcViews: [0, 0] };

const IMPOSTOR = `
LcOctahedral lcImpostor() {
    return LcOctahedral(lcExtent, lcHalfBox, lcViews.x, lcViews.y);
}
`;
const VARYINGS = `
varying vec3 lcPoint;
varying vec3 lcEye;
varying vec2 lcCorner;
varying mat3 lcNormalToWorld;
`;
/** The quad faces the camera, or the light in a shadow map: the place on the near plane in front of the tree tells the direction. */
const CORNER = `
    mat4 lcPlace = lcTreePlace();
    mat4 lcToLayout = transpose(mat4(lcLayoutX, lcLayoutY, lcLayoutZ, vec4(0.0, 0.0, 0.0, 1.0)));
    mat4 lcFromLayout = inverse(lcToLayout);
    vec4 lcMiddle = viewProjection * (lcPlace * lcFromLayout[3]);
    vec4 lcNear = inverse(viewProjection) * vec4(lcMiddle.xy / lcMiddle.w, -1.0, 1.0);
    vec3 lcFrom = (lcToLayout * (inverse(lcPlace) * vec4(lcNear.xyz / lcNear.w, 1.0))).xyz;
    lcEye = normalize(lcFrom);
    lcCorner = position.xy;
    lcPoint = lc_octahedral_corner(lcCorner, lcEye, lcImpostor());
    lcNormalToWorld = mat3(lcPlace) * transpose(mat3(lcToLayout));
    lcDistanceSeen = lcDistance(lcPlace);
    positionUpdated = (lcFromLayout * vec4(lcPoint, 1.0)).xyz;
`;
const COLOR = `
    vec4 lcSeen;
    vec3 lcNormal;
    float lcLight;
    float lcTexels = 0.5 * lcViews.y * max(length(dFdx(lcCorner)), length(dFdy(lcCorner)));
    float lcLod = log2(lcTexels);
    lc_octahedral(lcColorPage, lcNormalPage, lcPoint, normalize(lcEye), lcLod, lcImpostor(), lcSeen, lcNormal, lcLight);
    float lcCutoff = lc_share_cutoff(lcPoint, 0.5 * lcViews.y * lcCorner, max(lcLod, 0.0));
    alpha = lcMultisampled > 0.5 ? lcSeen.a : lcSeen.a < lcCutoff ? 0.0 : 1.0;
    if (alpha == 0.0) discard;
    surfaceAlbedo *= lcSeen.rgb;
    normalW = normalize(lcNormalToWorld * lcNormal);
`;
const PAGES = `
uniform highp sampler2D lcColorPage;
uniform highp sampler2D lcNormalPage;
`;
const CODE = {
  vertex: { CUSTOM_VERTEX_DEFINITIONS: LAWS + OCTAHEDRAL + DISTANCE + VARYINGS + IMPOSTOR, CUSTOM_VERTEX_UPDATE_POSITION: CORNER },
  fragment: {
    CUSTOM_FRAGMENT_DEFINITIONS: `${LAWS}${OCTAHEDRAL}${SHARES}${PAGES}${VARYINGS}flat varying float lcDistanceSeen;\n${IMPOSTOR}`,
    CUSTOM_FRAGMENT_MAIN_BEGIN: FADE,
    CUSTOM_FRAGMENT_BEFORE_LIGHTS: COLOR,
  },
};

/** Returns the textures {color, normalDepth} of images, which are not ready at once. */
export function pagesOf({ color, normalDepth }, scene, name) {
  const read = (bytes, suffix, useSRGBBuffer) => {
    const options = { buffer: bytes, mimeType: "image/png", invertY: false, useSRGBBuffer };
    const texture = new Texture(`data:${name} ${suffix}`, scene, options);
    texture.wrapU = texture.wrapV = Texture.CLAMP_ADDRESSMODE;
    return texture;
  };
  return { color: read(color, "color", true), normalDepth: read(normalDepth, "normal", false) };
}

/** Returns the material of an octahedral impostor. `original`: the cross impostor's. */
export function impostorMaterial(original) {
  const material = new PBRMaterial(original.name, original.getScene());
  const { roughness, metallic } = original;
  // The normal of the quad faces the camera on either side.
  return Object.assign(material, { roughness, metallic, backFaceCulling: false });
}

export class ImpostorPlugin extends LevelPlugin {
  #pages;

  /** `numbers`: of the level's shaders. `pages`: the textures. */
  constructor(material, { numbers, pages }) {
    super(material, { numbers, leaves: false, wind: false });
    this.#pages = pages;
  }

  getClassName() {
    return "ImpostorPlugin";
  }

  get declared() {
    return [...super.declared, ...declared(SIZES)];
  }

  getSamplers(samplers) {
    samplers.push("lcColorPage", "lcNormalPage");
  }

  getActiveTextures(textures) {
    textures.push(...Object.values(this.#pages));
  }

  hasTexture(texture) {
    return Object.values(this.#pages).includes(texture);
  }

  bindForSubMesh(buffer, scene, engine) {
    super.bindForSubMesh(buffer, scene, engine);
    buffer.setTexture("lcColorPage", this.#pages.color);
    buffer.setTexture("lcNormalPage", this.#pages.normalDepth);
  }

  getCustomCode(kind) {
    return CODE[kind] ?? null;
  }
}
