// Trees and forests with levels of detail that do not pop, for three.js. README.md has examples.
export { Forest } from "./forest.js";
export { LAWS } from "./glsl.js";
export { LeafcloudLoader } from "./loader.js";
export { SETTINGS } from "./settings.js";
export { Tree } from "./tree.js";
