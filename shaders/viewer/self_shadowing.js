// Clouds that shade themselves: each light reaches a texel to the share that lc_sun_share of ../leafcloud.glsl says.
//
// A file that was baked with self-shadowing has the texture in its materials' extras, and the occlusion in the red of the
// roughness texture. Of the light of the sky three.js takes the occlusion by itself where the material says so.
import { ShaderChunk } from "three";
import { after, before, replaced } from "./patching.js";

/** By material of the file the texture that says from where light reaches each place; of those that have one. */
export async function visibilityOf(gltf) {
  const found = new Map();
  gltf.scene.traverse(({ material }) => material && found.set(material, material.userData.leafcloud?.visibilityTexture));
  const loaded = [...found].filter(([material, reference]) => reference && material.roughnessMap);
  const textures = loaded.map(([, { index }]) => gltf.parser.getDependency("texture", index));
  return new Map((await Promise.all(textures)).map((texture, i) => [loaded[i][0], texture]));
}

const VERTEX = `
in vec4 lcTangent;
out vec4 lcAcross; // in the coordinates of the view, w as glTF has it
`;
const FRAGMENT = `
uniform sampler2D lcVisibility;
in vec4 lcAcross;
`;
// The normal as it is, not turned toward the viewer: the texture is of places, not of sides.
const PLACE = `
    vec3 lcOut = normalize(vNormal);
    vec3 lcRight = normalize(lcAcross.xyz);
    mat3 lcAxes = mat3(lcRight, cross(lcOut, lcRight) * lcAcross.w, lcOut);
    vec3 lcToward = lcAxes * (2.0 * texture(lcVisibility, vRoughnessMapUv).xyz - 1.0);
`;
const LIGHTS = /get\w+LightInfo\([^;]*;/g;
const REACHED = "directLight.color *= lc_sun_share(texelRoughness.r, lcToward, directLight.direction);";

/** Names what the shaders read; the axes of the texture are those of the tangents. */
export function addTangents(geometry) {
  geometry.setAttribute("lcTangent", geometry.attributes.tangent);
}

/** Adds to shaders that have the laws already what dims the lights by `texture`. */
export function shadeItself(shader, texture) {
  shader.uniforms.lcVisibility = { value: texture };
  const across = "lcAcross = vec4((modelViewMatrix * vec4(lcTangent.xyz, 0.0)).xyz, lcTangent.w);";
  shader.vertexShader = before("void main()", VERTEX, after("#include <project_vertex>", across, shader.vertexShader));
  const lights = ShaderChunk.lights_fragment_begin.replaceAll(LIGHTS, `$& ${REACHED}`);
  const lit = replaced(shader.fragmentShader, "#include <lights_fragment_begin>", PLACE + lights);
  shader.fragmentShader = before("void main()", FRAGMENT, lit);
}
