// Runs shaders in this machine's WebGL 2 and answers with their results. The type of the question follows from its keys.
//
// {tables: [{expression, rows}], shares}: evaluates the vec4 `expression` of leafcloud.glsl and shares.glsl for each row of 16 numbers,
// x0 … x3 (vec4), through transform feedback. `shares` is the table of areas. The answer has four numbers for each row.
//
// {tree, settings, eyes, seconds}: views the file in the viewer from each of the `eyes`, after `seconds` of wind. The
// answer has {level, share, triangles, pixels, meshes: [{material, count, places}], trunk: [{…}]} for each eye. `count` is
// the number of drawn indices. `places` are the points from the viewer's own vertex shader. `pixels` are 64 × 64 × 4
// floats. The light makes them nearly equal to the materials' linear colors. With `suns`, one direction for each eye, a
// single light shines from that direction instead.
//
// {textures: url, transcoder}: loads the file with a renderer. The answer has {compressed, plain}: how many of the textures
// of base color are compressed ones, and how many are pictures. Without a `transcoder` three.js's own is used.
import * as THREE from "three";
import { SHARES } from "/engines/three/src/glsl.js";
import { LAWS, Tree } from "/engines/three/src/index.js";
import { loadFile } from "/engines/three/src/loading.js";
import { placing } from "/engines/three/src/materials.js";

const gl = new OffscreenCanvas(1, 1).getContext("webgl2");
const HEADER = "#version 300 es\nprecision highp float;\nout vec4 result;\n";
/** Vertex shaders have no derivatives. */
const NO_DERIVATIVES = "#define dFdx(x) (x)\n#define dFdy(x) (x)\n#define fwidth(x) (x)\n";

function compiled(kind, source) {
  const shader = gl.createShader(kind);
  gl.shaderSource(shader, source);
  gl.compileShader(shader);
  if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(`${gl.getShaderInfoLog(shader)}\n${source}`);
  return shader;
}

const NO_FRAGMENTS = "#version 300 es\nvoid main() {}";

function linked(vertexSource) {
  const program = gl.createProgram();
  gl.attachShader(program, compiled(gl.VERTEX_SHADER, vertexSource));
  gl.attachShader(program, compiled(gl.FRAGMENT_SHADER, NO_FRAGMENTS));
  gl.transformFeedbackVaryings(program, ["result"], gl.SEPARATE_ATTRIBS);
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}

/** Returns the output `result` for each of `count` points. */
function computed(vertexSource, attributes, uniforms, count) {
  prepare(linked(vertexSource), attributes, uniforms);
  return captured(count);
}

function prepare(program, attributes, uniforms) {
  gl.useProgram(program);
  for (const [name, values] of Object.entries(uniforms)) {
    const location = gl.getUniformLocation(program, name);
    const set = { 2: gl.uniform2fv, 3: gl.uniform3fv, 4: gl.uniform4fv }[values.length] ?? gl.uniform1fv;
    if (values.length === 16) gl.uniformMatrix4fv(location, true, values);
    else set.call(gl, location, values);
  }
  gl.bindVertexArray(gl.createVertexArray());
  for (const [name, { array, itemSize }] of Object.entries(attributes)) {
    const location = gl.getAttribLocation(program, name);
    if (location < 0) continue;
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, itemSize, gl.FLOAT, false, 0, 0);
  }
}

function captured(count) {
  const results = new Float32Array(4 * count);
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, null);
  gl.bindBuffer(gl.TRANSFORM_FEEDBACK_BUFFER, buffer);
  gl.bufferData(gl.TRANSFORM_FEEDBACK_BUFFER, results.byteLength, gl.STREAM_READ);
  gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, buffer);
  gl.enable(gl.RASTERIZER_DISCARD);
  gl.beginTransformFeedback(gl.POINTS);
  gl.drawArrays(gl.POINTS, 0, count);
  gl.endTransformFeedback();
  gl.getBufferSubData(gl.TRANSFORM_FEEDBACK_BUFFER, 0, results);
  if (gl.getError() !== gl.NO_ERROR) throw new Error("WebGL refused a call");
  return results;
}

function tabulated({ expression, rows }, shares) {
  const source = `${HEADER}${NO_DERIVATIVES}${LAWS}${SHARES}
    uniform float lcShares[LC_SHARES];
    in vec4 x0; in vec4 x1; in vec4 x2; in vec4 x3;
    void main() { result = ${expression}; }`;
  const columns = [0, 4, 8, 12].map((from) => Float32Array.from(rows.flatMap((row) => row.slice(from, from + 4))));
  const attributes = Object.fromEntries(columns.map((array, i) => [`x${i}`, { array, itemSize: 4 }]));
  const results = computed(source, attributes, { lcShares: shares }, rows.length);
  return rows.map((_, i) => [...results.subarray(4 * i, 4 * i + 4)]);
}

function placed(geometry, uniforms) {
  const { position } = geometry.attributes;
  const [declarations, place] = placing("lcTarget" in geometry.attributes, "lcWind" in uniforms);
  if (place === "position") return position.array;
  const source = `${HEADER}${declarations}in vec3 position;
    void main() { result = vec4(${place}, 1.0); }`;
  const values = {
    lcTransitionAt: uniforms.lcTransitionAt.value.toArray(),
    lcKeepAt: uniforms.lcKeepAt.value.toArray(),
    lcShares: uniforms.lcShares.value,
    lcGrowth: uniforms.lcGrowth.value.toArray(),
  };
  for (const [name, value] of Object.entries(uniforms.lcWind?.value ?? {})) {
    values[`lcWind.${name}`] = value.toArray?.() ?? [value];
  }
  return computed(source, geometry.attributes, values, position.count).filter((_, i) => i % 4 < 3);
}

function encoded(values) {
  const bytes = new Uint8Array(values.buffer, values.byteOffset, values.byteLength);
  let text = "";
  for (let i = 0; i < bytes.length; i += 1 << 15) text += String.fromCharCode(...bytes.subarray(i, i + (1 << 15)));
  return btoa(text);
}

function meshesOf(level, isTrunk) {
  const found = level.meshes.filter(({ userData }) => userData.isTrunk === isTrunk);
  return found.map(({ geometry, material }) => ({
    material: material.name,
    count: Math.min(geometry.drawRange.count, geometry.index.count),
    places: encoded(placed(geometry, level.uniforms)),
  }));
}

function newRenderer() {
  const renderer = new THREE.WebGLRenderer();
  renderer.setClearColor(0x000000, 0);
  renderer.debug.onShaderError = (context, program, vertex, fragment) => {
    throw new Error([vertex, fragment].map((shader) => context.getShaderInfoLog(shader)).join("\n"));
  };
  return renderer;
}

function pictured(renderer, scene, camera) {
  const target = new THREE.WebGLRenderTarget(64, 64, { type: THREE.FloatType });
  const pixels = new Float32Array(4 * 64 * 64);
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  renderer.readRenderTargetPixels(target, 0, 0, 64, 64, pixels);
  target.dispose();
  return pixels;
}

function lightOf(sun) {
  if (!sun) return new THREE.AmbientLight(0xffffff, Math.PI);
  const light = new THREE.DirectionalLight(0xffffff, Math.PI);
  light.position.fromArray(sun);
  return light;
}

async function seen({ tree: url, settings, eyes, seconds = 0, suns = [] }) {
  const tree = await Tree.load(url);
  Object.assign(tree.settings, settings);
  const renderer = newRenderer();
  return eyes.map((eye, number) => {
    const scene = new THREE.Scene().add(tree, lightOf(suns[number]));
    const camera = new THREE.PerspectiveCamera(50, 1, tree.radius / 100, 1000 * tree.radius);
    camera.position.fromArray(eye);
    camera.lookAt(tree.centre);
    // The view is as wide as the crown at any distance.
    camera.fov = (360 / Math.PI) * Math.atan(tree.radius / camera.position.distanceTo(tree.centre));
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    tree.update(camera, seconds);
    const level = tree.levels[tree.level];
    const pixels = encoded(pictured(renderer, scene, camera));
    const { triangles } = renderer.info.render;
    const [meshes, trunk] = [false, true].map((isTrunk) => meshesOf(level, isTrunk));
    return { level: tree.level, share: tree.state.share, triangles, pixels, meshes, trunk };
  });
}

async function texturesIn({ textures: url, transcoder }) {
  const gltf = await loadFile(url, newRenderer(), { transcoder });
  const maps = new Set();
  const materials = await gltf.parser.getDependencies("material");
  materials.forEach(({ map }) => map && maps.add(map));
  const compressed = [...maps].filter(({ isCompressedTexture }) => isCompressedTexture).length;
  return { compressed, plain: maps.size - compressed };
}

const answer = (content) => fetch("/answer", { method: "POST", body: JSON.stringify(content) });
try {
  const question = await (await fetch("/question")).json();
  if (question.tables) await answer({ tables: question.tables.map((table) => tabulated(table, question.shares)) });
  else if (question.textures) await answer(await texturesIn(question));
  else await answer({ seen: await seen(question) });
} catch (error) {
  await answer({ error: `${error}\n${error.stack}` });
}
