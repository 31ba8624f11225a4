// Trees and forests with levels of detail that do not pop, for Babylon.js. README.md has examples.
export { Forest } from "./forest.js";
export { LAWS } from "./glsl.js";
export { loadTree } from "./loading.js";
export { SETTINGS } from "./settings.js";
export { Tree } from "./tree.js";
