// Counts the fragments of a picture: all that pass the alpha test, also those behind others, as bench/drawing.py does.
import * as THREE from "three";

/** The count is taken in a picture of this share of the sides. */
const SHARE = 0.25;

const counting = new WeakMap();
let target = null;

/** Returns the number of fragments of `scene` from `camera` in the renderer's picture. */
export function fragmentsOf(renderer, scene, camera) {
  const size = renderer.getDrawingBufferSize(new THREE.Vector2());
  const [width, height] = size.toArray().map((side) => Math.max(Math.round(SHARE * side), 1));
  target ??= new THREE.WebGLRenderTarget(width, height, { type: THREE.FloatType, depthBuffer: false });
  target.setSize(width, height);
  const { background } = scene;
  const own = swapped(scene);
  scene.background = null;
  renderer.setRenderTarget(target);
  renderer.setClearColor(0x000000, 0);
  renderer.clear();
  renderer.render(scene, camera);
  const pixels = new Float32Array(4 * width * height);
  renderer.readRenderTargetPixels(target, 0, 0, width, height, pixels);
  renderer.setRenderTarget(null);
  scene.background = background;
  own.forEach(([mesh, material]) => (mesh.material = material));
  return Math.round(pixels.reduce((sum, value, i) => (i % 4 ? sum : sum + value), 0) / SHARE ** 2);
}

/** Gives every mesh a material that counts. Returns the meshes with their own materials. */
function swapped(scene) {
  const own = [];
  scene.traverse((mesh) => {
    if (!mesh.isMesh) return;
    own.push([mesh, mesh.material]);
    mesh.material = counterOf(mesh.material);
  });
  return own;
}

/** Returns a copy of the material that adds 1 to each of its pixels. */
function counterOf(material) {
  if (!counting.has(material)) {
    const counter = material.clone();
    Object.assign(counter, { blending: THREE.CustomBlending, blendSrc: THREE.OneFactor, blendDst: THREE.OneFactor });
    Object.assign(counter, { depthTest: false, depthWrite: false, toneMapped: false });
    counter.customProgramCacheKey = () => `${material.customProgramCacheKey()} counted`;
    counter.onBeforeCompile = (shader, renderer) => {
      material.onBeforeCompile(shader, renderer);
      shader.fragmentShader = shader.fragmentShader.replace(
        "#include <dithering_fragment>",
        "#include <dithering_fragment>\n    gl_FragColor = vec4(1.0);",
      );
    };
    counting.set(material, counter);
  }
  return counting.get(material);
}
